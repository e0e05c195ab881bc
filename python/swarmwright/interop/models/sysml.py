"""Models in SysML v2's textual notation (OMG, "Systems Modeling Language", version 2.0): a subset.

Supported are packages, part definitions and usages with multiplicity, attributes with values, ports and
directed features, and the metadata `@Optimize { min = ..; max = ..; scale = ..; }` of attributes and parts.
Names are resolved through packages, imports and aliases.
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
from swarmwright.interop.models._parts import Location, Member, OptimisedParameter, Part, Problems, Property
from swarmwright.interop.models._sysml_text import (
    DIRECTIONS,
    KERML,
    PREFIXES,
    Statement,
    Word,
    parse_statements,
    read_text,
    unescape,
)

KEYWORDS = frozenset({"attribute", "item", "metadata", "package", "part", "port"})
EXPRESSION = "expression"
"""Keyword of a result expression, which has none."""
SILENT = frozenset({"import", "doc", "comment", "alias", "language", "locale", "rep"})
"""Statements that do not matter for an experiment."""
LONGEST_NUMBER = 1000
"""In characters; Python refuses to convert integers of more than 4300 digits."""
_RELATIONS = frozenset({"crosses", "defined", "redefines", "references", "specializes", "subsets", "typed"})
"""Words of a usage without a keyword that replace signs."""
_EQUALS = frozenset({"=", ":="})
_MODIFIERS = _RELATIONS | {"by", "default", "nonunique", "ordered"}
_TYPED, _SPECIAL = frozenset({":"}), frozenset({":>", "specializes", "subsets"})
_REDEFINED = frozenset({":>>", "redefines"})


@dataclass
class Feature:
    """A definition or a usage."""

    statement: Statement
    keyword: str
    """A word of KEYWORDS; empty for a usage without keyword; `@` for metadata; else an unsupported word."""
    scope: tuple[str, ...] = ()
    """Path of the enclosing feature."""
    is_definition: bool = False
    """Whether the feature is a definition and not a usage."""
    direction: str = ""
    """in, out or inout; empty without one."""
    name: str = ""
    """Empty without a name."""
    reserved: str = ""
    """A reserved word used as a name."""
    short_name: str = ""
    """The short name, in angle brackets before the name."""
    types: list[list[str]] = field(default_factory=list)
    """Qualified names of the types and specialized features, word by word."""
    conjugated: bool = False
    """Whether the type of a port is conjugated, `~Type`."""
    multiplicity: list[Word] | None = None
    """The words between the brackets; None without brackets."""
    value: list[Word] | None = None
    """The expression after `=`; None without one."""
    about: list[str] = field(default_factory=list)
    """For metadata: names of the features that it annotates, if it is not in their body."""
    prefixes: list[str] = field(default_factory=list)
    """Metadata before the feature, #Optimize."""

    @property
    def line(self) -> int:
        """Line of its beginning."""
        return self.statement.line

    @property
    def path(self) -> tuple[str, ...]:
        """The path of the scope and its own name; without a name, a unique word."""
        return (*self.scope, self.name or f"#{self.statement.end}")

    @cached_property
    def features(self) -> list["Feature"]:
        """The features in its body."""
        return [parse_feature(statement, self.path) for statement in self.statement.body or []]


def parse_feature(statement: Statement, scope: tuple[str, ...] = ()) -> Feature:
    """Parse a definition or usage; scope: path of the enclosing feature."""
    feature = Feature(statement, "", scope)
    if statement.is_result:
        feature.keyword = EXPRESSION
        return feature
    words = deque(statement.words)
    while words and (words[0].text in PREFIXES | DIRECTIONS or words[0].text == "#"):
        word = words.popleft()
        if word.text == "#" and words:
            names = _take_qualified_name(words, feature)
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
    _parse_declaration(feature, words)
    return feature


