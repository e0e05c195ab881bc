"""Statements of SysML v2 as definitions and usages: name, types, multiplicity, value."""

import math
from collections import deque
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from swarmwright.interop.models._sysml_text import DIRECTIONS, PREFIXES, Statement, Word, unescaped

KEYWORDS = frozenset({"attribute", "item", "metadata", "package", "part", "port"})
EXPRESSION = "expression"
"""The keyword of the expression at the end of a body, which has none."""
SILENT = frozenset({"import", "doc", "comment", "alias", "language", "locale", "rep"})
"""Statements without meaning for an experiment."""
LONGEST_NUMBER = 1000
"""Characters: Python does not write integers of more than 4300 digits."""
_RELATIONS = frozenset({"crosses", "defined", "redefines", "references", "specializes", "subsets", "typed"})
"""Words of a usage without a keyword, in the place of signs."""
_EQUALS = frozenset({"=", ":="})
_MODIFIERS = _RELATIONS | {"by", "default", "nonunique", "ordered"}
_TYPED, _SPECIAL = frozenset({":"}), frozenset({":>", "specializes", "subsets"})
_REDEFINED = frozenset({":>>", "redefines"})


@dataclass
class Feature:
    """A definition or a usage."""

    statement: Statement
    keyword: str
    """Of KEYWORDS; empty for a usage without one; `@` for metadata; else a word that is not supported."""
    scope: tuple[str, ...] = ()
    """Path of what it is in the body of."""
    is_definition: bool = False
    """Whether it is a definition, else a usage."""
    direction: str = ""
    """in, out or inout; empty without one."""
    name: str = ""
    """Empty for one without a name."""
    reserved: str = ""
    """A reserved word in the place of the name."""
    short_name: str = ""
    """In angle brackets in front of the name."""
    types: list[list[str]] = field(default_factory=list)
    """Qualified names of its types, and of what it specializes, word by word."""
    conjugated: bool = False
    """Whether the type of a port is conjugated, `~Type`."""
    multiplicity: list[Word] | None = None
    """What is between the brackets; None without them."""
    value: list[Word] | None = None
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

    @cached_property
    def inside(self) -> list["Feature"]:
        """What is in its body."""
        return [feature_of(one, self.path) for one in self.statement.body or []]


def feature_of(statement: Statement, scope: tuple[str, ...] = ()) -> Feature:
    """Return what a statement defines or uses; scope: the path of what it is in the body of."""
    feature = Feature(statement, "", scope)
    if statement.is_result:
        feature.keyword = EXPRESSION
        return feature
    words = deque(statement.words)
    while words and (words[0].text in PREFIXES | DIRECTIONS or words[0].text == "#"):
        word = words.popleft()
        if word.text == "#" and words:
            names = _qualified(words, feature)
            feature.prefixes += names[-1:]
        elif word.text in DIRECTIONS:
            feature.direction = word.text
    first, second = ([one.text for one, _ in zip(words, range(2), strict=False)] + ["", ""])[:2]
    if first == "@" or (first == "metadata" and second != "def"):
        words.popleft()
        feature.keyword = "@"
    elif words and words[0].kind == "keyword" and first not in _RELATIONS:
        feature.keyword = words.popleft().text
    if words and words[0].text == "def":
        words.popleft()
        feature.is_definition = True
    _declaration(feature, words)
    return feature


def _declaration(feature: Feature, words: deque[Word]) -> None:
    """Take name, types, multiplicity and value from the words of a feature."""
    while words and feature.value is None:
        word = words.popleft()
        if word.text in _EQUALS or (word.text == "default" and words and words[0].text not in _EQUALS):
            feature.value = list(words)
        elif word.text == "[":
            feature.multiplicity = _up_to_bracket(words)
        elif word.text in _REDEFINED:
            names = _qualified(words, feature)
            feature.name = feature.name or (names[-1] if names else "")
        elif word.text in _TYPED | _SPECIAL or (word.text == "by" and words):
            feature.types += _list(words, feature)
        elif word.text == "<" and len(words) > 1 and words[1].text == ">":
            feature.short_name = words.popleft().name
            words.popleft()
        elif word.text == "about":
            feature.about += [names[-1] for names in _list(words, feature)]
        elif word.kind == "name" and not feature.name:
            feature.name = word.name
            while len(words) > 1 and words[0].text == "::":  # of metadata: its qualified name
                words.popleft()
                feature.name = words.popleft().name
        elif word.kind == "keyword" and word.text not in _MODIFIERS:
            feature.reserved = feature.reserved or word.text


def _up_to_bracket(words: deque[Word]) -> list[Word]:
    inner: list[Word] = []
    while words and words[0].text != "]":
        inner.append(words.popleft())
    if words:
        words.popleft()
    return inner


def _list(words: deque[Word], feature: Feature) -> list[list[str]]:
    found = [_qualified(words, feature)]
    while words and words[0].text == ",":
        words.popleft()
        found.append(_qualified(words, feature))
    return [names for names in found if names]


def _qualified(words: deque[Word], feature: Feature) -> list[str]:
    if words and words[0].text == "~":
        words.popleft()
        feature.conjugated = True
    names: list[str] = []
    while words and words[0].kind == "name":
        names.append(words.popleft().name)
        if not words or words[0].text not in {"::", "."}:
            break
        words.popleft()
    return names


def literal(tokens: list[Word] | None) -> Any:  # noqa: ANN401 - a number, text or truth value
    """Return the value of a literal, a unit behind it left out.

    None for any other expression, and for numbers that are not finite or have more than `LONGEST_NUMBER`
    characters.
    """
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
        if len(word.text) > LONGEST_NUMBER:
            return None
        number = int(word.text) if word.text.isdigit() else float(word.text)
        return sign * number if isinstance(number, int) or math.isfinite(number) else None
    if word.kind == "text":
        return unescaped(word.text[1:-1])
    return {"true": True, "false": False}.get(word.text)
