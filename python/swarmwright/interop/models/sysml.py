"""Models in SysML v2's textual notation (OMG, "Systems Modeling Language", version 2.0): a subset.

It reads packages, part definitions and usages with multiplicity, attributes with values, ports and directed
features, and the metadata `@Optimize { min = ..; max = ..; scale = ..; }` of attributes and parts.

Statements of SysML v2 as definitions and usages: name, types, multiplicity, value.

Which definition or usage of a model in SysML v2 a name means: by packages, imports and aliases.
"""

import math
import re
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

from swarmwright.common.errors import InputError
from swarmwright.common.suggestions import did_you_mean
from swarmwright.interop.models._parts import Member, Optimised, Part, Place, Problems, Property
from swarmwright.interop.models._sysml_text import (
    DIRECTIONS,
    KERML,
    PREFIXES,
    Statement,
    Word,
    read_text,
    statements,
    unescaped,
)

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
        return [feature_of(statement, self.path) for statement in self.statement.body or []]


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
    first, second = ([token.text for token, _ in zip(words, range(2), strict=False)] + ["", ""])[:2]
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


_LIBRARY = frozenset(
    {"Actions", "Attributes", "Base", "Collections", "Connections", "Flows", "ISQ", "Interfaces", "Items"}
    | {"KerML", "Links", "Metaobjects", "Objects", "Occurrences", "Parts", "Ports", "Quantities", "SI"}
    | {"ScalarValues", "ShapeItems", "SpatialItems", "SysML", "Time", "USCustomaryUnits", "VectorValues"}
)
"""Packages of the standard's libraries, in which nothing senses or acts."""
_OF_LIBRARY = frozenset(
    {"Anything", "Item", "Object", "Occurrence", "Part", "Port", "items", "objects", "parts", "ports"}
    | {"subitems", "subparts", "subports"}
)
"""What is often used of them without the package's name."""
_WITH_MEMBERS = frozenset({"item", "package", "part", "port"})
_MOST_STEPS = 50
"""Steps over types, imports and aliases to where a member is defined."""

_MOST_STEPS_OF_ALL = 500_000
"""Steps for all names of a file: about a second."""

Scope = tuple[str, ...]


class TooManyNamesError(Exception):
    """The imports and names of a file are too many to be looked up."""


class Unknown(NamedTuple):
    """A name that is not found."""

    reason: str


class _Import(NamedTuple):
    names: list[str]
    wildcards: int
    """0: what has this name; else all in it, from 2 on also all in that."""