def _parse_declaration(feature: Feature, words: deque[Word]) -> None:
    """Parse name, types, multiplicity and value of a feature."""
    while words and feature.value is None:
        word = words.popleft()
        if word.text in _EQUALS or (word.text == "default" and words and words[0].text not in _EQUALS):
            feature.value = list(words)
        elif word.text == "[":
            feature.multiplicity = _take_to_bracket(words)
        elif word.text in _REDEFINED:
            names = _take_qualified_name(words, feature)
            feature.name = feature.name or (names[-1] if names else "")
        elif word.text in _TYPED | _SPECIAL or (word.text == "by" and words):
            feature.types += _take_names(words, feature)
        elif word.text == "<" and len(words) > 1 and words[1].text == ">":
            feature.short_name = words.popleft().name
            words.popleft()
        elif word.text == "about":
            feature.about += [names[-1] for names in _take_names(words, feature)]
        elif word.kind == "name" and not feature.name:
            feature.name = word.name
            while len(words) > 1 and words[0].text == "::":  # the qualified name of metadata
                words.popleft()
                feature.name = words.popleft().name
        elif word.kind == "keyword" and word.text not in _MODIFIERS:
            feature.reserved = feature.reserved or word.text


def _take_to_bracket(words: deque[Word]) -> list[Word]:
    inner: list[Word] = []
    while words and words[0].text != "]":
        inner.append(words.popleft())
    if words:
        words.popleft()
    return inner


def _take_names(words: deque[Word], feature: Feature) -> list[list[str]]:
    names_list = [_take_qualified_name(words, feature)]
    while words and words[0].text == ",":
        words.popleft()
        names_list.append(_take_qualified_name(words, feature))
    return [names for names in names_list if names]


def _take_qualified_name(words: deque[Word], feature: Feature) -> list[str]:
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


def parse_literal(tokens: list[Word] | None) -> Any:  # noqa: ANN401 - a number, text or truth value
    """Return the value of a literal, ignoring its unit.

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
        return unescape(word.text[1:-1])
    return {"true": True, "false": False}.get(word.text)


_LIBRARY = frozenset(
    {"Actions", "Attributes", "Base", "Collections", "Connections", "Flows", "ISQ", "Interfaces", "Items"}
    | {"KerML", "Links", "Metaobjects", "Objects", "Occurrences", "Parts", "Ports", "Quantities", "SI"}
    | {"ScalarValues", "ShapeItems", "SpatialItems", "SysML", "Time", "USCustomaryUnits", "VectorValues"}
)
"""Packages of the standard libraries, which have no sensors or actuators."""
_LIBRARY_NAMES = frozenset(
    {"Anything", "Item", "Object", "Occurrence", "Part", "Port", "items", "objects", "parts", "ports"}
    | {"subitems", "subparts", "subports"}
)
"""Names of the libraries that are often used without the package's name."""
_WITH_MEMBERS = frozenset({"item", "package", "part", "port"})
_MOST_STEPS = 50
"""Largest number of steps over types, imports and aliases to the definition of a member."""

_MOST_STEPS_OF_ALL = 500_000
"""Largest number of steps for all names of a file: about a second."""

Scope = tuple[str, ...]


class TooManyNamesError(Exception):
    """A file has too many imports and names to resolve."""


class Unknown(NamedTuple):
    """A name that cannot be resolved."""

    reason: str


class _Import(NamedTuple):
    names: list[str]
    wildcards: int
    """0: the named feature; 1: all its members; from 2 on: all members at any depth."""


