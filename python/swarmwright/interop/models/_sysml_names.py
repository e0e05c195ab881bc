"""Which definition or usage of a model in SysML v2 a name means: by packages, imports and aliases."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

from swarmwright.common.suggestions import did_you_mean
from swarmwright.interop.models._sysml_features import KEYWORDS, Feature
from swarmwright.interop.models._sysml_text import Word

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

Path = tuple[str, ...]


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
        self._members: dict[Path, Feature] = {}
        self._imports: dict[Path, list[_Import]] = {}
        self._aliases: dict[Path, list[str]] = {}
        self._by_name: dict[str, list[tuple[Path, Feature]]] = {}
        """Members of all bodies, by name."""
        self._steps = 0
        self._known: dict[tuple[Path, str], Feature | None] = {}
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
            self._aliases[*feature.scope, feature.name] = [one.name for one in behind if one.kind == "name"]
        elif feature.keyword in KEYWORDS or feature.is_definition or feature.direction:
            for name in filter(None, (feature.name, feature.short_name)):
                before = self._members.setdefault((*feature.scope, name), feature)
                if before is not feature and feature.is_definition and before.is_definition:
                    self.duplicates.append((feature, before))
                elif feature.is_definition:  # a usage with the same name does not hide it
                    self._members[*feature.scope, name] = feature
        if feature.keyword in _WITH_MEMBERS:
            for one in feature.inside:
                self._add(one)

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
        ends = [one for path, one in named if [*path[-len(names) :]] == [*names]]
        ends = [one for one in ends if one.path != feature.path]
        ends = [one for one in ends if one.is_definition] or ends
        if len(ends) > 1:
            shown = ", ".join(f"{'::'.join(one.path)} (line {one.line})" for one in ends[:5])
            return Unknown(f"{'::'.join(names)} may be {shown}; write its qualified name")
        return ends[0] if ends else None

    def _below(self, feature: Feature, names: Sequence[str], depth: int) -> Feature | None:
        found: Feature | None = feature
        for name in names:
            found = None if found is None else self._member(found.path, name, depth)
        return found

    def _member(self, scope: Path, name: str, depth: int) -> Feature | None:
        """Return what has a name in a body: its own, by an alias, imported or inherited; None for nothing."""
        key = (scope, name)
        if key not in self._known and depth < _MOST_STEPS:
            self._known[key] = None
            self._known[key] = self._looked_up(scope, name, depth + 1)
        return self._known.get(key)

    def _looked_up(self, scope: Path, name: str, depth: int) -> Feature | None:
        own = self._members.get((*scope, name))
        if own is not None:
            return own
        if (*scope, name) in self._aliases:
            return self._named_from(scope, self._aliases[*scope, name], depth)
        for one in self._imports.get(scope, []):
            self._step()
            target = self._named_from(scope, one.names, depth)
            found = None
            if target is not None and not one.wildcards:
                found = target if one.names[-1] == name else None
            elif target is not None:
                found = self._member(target.path, name, depth)
                if found is None and one.wildcards > 1:
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

    def _named_from(self, scope: Path, names: Sequence[str], depth: int) -> Feature | None:
        """Return what an import or an alias in a body names; None for nothing."""
        for length in range(len(scope), -1, -1):
            found = self._members.get((*scope[:length], names[0])) if names else None
            if found is not None:
                return self._below(found, names[1:], depth)
        return None

    def _anywhere_in(self, package: Path, name: str) -> Feature | None:
        named = self._by_name.get(name, [])
        self._step(len(named))
        return next((one for path, one in named if path[: len(package)] == package), None)

    def _step(self, number: int = 1) -> None:
        """Count what is looked at. Raises TooManyNamesError when it is more than any sensible model needs."""
        self._steps += number
        if self._steps > _MOST_STEPS_OF_ALL:
            raise TooManyNamesError

    def _missing(self, names: Sequence[str]) -> str:
        known = {name for name, ones in self._by_name.items() if any(one.is_definition for _, one in ones)}
        hint = did_you_mean(names[-1], sorted(known)) or "; add its definition"
        shown = "::".join(names if len(names) <= 10 else [*names[:10], ".."])
        return f"{shown} is not defined in this file{hint}"


def _before_filter(words: Sequence[Word]) -> list[Word]:
    """Return the words of an import without a filter in brackets."""
    texts = [word.text for word in words]
    return list(words[: texts.index("[")] if "[" in texts else words)


def _is_of_library(names: Sequence[str]) -> bool:
    return names[0] in _LIBRARY or names[0].startswith("ISQ") or (len(names) == 1 and names[0] in _OF_LIBRARY)