class Names:
    """What has a name in a model.

    Args:
        roots: everything outside of all packages.
    """

    def __init__(self, roots: Sequence[Feature]) -> None:
        self._members: dict[Scope, Feature] = {}
        self._imports: dict[Scope, list[_Import]] = {}
        self._aliases: dict[Scope, list[str]] = {}
        self._by_name: dict[str, list[tuple[Scope, Feature]]] = {}
        """Members of all bodies, by name."""
        self._steps = 0
        self._known: dict[tuple[Scope, str], Feature | None] = {}
        """Members that were looked for; None also while one is looked for, as types may form a circle."""
        self.duplicates: list[tuple[Feature, Feature]] = []
        """Definitions with a name that another one has in the same package, and this other one."""
        for feature in roots:
            self._add(feature)
        for path, feature in self._members.items():
            self._by_name.setdefault(path[-1], []).append((path, feature))

    def _add(self, feature: Feature) -> None:
        if feature.keyword == "import":
            words = _before_filter(feature.statement.words)
            names = [word.name for word in words if word.kind == "name"]
            wildcards = sum(word.text.count("*") for word in words if word.kind == "sign")
            self._imports.setdefault(feature.scope, []).append(_Import(names, wildcards))
        elif feature.keyword == "alias" and feature.name:
            texts = [word.text for word in feature.statement.words]
            behind = feature.statement.words[texts.index("for") + 1 :] if "for" in texts else []
            self._aliases[*feature.scope, feature.name] = [
                follower.name for follower in behind if follower.kind == "name"
            ]
        elif feature.keyword in KEYWORDS or feature.is_definition or feature.direction:
            for name in filter(None, (feature.name, feature.short_name)):
                before = self._members.setdefault((*feature.scope, name), feature)
                if before is not feature and feature.is_definition and before.is_definition:
                    self.duplicates.append((feature, before))
                elif feature.is_definition:  # a usage with the same name does not hide it
                    self._members[*feature.scope, name] = feature
        if feature.keyword in _WITH_MEMBERS:
            for inner in feature.inside:
                self._add(inner)

    def types_of(self, feature: Feature) -> Iterator[Feature | Unknown]:
        """Yield what a feature is typed by or specializes, without what is in the standard's libraries."""
        for names in feature.types:
            found = self._found(names, feature)
            if found is not None:
                yield found
            elif not _is_of_library(names):
                yield Unknown(self._missing(names))

    def _found(self, names: Sequence[str], feature: Feature, depth: int = 0) -> Feature | Unknown | None:
        """Return what a name in a feature means; None for nothing."""
        for length in range(len(feature.scope), -1, -1):
            found = self._member(feature.scope[:length], names[0], depth)
            if found is not None and found.path != feature.path:
                return self._below(found, names[1:], depth)
        # In a package that is not imported, where no other has this name.
        named = self._by_name.get(names[-1], [])
        self._step(len(named))
        ends = [element for path, element in named if [*path[-len(names) :]] == [*names]]
        ends = [end for end in ends if end.path != feature.path]
        ends = [end for end in ends if end.is_definition] or ends
        if len(ends) > 1:
            shown = ", ".join(f"{'::'.join(end.path)} (line {end.line})" for end in ends[:5])
            return Unknown(f"{'::'.join(names)} may be {shown}; write its qualified name")
        return ends[0] if ends else None

    def _below(self, feature: Feature, names: Sequence[str], depth: int) -> Feature | None:
        found: Feature | None = feature
        for name in names:
            found = None if found is None else self._member(found.path, name, depth)
        return found

    def _member(self, scope: Scope, name: str, depth: int) -> Feature | None:
        """Return what has a name in a body: its own, by an alias, imported or inherited; None for nothing."""
        key = (scope, name)
        if key not in self._known and depth < _MOST_STEPS:
            self._known[key] = None
            self._known[key] = self._looked_up(scope, name, depth + 1)
        return self._known.get(key)

    def _looked_up(self, scope: Scope, name: str, depth: int) -> Feature | None:
        own = self._members.get((*scope, name))
        if own is not None:
            return own
        if (*scope, name) in self._aliases:
            return self._named_from(scope, self._aliases[*scope, name], depth)
        for imported in self._imports.get(scope, []):
            self._step()
            target = self._named_from(scope, imported.names, depth)
            found = None
            if target is not None and not imported.wildcards:
                found = target if imported.names[-1] == name else None
            elif target is not None:
                found = self._member(target.path, name, depth)
                if found is None and imported.wildcards > 1:
                    found = self._anywhere_in(target.path, name)
            if found is not None:
                return found
        body = self._members.get(scope)
        for names in [] if body is None else body.types:
            base = self._found(names, body, depth) if body is not None else None
            found = self._member(base.path, name, depth) if isinstance(base, Feature) else None
            if found is not None:
                return found
        return None

    def _named_from(self, scope: Scope, names: Sequence[str], depth: int) -> Feature | None:
        """Return what an import or an alias in a body names; None for nothing."""
        for length in range(len(scope), -1, -1):
            found = self._members.get((*scope[:length], names[0])) if names else None
            if found is not None:
                return self._below(found, names[1:], depth)
        return None

    def _anywhere_in(self, package: Scope, name: str) -> Feature | None:
        named = self._by_name.get(name, [])
        self._step(len(named))
        return next((feature for path, feature in named if path[: len(package)] == package), None)

    def _step(self, number: int = 1) -> None:
        """Count what is looked at. Raises TooManyNamesError when it is more than any sensible model needs."""
        self._steps += number
        if self._steps > _MOST_STEPS_OF_ALL:
            raise TooManyNamesError

    def _missing(self, names: Sequence[str]) -> str:
        known = {
            name for name, ones in self._by_name.items() if any(feature.is_definition for _, feature in ones)
        }
        hint = did_you_mean(names[-1], sorted(known)) or "; add its definition"
        shown = "::".join(names if len(names) <= 10 else [*names[:10], ".."])
        return f"{shown} is not defined in this file{hint}"