class Names:
    """Resolution of the names of a model.

    Args:
        roots: top-level features.
    """

    def __init__(self, roots: Sequence[Feature]) -> None:
        self._members: dict[Scope, Feature] = {}
        self._imports: dict[Scope, list[_Import]] = {}
        self._aliases: dict[Scope, list[str]] = {}
        self._by_name: dict[str, list[tuple[Scope, Feature]]] = {}
        """Members of all bodies, by name."""
        self._steps = 0
        self._resolved: dict[tuple[Scope, str], Feature | None] = {}
        """Resolved members; None also during the search, since types may form a cycle."""
        self.duplicates: list[tuple[Feature, Feature]] = []
        """Pairs of definitions with the same name in a package: the later and the earlier."""
        for feature in roots:
            self._add(feature)
        for path, feature in self._members.items():
            self._by_name.setdefault(path[-1], []).append((path, feature))

    def _add(self, feature: Feature) -> None:
        if feature.keyword == "import":
            words = _strip_filter(feature.statement.words)
            names = [word.name for word in words if word.kind == "name"]
            wildcards = sum(word.text.count("*") for word in words if word.kind == "sign")
            self._imports.setdefault(feature.scope, []).append(_Import(names, wildcards))
        elif feature.keyword == "alias" and feature.name:
            texts = [word.text for word in feature.statement.words]
            targets = feature.statement.words[texts.index("for") + 1 :] if "for" in texts else []
            self._aliases[*feature.scope, feature.name] = [
                target.name for target in targets if target.kind == "name"
            ]
        elif feature.keyword in KEYWORDS or feature.is_definition or feature.direction:
            for name in filter(None, (feature.name, feature.short_name)):
                before = self._members.setdefault((*feature.scope, name), feature)
                if before is not feature and feature.is_definition and before.is_definition:
                    self.duplicates.append((feature, before))
                elif feature.is_definition:  # a usage with the same name does not hide it
                    self._members[*feature.scope, name] = feature
        if feature.keyword in _WITH_MEMBERS:
            for inner in feature.features:
                self._add(inner)

    def resolve_types(self, feature: Feature) -> Iterator[Feature | Unknown]:
        """Yield the types and specialized features of a feature, except those of the standard libraries."""
        for names in feature.types:
            type_ = self._resolve(names, feature)
            if type_ is not None:
                yield type_
            elif not _is_library_name(names):
                yield Unknown(self._describe_missing(names))

    def _resolve(self, names: Sequence[str], feature: Feature, depth: int = 0) -> Feature | Unknown | None:
        """Resolve a name used in a feature; None if there is no match."""
        for length in range(len(feature.scope), -1, -1):
            member = self._member(feature.scope[:length], names[0], depth)
            if member is not None and member.path != feature.path:
                return self._descend(member, names[1:], depth)
        # In a package that is not imported, if the name is unique.
        namesakes = self._by_name.get(names[-1], [])
        self._step(len(namesakes))
        ends = [element for path, element in namesakes if [*path[-len(names) :]] == [*names]]
        ends = [end for end in ends if end.path != feature.path]
        ends = [end for end in ends if end.is_definition] or ends
        if len(ends) > 1:
            candidates = ", ".join(f"{'::'.join(end.path)} (line {end.line})" for end in ends[:5])
            return Unknown(f"{'::'.join(names)} is ambiguous: {candidates}; write the qualified name")
        return ends[0] if ends else None

    def _descend(self, feature: Feature, names: Sequence[str], depth: int) -> Feature | None:
        member: Feature | None = feature
        for name in names:
            member = None if member is None else self._member(member.path, name, depth)
        return member

    def _member(self, scope: Scope, name: str, depth: int) -> Feature | None:
        """Return the member of a body: own, aliased, imported or inherited; None if there is none."""
        key = (scope, name)
        if key not in self._resolved and depth < _MOST_STEPS:
            self._resolved[key] = None
            self._resolved[key] = self._find_member(scope, name, depth + 1)
        return self._resolved.get(key)

    def _find_member(self, scope: Scope, name: str, depth: int) -> Feature | None:
        own_member = self._members.get((*scope, name))
        if own_member is not None:
            return own_member
        if (*scope, name) in self._aliases:
            return self._resolve_target(scope, self._aliases[*scope, name], depth)
        for imported in self._imports.get(scope, []):
            self._step()
            target = self._resolve_target(scope, imported.names, depth)
            member = None
            if target is not None and not imported.wildcards:
                member = target if imported.names[-1] == name else None
            elif target is not None:
                member = self._member(target.path, name, depth)
                if member is None and imported.wildcards > 1:
                    member = self._find_nested(target.path, name)
            if member is not None:
                return member
        body = self._members.get(scope)
        for names in [] if body is None else body.types:
            base = self._resolve(names, body, depth) if body is not None else None
            member = self._member(base.path, name, depth) if isinstance(base, Feature) else None
            if member is not None:
                return member
        return None

    def _resolve_target(self, scope: Scope, names: Sequence[str], depth: int) -> Feature | None:
        """Resolve the target of an import or an alias in a body; None if there is no match."""
        for length in range(len(scope), -1, -1):
            member = self._members.get((*scope[:length], names[0])) if names else None
            if member is not None:
                return self._descend(member, names[1:], depth)
        return None

    def _find_nested(self, package: Scope, name: str) -> Feature | None:
        namesakes = self._by_name.get(name, [])
        self._step(len(namesakes))
        return next((feature for path, feature in namesakes if path[: len(package)] == package), None)

    def _step(self, number: int = 1) -> None:
        """Count steps. Raises TooManyNamesError beyond the limit for sensible models."""
        self._steps += number
        if self._steps > _MOST_STEPS_OF_ALL:
            raise TooManyNamesError

    def _describe_missing(self, names: Sequence[str]) -> str:
        definitions = {
            name
            for name, members in self._by_name.items()
            if any(feature.is_definition for _, feature in members)
        }
        hint = did_you_mean(names[-1], sorted(definitions)) or "; add its definition"
        qualified_name = "::".join(names if len(names) <= 10 else [*names[:10], ".."])
        return f"{qualified_name} is not defined in this file{hint}"


