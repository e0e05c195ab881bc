"""Statements of SysML v2 as definitions and usages: name, types, multiplicity, value."""

from dataclasses import dataclass, field
from typing import Any

from swarmwright.models._sysml_text import Statement, Token

KEYWORDS = frozenset({"attribute", "item", "metadata", "package", "part", "port"})
_PREFIXES = frozenset(
    {"abstract", "constant", "derived", "end", "individual", "library", "private", "protected", "public"}
    | {"readonly", "ref", "standard", "variant", "variation"}
)
_DIRECTIONS = frozenset({"in", "inout", "out"})
SILENT = frozenset({"import", "doc", "comment", "alias", "rep"})
"""Statements without meaning for an experiment."""
_NO_NAMES = frozenset({"default", "defined", "ordered", "nonunique"})
_TYPED, _SPECIAL = frozenset({":"}), frozenset({":>", "specializes", "subsets"})
_REDEFINED = frozenset({":>>", "redefines"})


@dataclass
class Feature:
    """A definition or a usage."""

    statement: Statement
    keyword: str
    """Of KEYWORDS; empty for a directed feature without one; `@` for metadata; else a word not supported."""
    scope: tuple[str, ...] = ()
    """Path of what it is in the body of."""
    is_definition: bool = False
    """Whether it is a definition, else a usage."""
    direction: str = ""
    """in, out or inout; empty without one."""
    name: str = ""
    """Empty for one without a name."""
    short_name: str = ""
    """In angle brackets in front of the name."""
    types: list[list[str]] = field(default_factory=list)
    """Qualified names of its types, and of what it specializes, word by word."""
    conjugated: bool = False
    """Whether the type of a port is conjugated, `~Type`."""
    multiplicity: list[Token] | None = None
    """What is between the brackets; None without them."""
    value: list[Token] | None = None
    """The expression behind `=`; None without one."""
    about: list[str] = field(default_factory=list)
    """Of metadata: the names of what it is about, where it is not in its body."""
    prefixes: list[str] = field(default_factory=list)
    """Metadata that is written in front, #Optimize."""

    @property
    def line(self) -> int:
        """Where it begins."""
        return self.statement.line

    @property
    def path(self) -> tuple[str, ...]:
        """The names around it, and its own; where it has none, another word that nothing else has."""
        return (*self.scope, self.name or f"#{self.statement.end}")

    @property
    def inside(self) -> list["Feature"]:
        """What is in its body."""
        return [feature_of(one, self.path) for one in self.statement.body or []]


def feature_of(statement: Statement, scope: tuple[str, ...] = ()) -> Feature:
    """Return what a statement defines or uses; scope: the path of what it is in the body of."""
    words = list(statement.tokens)
    feature = Feature(statement, "", scope)
    while words and (words[0].text in _PREFIXES | _DIRECTIONS or words[0].text == "#"):
        word = words.pop(0)
        if word.text == "#" and words:
            feature.prefixes.append(words.pop(0).name)
        elif word.text in _DIRECTIONS:
            feature.direction = word.text
    first, second = ([one.text for one in words] + ["", ""])[:2]
    if first == "@" or (first == "metadata" and second != "def"):
        words.pop(0)
        feature.keyword = "@"
    elif (
        words
        and words[0].kind == "name"
        and (first in KEYWORDS or not feature.direction)
        and second != "="  # else it is a name that gets a value
    ):
        feature.keyword = words.pop(0).text
    if words and words[0].text == "def":
        words.pop(0)
        feature.is_definition = True
    _declaration(feature, words)
    return feature


def _declaration(feature: Feature, words: list[Token]) -> None:
    """Take name, types, multiplicity and value from the words of a feature."""
    while words:
        word = words.pop(0)
        if word.text in {"=", ":="}:
            feature.value = [one for one in words if one.text != "default"]
            return
        if word.text == "[":
            inner: list[Token] = []
            while words and words[0].text != "]":
                inner.append(words.pop(0))
            if words:
                words.pop(0)
            feature.multiplicity = inner
        elif word.text in _REDEFINED:
            names = _qualified(words, feature)
            feature.name = feature.name or (names[-1] if names else "")
        elif word.text in _TYPED | _SPECIAL or (word.text == "by" and words):
            feature.types += _list(words, feature)
        elif word.text == "<" and len(words) > 1 and words[1].text == ">":
            feature.short_name = words.pop(0).name
            words.pop(0)
        elif word.text == "about":
            feature.about += [names[-1] for names in _list(words, feature)]
        elif word.kind == "name" and not feature.name and word.text not in _NO_NAMES:
            feature.name = word.name
            while len(words) > 1 and words[0].text == "::":  # of metadata: its qualified name
                words.pop(0)
                feature.name = words.pop(0).name


def _list(words: list[Token], feature: Feature) -> list[list[str]]:
    found = [_qualified(words, feature)]
    while words and words[0].text == ",":
        words.pop(0)
        found.append(_qualified(words, feature))
    return [names for names in found if names]


def _qualified(words: list[Token], feature: Feature) -> list[str]:
    if words and words[0].text == "~":
        words.pop(0)
        feature.conjugated = True
    names: list[str] = []
    while words and words[0].kind == "name":
        names.append(words.pop(0).name)
        if not words or words[0].text not in {"::", "."}:
            break
        words.pop(0)
    return names


def literal(tokens: list[Token] | None) -> Any:  # noqa: ANN401 - a number, text or truth value
    """Return the value of a literal, a unit behind it left out; None for any other expression."""
    words = list(tokens or [])
    if "[" in [word.text for word in words]:
        words = words[: [word.text for word in words].index("[")]
    sign = 1
    if words and words[0].text in {"+", "-"}:
        sign = -1 if words.pop(0).text == "-" else 1
    if len(words) != 1:
        return None
    word = words[0]
    if word.kind == "number":
        return sign * (int(word.text) if word.text.isdigit() else float(word.text))
    if word.kind == "text":
        return word.text[1:-1].replace('\\"', '"').replace("\\\\", "\\")
    return {"true": True, "false": False}.get(word.text)