def _before_filter(words: Sequence[Word]) -> list[Word]:
    """Return the words of an import without a filter in brackets."""
    texts = [word.text for word in words]
    return list(words[: texts.index("[")] if "[" in texts else words)


def _is_of_library(names: Sequence[str]) -> bool:
    return names[0] in _LIBRARY or names[0].startswith("ISQ") or (len(names) == 1 and names[0] in _OF_LIBRARY)


WORDS = "a model in SysML v2's textual notation (part def ..)"
OPTIMIZE = frozenset({"optimize", "optimise"})
"""Names of the metadata of what is optimised."""
SUFFIXES = frozenset({KERML, ".sysml"})
SIMULATION = "simulation"
"""Name of the attribute with the simulation's name."""
_BEGIN = re.compile(r"\b(?:package|part|attribute|port)\b")
_MOST_AGENTS = 1_000_000
"""The largest multiplicity of a part."""
_MOST_FEATURES = 10_000
"""The largest multiplicity of a port or a directed feature."""

_LONGEST_INHERITANCE = 100
"""Steps from a part or a port to what it inherits from, and those inside of each other."""
_MOST_NAMES = 1_000_000
"""Directed features, inherited ones counted for each that inherits them."""
_MOST_LEFT_OUT = 100
"""Elements that are named of those that are left out."""

Interface = dict[tuple[str, ...], tuple[str, list[str]]]
"""Directed features by the names of the ports around them and their own: `in` or `out`, and the names of the
sensors or actuators."""


def recognises(path: Path, text: str) -> bool:
    """Whether a file is such a model, by its name or its text."""
    return path.suffix.lower() in SUFFIXES or _BEGIN.search(text) is not None


def load(path: Path) -> Part:
    """Read a model.

    Raises InputError with everything that is wrong, file and line each, and when it has no agents.
    """
    return _part(_Reader(path, read_text(path)))


def with_values(path: Path, value: Callable[[str], Any]) -> str | None:
    """Return the text of a model with values of what was optimised; None where it has none of it.

    value: returns the value of a name, None for what was not evolved.
    """
    text = read_text(path)
    reader = _Reader(path, text)
    _part(reader)
    changes: list[tuple[int, int, str]] = []
    for feature in reader.optimised:
        number = value(feature.name)
        if number is None:
            continue
        written = f'"{number}"' if isinstance(number, str) else str(number)
        if feature.keyword == "part":
            words = feature.multiplicity or []
            changes.append((words[0].begin, words[-1].end, written))
        elif feature.value:
            last = next((i for i, word in enumerate(feature.value) if word.text == "["), len(feature.value))
            changes.append((feature.value[0].begin, feature.value[last - 1].end, written))
        else:
            end = feature.statement.words[-1].end
            changes.append((end, end, f" = {written}"))
    for begin, end, written in sorted(changes, reverse=True):
        text = text[:begin] + written + text[end:]
    return text if changes else None


def _part(reader: "_Reader") -> Part:
    try:
        return reader.part()
    except TooManyNamesError:
        raise InputError(
            f"{reader.path}: has too many imports, or too many elements of one name, to find what names mean"
        ) from None