def _strip_filter(words: Sequence[Word]) -> list[Word]:
    """Return the words of an import without its filter in brackets."""
    texts = [word.text for word in words]
    return list(words[: texts.index("[")] if "[" in texts else words)


def _is_library_name(names: Sequence[str]) -> bool:
    return (
        names[0] in _LIBRARY or names[0].startswith("ISQ") or (len(names) == 1 and names[0] in _LIBRARY_NAMES)
    )


WORDS = "a model in SysML v2's textual notation (part def ..)"
OPTIMIZE = frozenset({"optimize", "optimise"})
"""Names of the metadata of optimised features."""
SUFFIXES = frozenset({KERML, ".sysml"})
SIMULATION = "simulation"
"""Name of the attribute with the simulation's name."""
_BEGIN = re.compile(r"\b(?:package|part|attribute|port)\b")
_MOST_AGENTS = 1_000_000
"""The largest multiplicity of a part."""
_MOST_FEATURES = 10_000
"""The largest multiplicity of a port or a directed feature."""

_LONGEST_INHERITANCE = 100
"""Largest number of steps of inheritance and nesting of parts and ports."""
_MOST_NAMES = 1_000_000
"""Largest number of directed features, inherited features counted for each heir."""
_MOST_IGNORED = 100
"""Largest number of ignored elements that are listed."""

Interface = dict[tuple[str, ...], tuple[str, list[str]]]
"""Path of port and feature names -> direction, `in` or `out`, and the names of the sensors or actuators."""


def recognises(path: Path, text: str) -> bool:
    """Whether a file is a SysML model, by its name or its text."""
    return path.suffix.lower() in SUFFIXES or _BEGIN.search(text) is not None


def load(path: Path) -> Part:
    """Read a model.

    Raises InputError with all problems, each with file and line, and for a model without agents.
    """
    return _part(_Reader(path, read_text(path)))


def with_values(path: Path, value: Callable[[str], Any]) -> str | None:
    """Return the text of a model with optimised values; None if it has no optimised features.

    value: returns the value of a name, None if it was not evolved.
    """
    text = read_text(path)
    reader = _Reader(path, text)
    _part(reader)
    changes: list[tuple[int, int, str]] = []
    for feature in reader.optimised:
        number = value(feature.name)
        if number is None:
            continue
        replacement = f'"{number}"' if isinstance(number, str) else str(number)
        if feature.keyword == "part":
            words = feature.multiplicity or []
            changes.append((words[0].begin, words[-1].end, replacement))
        elif feature.value:
            last = next((i for i, word in enumerate(feature.value) if word.text == "["), len(feature.value))
            changes.append((feature.value[0].begin, feature.value[last - 1].end, replacement))
        else:
            end = feature.statement.words[-1].end
            changes.append((end, end, f" = {replacement}"))
    for begin, end, replacement in sorted(changes, reverse=True):
        text = text[:begin] + replacement + text[end:]
    return text if changes else None


def _part(reader: "_Reader") -> Part:
    try:
        return reader.part()
    except TooManyNamesError:
        raise InputError(
            f"{reader.path}: has too many imports or elements of the same name to resolve names"
        ) from None


