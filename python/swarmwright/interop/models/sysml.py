"""Models in SysML v2's textual notation (OMG, "Systems Modeling Language", version 2.0): a subset.

It reads packages, part definitions and usages with multiplicity, attributes with values, ports and directed
features, and the metadata `@Optimize { min = ..; max = ..; scale = ..; }` of attributes and parts.
"""

import math
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

from swarmwright.common.errors import InputError
from swarmwright.interop.models._parts import Member, Optimised, Part, Place, Problems, Property
from swarmwright.interop.models._sysml_features import KEYWORDS, SILENT, Feature, feature_of, literal
from swarmwright.interop.models._sysml_names import Names, TooManyNamesError, Unknown
from swarmwright.interop.models._sysml_text import KERML, read_text, statements

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
            last = next((i for i, one in enumerate(feature.value) if one.text == "["), len(feature.value))
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
        self.roots = [feature_of(one) for one in statements(text, path)]
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
        self.result.name = next((one.name for one in self.roots if one.keyword == "package"), "")
        for feature in self.roots:
            self._take(feature, in_port=False, around=())
        self._agents()
        self.problems.stop()
        if not self.result.members:
            raise InputError(
                f"{self.path}: has no agents; expected a part with a multiplicity, such as part agents : "
                "Agent[3]; whose definition has ports or directed features (in, out)"
            )
        named = [one for one in self.result.properties if one.name == SIMULATION]
        self.result.properties = [one for one in self.result.properties if one.name != SIMULATION]
        self.result.titles = tuple(filter(None, [*(str(one.value) for one in named), self.result.name]))
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
            for one in feature.inside:
                self._note_metadata(one)

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
            for one in feature.inside:
                self._take(one, in_port=in_port, around=within)

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
        for one in feature.inside:
            if one.keyword not in SILENT and not self._is_optimize(one):
                self._leave_out(one)
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
        inside = [one for one in feature.inside if not one.about]
        for one in [*inside, *([self.about[feature.name]] if feature.name in self.about else [])]:
            if one.keyword == "@" and one.name.lower() in OPTIMIZE:
                found: dict[str, Any] = {}
                for setting in one.inside:
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
            agent = next((one for one in around if any(self._interface(one))), None)
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