class _Reader:
    def __init__(self, path: Path, text: str) -> None:
        self.path = path
        self.roots = [feature_of(statement) for statement in statements(text, path)]
        self.problems = Problems()
        self.result = Part(path, WORDS)
        self.optimised: list[Feature] = []
        self.names = Names(self.roots)
        self.usages: list[tuple[Feature, tuple[Feature, ...]]] = []
        """Of parts, each with the parts around it."""
        self.about: dict[str, Feature] = {}
        self._left_out: list[str] = []
        self._directed_in: dict[tuple[int, bool], Interface] = {}
        """What is directed in features, by their `id`, and whether it is conjugated."""
        self._names_made = 0
        self._values: dict[str, Property] = {}
        self._names_of_optimised: set[str] = set()

    def place(self, feature: Feature) -> Place:
        return Place(self.path, feature.line, " ".join(filter(None, (feature.keyword, feature.name))))

    def part(self) -> Part:
        for again, first in self.names.duplicates:
            self.problems.add(self.place(again), f"duplicate definition (first in line {first.line})")
        for feature in self.roots:
            self._note_metadata(feature)
        self.result.name = next((root.name for root in self.roots if root.keyword == "package"), "")
        for feature in self.roots:
            self._take(feature, in_port=False, around=())
        self._agents()
        self.problems.stop()
        if not self.result.members:
            raise InputError(
                f"{self.path}: has no agents; expected a part with a multiplicity, such as part agents : "
                "Agent[3]; whose definition has ports or directed features (in, out)"
            )
        named = [property_ for property_ in self.result.properties if property_.name == SIMULATION]
        self.result.properties = [
            property_ for property_ in self.result.properties if property_.name != SIMULATION
        ]
        self.result.titles = tuple(
            filter(None, [*(str(element.value) for element in named), self.result.name])
        )
        self.result.sensors = len(self.result.sensor_names) or None
        self.result.actuators = len(self.result.actuator_names) or None
        if self._left_out:
            more = len(self._left_out) - _MOST_LEFT_OUT
            shown = [*self._left_out[:_MOST_LEFT_OUT], *([f"{more} more"] if more > 0 else [])]
            left_out = ", ".join(shown)
            self.result.notes.append(f"{self.path}: not taken over, with all inside: {left_out}")
        return self.result

    def _note_metadata(self, feature: Feature) -> None:
        """Note metadata that stands elsewhere than in what it is about."""
        if feature.keyword == "@" and feature.name.lower() in OPTIMIZE:
            self.about.update(dict.fromkeys(feature.about, feature))
        if feature.keyword in {"package", "part", "port"}:
            for inner in feature.inside:
                self._note_metadata(inner)

    def _take(self, feature: Feature, *, in_port: bool, around: tuple[Feature, ...]) -> None:
        """Collect usages of parts, and attributes with values."""
        if feature.keyword in SILENT or self._is_optimize(feature):
            return
        if feature.keyword and feature.keyword not in KEYWORDS:
            self._leave_out(feature)
            return
        if feature.is_definition and feature.keyword != "part":
            return
        if feature.keyword == "item" and not feature.direction:
            self._leave_out(feature)
        if feature.keyword == "part" and not feature.is_definition:
            self.usages.append((feature, around))
        if feature.keyword in {"attribute", ""} and not feature.direction and not in_port:
            self._attribute(feature)
        if feature.keyword in {"package", "part"}:
            within = (*around, feature) if feature.keyword == "part" else around
            for inner in feature.inside:
                self._take(inner, in_port=in_port, around=within)

    @staticmethod
    def _is_optimize(feature: Feature) -> bool:
        return feature.keyword == "@" and feature.name.lower() in OPTIMIZE

    def _leave_out(self, feature: Feature) -> None:
        words = ["metadata" if feature.keyword == "@" else feature.keyword]
        words += ["def"] if feature.is_definition else []
        name = feature.name if len(feature.name) <= 60 else f"{feature.name[:60]}.."
        words += [name] if name else []
        self._left_out.append(f"{' '.join(words)} in line {feature.line}")

    def _attribute(self, feature: Feature) -> None:
        for inner in feature.inside:
            if inner.keyword not in SILENT and not self._is_optimize(inner):
                self._leave_out(inner)
        if feature.value is not None and not feature.name:
            word = feature.reserved
            hint = f"; {word} is a reserved word: write '{word}', in quotation marks" if word else ""
            self.problems.add(self.place(feature), f"has a value, but no name{hint}")
            return
        settings = self._optimize(feature)
        if settings is not None:
            self._optimise(feature, settings)
            return
        if feature.value is None:
            return
        value = literal(feature.value)
        if value is None:
            self.problems.add(
                self.place(feature),
                "its value is not a number (finite, of at most 1000 characters), a text, true or false",
            )
            return
        before = self._values.get(feature.name)
        if before is not None:
            if before.value != value:
                self.problems.add(
                    self.place(feature),
                    f"is {value}, but {before.value} in line {before.place.line}; keep one",
                )
            return
        self._values[feature.name] = Property(feature.name, value, self.place(feature))
        self.result.properties.append(self._values[feature.name])

    def _optimize(self, feature: Feature) -> dict[str, Any] | None:
        """Return what the metadata of a feature says; None without such metadata."""
        inside = [inner for inner in feature.inside if not inner.about]
        for inner in [*inside, *([self.about[feature.name]] if feature.name in self.about else [])]:
            if inner.keyword == "@" and inner.name.lower() in OPTIMIZE:
                found: dict[str, Any] = {}
                for setting in inner.inside:
                    name = setting.name or setting.keyword
                    if name not in {"min", "max", "scale"}:
                        self.problems.add(
                            self.place(setting), f"unknown key {name!r}; expected min, max, scale"
                        )
                    found[name] = literal(setting.value)
                return found
        return {} if any(prefix.lower() in OPTIMIZE for prefix in feature.prefixes) else None

    def _optimise(self, feature: Feature, settings: dict[str, Any]) -> None:
        place = self.place(feature)
        numbers: list[int | float] = []
        for key in ("min", "max"):
            number = settings.get(key)
            if isinstance(number, bool) or not isinstance(number, int | float) or not abs(number) <= 2**24:
                self.problems.add(place, f"@Optimize: {key} is missing or no number; write {key} = 5;")
            else:
                numbers.append(number)
        scale = settings.get("scale", 1)
        try:
            factor = math.nan if isinstance(scale, bool) or scale is None else float(scale)
        except ValueError:
            factor = math.nan
        if not math.isfinite(factor) or factor <= 0:
            self.problems.add(place, "@Optimize: scale: expected a number above 0, or text with one")
        elif len(numbers) == 2 and not numbers[0] < numbers[1]:
            self.problems.add(
                place, f"@Optimize: max is {numbers[1]}, expected a number above min, {numbers[0]}"
            )
        elif feature.name in self._names_of_optimised:
            self.problems.add(place, "is optimised twice; keep one")
        elif len(numbers) == 2:
            low, high = numbers
            if "Real" in [names[-1] for names in feature.types] or any(
                isinstance(number, float) for number in numbers
            ):
                low, high = float(low), float(high)
            self.optimised.append(feature)
            self._names_of_optimised.add(feature.name)
            self.result.optimised.append(Optimised(feature.name, low, high, factor, "command_line", place))

    def _agents(self) -> None:
        """Take the usages of parts that sense or act; where none does, those with a multiplicity."""
        interfaces = [self._interface(usage) for usage, _ in self.usages]
        acting = any(any(interface) for interface in interfaces)
        for (usage, around), (sensors, actuators) in zip(self.usages, interfaces, strict=True):
            if acting and not sensors and not actuators:
                continue
            if not acting and usage.multiplicity is None:
                continue
            number = self._count(usage, _MOST_AGENTS)
            if number is None:
                continue
            agent = next((feature for feature in around if any(self._interface(feature))), None)
            if agent is not None:
                self.problems.add(
                    self.place(usage),
                    f"senses or acts, and is inside of {self.place(agent).what} (line {agent.line}), which "
                    "does so too; write what agents sense and do as ports or directed features of their own",
                )
            self.result.members.append(
                Member(usage.name, "", number, self.place(usage), tuple(sensors), tuple(actuators))
            )
            settings = self._optimize(usage)
            if settings is not None:
                self._optimise(usage, settings)
                if usage.multiplicity is None:
                    self.problems.add(self.place(usage), "is optimised, but has no multiplicity; write [1]")
        if self.result.differ:
            self._name_groups()
        elif self.result.members:
            first = self.result.members[0]
            self.result.sensor_names, self.result.actuator_names = list(first.sensors), list(first.actuators)

    def _name_groups(self) -> None:
        """Note agents without a name, or with the same one: each kind is a group with its name."""
        lines: dict[str, int] = {}
        for member in self.result.members:
            if not member.name:
                self.problems.add(member.place, "has no name; groups of agents with other sensors need one")
            elif member.name in lines:
                self.problems.add(
                    member.place, f"is the name of other agents, too (line {lines[member.name]}); rename one"
                )
            lines.setdefault(member.name, member.place.line)

    def _interface(self, usage: Feature) -> tuple[list[str], list[str]]:
        """Return the names of the sensors and of the actuators of a part."""
        found: dict[str, list[str]] = {"in": [], "out": []}
        for way, names in self._directed(usage, flipped=False).values():
            found[way] += names
        return found["in"], found["out"]

    def _directed(self, feature: Feature, *, flipped: bool, depth: int = 0) -> Interface:
        """Return what is directed in a feature: inherited first, then its own, which may redefine that."""
        key = (id(feature), flipped)
        if key in self._directed_in:
            return self._directed_in[key]
        if depth > _LONGEST_INHERITANCE:
            self.problems.add(self.place(feature), f"inherits over more than {_LONGEST_INHERITANCE} steps")
            return {}
        self._directed_in[key] = {}  # of what inherits from itself
        found: Interface = {}
        for one in self.names.types_of(feature):
            if isinstance(one, Unknown):
                self.problems.add(self.place(feature), one.reason)
            else:
                found |= self._directed(one, flipped=flipped != feature.conjugated, depth=depth + 1)
        for one in feature.inside:
            if one.direction in {"in", "out"}:
                way = {"in": "out", "out": "in"}[one.direction] if flipped else one.direction
                found[one.path[-1:]] = (way, self._named(one, one.name))
            elif one.direction == "inout":
                self.problems.add(
                    self.place(one), "inout is not supported; write in for what is sensed, out else"
                )
            elif one.keyword == "port" and not one.is_definition:
                inner = self._directed(one, flipped=flipped, depth=depth + 1)
                times = self._count(one, _MOST_FEATURES) or 0
                self._count_names(one, times * sum(len(names) for _, names in inner.values()))
                for path, (way, names) in inner.items():
                    numbered = [each for name in names for each in self._named(one, name)]
                    found[*one.path[-1:], *path] = (way, numbered)
        self._count_names(feature, len(found))
        self._directed_in[key] = found
        return found

    def _count_names(self, feature: Feature, number: int) -> None:
        """Raise InputError where all parts together have more directed features than any sensible model."""
        self._names_made += number
        if self._names_made > _MOST_NAMES:
            raise InputError(
                self.place(feature).says(f"all parts together have more than {_MOST_NAMES} directed features")
            )

    def _named(self, feature: Feature, name: str) -> list[str]:
        """Return a name, numbered where the feature around it has a multiplicity."""
        number = self._count(feature, _MOST_FEATURES)
        if number is None:
            return []
        return [name] if feature.multiplicity is None else [f"{name} {index}" for index in range(number)]

    def _count(self, feature: Feature, most: int) -> int | None:
        """Return how many there are; None, and a problem, where that is not a number."""
        if feature.multiplicity is None:
            return 1
        number = literal(feature.multiplicity)
        if isinstance(number, int) and not isinstance(number, bool) and 1 <= number <= most:
            return number
        text = "".join(word.text for word in feature.multiplicity[:20])[:60]
        if number is None and (".." in text or "*" in text):
            evolved = ", or add @Optimize for a number that is evolved" if feature.keyword == "part" else ""
            reason = f"its multiplicity [{text}] is a range; write one number, such as [3]{evolved}"
        else:
            reason = f"its multiplicity is {text}, expected a number from 1 to {most}, such as [3]"
        self.problems.add(self.place(feature), reason)
        return None