class _Reader:
    def __init__(self, path: Path, text: str) -> None:
        self.path = path
        self.roots = [parse_feature(statement) for statement in parse_statements(text, path)]
        self.problems = Problems()
        self.result = Part(path, WORDS)
        self.optimised: list[Feature] = []
        self.names = Names(self.roots)
        self.usages: list[tuple[Feature, tuple[Feature, ...]]] = []
        """Usages of parts, with their enclosing parts."""
        self.about: dict[str, Feature] = {}
        self._ignored: list[str] = []
        self._interfaces: dict[tuple[int, bool], Interface] = {}
        """Cached interfaces, by the `id` of the feature and whether it is conjugated."""
        self._name_count = 0
        self._values: dict[str, Property] = {}
        self._optimised_names: set[str] = set()

    def locate(self, feature: Feature) -> Location:
        return Location(self.path, feature.line, " ".join(filter(None, (feature.keyword, feature.name))))

    def part(self) -> Part:
        for duplicate, first in self.names.duplicates:
            self.problems.add(self.locate(duplicate), f"duplicate definition (first in line {first.line})")
        for feature in self.roots:
            self._collect_metadata(feature)
        self.result.name = next((root.name for root in self.roots if root.keyword == "package"), "")
        for feature in self.roots:
            self._collect_usages(feature, in_port=False, enclosing=())
        self._collect_agents()
        self.problems.stop()
        if not self.result.members:
            raise InputError(
                f"{self.path}: has no agents; add a part with a multiplicity, such as part agents : "
                "Agent[3]; whose definition has ports or directed features (in, out)"
            )
        title_properties = [property_ for property_ in self.result.properties if property_.name == SIMULATION]
        self.result.properties = [
            property_ for property_ in self.result.properties if property_.name != SIMULATION
        ]
        self.result.titles = tuple(
            filter(None, [*(str(element.value) for element in title_properties), self.result.name])
        )
        self.result.sensors = len(self.result.sensor_names) or None
        self.result.actuators = len(self.result.actuator_names) or None
        if self._ignored:
            more = len(self._ignored) - _MOST_IGNORED
            entries = [*self._ignored[:_MOST_IGNORED], *([f"{more} more"] if more > 0 else [])]
            listing = ", ".join(entries)
            self.result.notes.append(f"{self.path}: not imported, including their content: {listing}")
        return self.result

    def _collect_metadata(self, feature: Feature) -> None:
        """Collect metadata outside the features that it annotates."""
        if feature.keyword == "@" and feature.name.lower() in OPTIMIZE:
            self.about.update(dict.fromkeys(feature.about, feature))
        if feature.keyword in {"package", "part", "port"}:
            for inner in feature.features:
                self._collect_metadata(inner)

    def _collect_usages(self, feature: Feature, *, in_port: bool, enclosing: tuple[Feature, ...]) -> None:
        """Collect usages of parts, and attributes with values."""
        if feature.keyword in SILENT or self._is_optimize(feature):
            return
        if feature.keyword and feature.keyword not in KEYWORDS:
            self._ignore(feature)
            return
        if feature.is_definition and feature.keyword != "part":
            return
        if feature.keyword == "item" and not feature.direction:
            self._ignore(feature)
        if feature.keyword == "part" and not feature.is_definition:
            self.usages.append((feature, enclosing))
        if feature.keyword in {"attribute", ""} and not feature.direction and not in_port:
            self._attribute(feature)
        if feature.keyword in {"package", "part"}:
            inner_enclosing = (*enclosing, feature) if feature.keyword == "part" else enclosing
            for inner in feature.features:
                self._collect_usages(inner, in_port=in_port, enclosing=inner_enclosing)

    @staticmethod
    def _is_optimize(feature: Feature) -> bool:
        return feature.keyword == "@" and feature.name.lower() in OPTIMIZE

    def _ignore(self, feature: Feature) -> None:
        words = ["metadata" if feature.keyword == "@" else feature.keyword]
        words += ["def"] if feature.is_definition else []
        name = feature.name if len(feature.name) <= 60 else f"{feature.name[:60]}.."
        words += [name] if name else []
        self._ignored.append(f"{' '.join(words)} in line {feature.line}")

    def _attribute(self, feature: Feature) -> None:
        for inner in feature.features:
            if inner.keyword not in SILENT and not self._is_optimize(inner):
                self._ignore(inner)
        if feature.value is not None and not feature.name:
            word = feature.reserved
            hint = f"; quote the reserved word: '{word}'" if word else ""
            self.problems.add(self.locate(feature), f"has a value, but no name{hint}")
            return
        settings = self._read_optimize(feature)
        if settings is not None:
            self._add_optimised(feature, settings)
            return
        if feature.value is None:
            return
        value = parse_literal(feature.value)
        if value is None:
            self.problems.add(
                self.locate(feature),
                "its value must be a finite number of at most 1000 characters, a string, true or false",
            )
            return
        before = self._values.get(feature.name)
        if before is not None:
            if before.value != value:
                self.problems.add(
                    self.locate(feature),
                    f"is {value}, but {before.value} in line {before.location.line}; keep one",
                )
            return
        self._values[feature.name] = Property(feature.name, value, self.locate(feature))
        self.result.properties.append(self._values[feature.name])

    def _read_optimize(self, feature: Feature) -> dict[str, Any] | None:
        """Return the settings of a feature's @Optimize; None without it."""
        inside = [inner for inner in feature.features if not inner.about]
        for inner in [*inside, *([self.about[feature.name]] if feature.name in self.about else [])]:
            if inner.keyword == "@" and inner.name.lower() in OPTIMIZE:
                settings: dict[str, Any] = {}
                for setting in inner.features:
                    name = setting.name or setting.keyword
                    if name not in {"min", "max", "scale"}:
                        self.problems.add(
                            self.locate(setting), f"unknown key {name!r}; expected min, max, scale"
                        )
                    settings[name] = parse_literal(setting.value)
                return settings
        return {} if any(prefix.lower() in OPTIMIZE for prefix in feature.prefixes) else None

    def _add_optimised(self, feature: Feature, settings: dict[str, Any]) -> None:
        location = self.locate(feature)
        numbers: list[int | float] = []
        for key in ("min", "max"):
            number = settings.get(key)
            if isinstance(number, bool) or not isinstance(number, int | float) or not abs(number) <= 2**24:
                self.problems.add(location, f"@Optimize: {key} is missing or not a number; write {key} = 5;")
            else:
                numbers.append(number)
        scale = settings.get("scale", 1)
        try:
            factor = math.nan if isinstance(scale, bool) or scale is None else float(scale)
        except ValueError:
            factor = math.nan
        if not math.isfinite(factor) or factor <= 0:
            self.problems.add(location, "@Optimize: scale: expected a number above 0, also as a string")
        elif len(numbers) == 2 and not numbers[0] < numbers[1]:
            self.problems.add(
                location, f"@Optimize: max is {numbers[1]}, expected a number above min, {numbers[0]}"
            )
        elif feature.name in self._optimised_names:
            self.problems.add(location, "is optimised twice; remove one @Optimize")
        elif len(numbers) == 2:
            low, high = numbers
            if "Real" in [names[-1] for names in feature.types] or any(
                isinstance(number, float) for number in numbers
            ):
                low, high = float(low), float(high)
            self.optimised.append(feature)
            self._optimised_names.add(feature.name)
            self.result.optimised.append(
                OptimisedParameter(feature.name, low, high, factor, "command_line", location)
            )

    def _collect_agents(self) -> None:
        """Collect agents: parts with sensors or actuators; without any, parts with a multiplicity."""
        interfaces = [self._interface(usage) for usage, _ in self.usages]
        acting = any(any(interface) for interface in interfaces)
        for (usage, enclosing), (sensors, actuators) in zip(self.usages, interfaces, strict=True):
            if acting and not sensors and not actuators:
                continue
            if not acting and usage.multiplicity is None:
                continue
            number = self._count(usage, _MOST_AGENTS)
            if number is None:
                continue
            agent = next((feature for feature in enclosing if any(self._interface(feature))), None)
            if agent is not None:
                self.problems.add(
                    self.locate(usage),
                    f"has sensors or actuators, and so has the enclosing {self.locate(agent).element} (line "
                    f"{agent.line}); declare all of them as ports or directed features of the agent",
                )
            self.result.members.append(
                Member(usage.name, "", number, self.locate(usage), tuple(sensors), tuple(actuators))
            )
            settings = self._read_optimize(usage)
            if settings is not None:
                self._add_optimised(usage, settings)
                if usage.multiplicity is None:
                    self.problems.add(self.locate(usage), "is optimised, but has no multiplicity; add [1]")
        if self.result.has_groups:
            self._name_groups()
        elif self.result.members:
            first = self.result.members[0]
            self.result.sensor_names, self.result.actuator_names = list(first.sensors), list(first.actuators)

    def _name_groups(self) -> None:
        """Report agents with missing or duplicate names, since each kind becomes a named group."""
        lines: dict[str, int] = {}
        for member in self.result.members:
            if not member.name:
                self.problems.add(
                    member.location, "has no name; name each group of agents with different sensors"
                )
            elif member.name in lines:
                self.problems.add(
                    member.location,
                    f"other agents have the same name (line {lines[member.name]}); rename one of them",
                )
            lines.setdefault(member.name, member.location.line)

    def _interface(self, usage: Feature) -> tuple[list[str], list[str]]:
        """Return the names of the sensors and of the actuators of a part."""
        names_by_direction: dict[str, list[str]] = {"in": [], "out": []}
        for direction, names in self._build_interface(usage, flipped=False).values():
            names_by_direction[direction] += names
        return names_by_direction["in"], names_by_direction["out"]

    def _build_interface(self, feature: Feature, *, flipped: bool, depth: int = 0) -> Interface:
        """Return the interface of a feature; its own features may redefine inherited features."""
        key = (id(feature), flipped)
        if key in self._interfaces:
            return self._interfaces[key]
        if depth > _LONGEST_INHERITANCE:
            self.problems.add(
                self.locate(feature), f"inherits through more than {_LONGEST_INHERITANCE} steps"
            )
            return {}
        self._interfaces[key] = {}  # for cycles of inheritance
        interface: Interface = {}
        for base in self.names.resolve_types(feature):
            if isinstance(base, Unknown):
                self.problems.add(self.locate(feature), base.reason)
            else:
                interface |= self._build_interface(
                    base, flipped=flipped != feature.conjugated, depth=depth + 1
                )
        for inner in feature.features:
            if inner.direction in {"in", "out"}:
                direction = {"in": "out", "out": "in"}[inner.direction] if flipped else inner.direction
                interface[inner.path[-1:]] = (direction, self._number_names(inner, inner.name))
            elif inner.direction == "inout":
                self.problems.add(
                    self.locate(inner), "inout is not supported; write in for sensors, out for actuators"
                )
            elif inner.keyword == "port" and not inner.is_definition:
                port = self._build_interface(inner, flipped=flipped, depth=depth + 1)
                times = self._count(inner, _MOST_FEATURES) or 0
                self._count_names(inner, times * sum(len(names) for _, names in port.values()))
                for path, (direction, names) in port.items():
                    numbered = [each for name in names for each in self._number_names(inner, name)]
                    interface[*inner.path[-1:], *path] = (direction, numbered)
        self._count_names(feature, len(interface))
        self._interfaces[key] = interface
        return interface

    def _count_names(self, feature: Feature, number: int) -> None:
        """Raise InputError if all parts together have too many directed features."""
        self._name_count += number
        if self._name_count > _MOST_NAMES:
            raise InputError(
                self.locate(feature).format(
                    f"all parts together have more than {_MOST_NAMES} directed features"
                )
            )

    def _number_names(self, feature: Feature, name: str) -> list[str]:
        """Return the name, numbered if the feature has a multiplicity."""
        number = self._count(feature, _MOST_FEATURES)
        if number is None:
            return []
        return [name] if feature.multiplicity is None else [f"{name} {index}" for index in range(number)]

    def _count(self, feature: Feature, most: int) -> int | None:
        """Return the multiplicity; add a problem and return None if it is not a number."""
        if feature.multiplicity is None:
            return 1
        number = parse_literal(feature.multiplicity)
        if isinstance(number, int) and not isinstance(number, bool) and 1 <= number <= most:
            return number
        text = "".join(word.text for word in feature.multiplicity[:20])[:60]
        if number is None and (".." in text or "*" in text):
            evolved = ", or add @Optimize to evolve the number" if feature.keyword == "part" else ""
            reason = f"its multiplicity [{text}] is a range; write one number, such as [3]{evolved}"
        else:
            reason = f"its multiplicity is {text}, expected a number from 1 to {most}, such as [3]"
        self.problems.add(self.locate(feature), reason)
        return None
