"""Sections and entries of FREVO's files, and the FREVO classes that can be converted."""

import json
import math
import re
import struct
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from os import PathLike
from pathlib import Path, PureWindowsPath
from typing import Any, cast

import numpy as np

from swarmwright.common.arguments import check_arguments
from swarmwright.common.errors import InputError
from swarmwright.common.files import first_character, read_bytes
from swarmwright.common.suggestions import did_you_mean
from swarmwright.common.xml import Element, read, root_of
from swarmwright.experiment.parameter_files import read_object
from swarmwright.simulations import catalogue

SECTIONS = ("problem", "method", "representation", "ranking")
"""Sections of a session; each names the class of a component."""

_TO_FILL_IN = re.compile("-[A-Z_]+-")
"""The placeholder of a value in the templates of FREVO's evaluation scripts."""
_MOST_NODES = 10_000
_DIGITS = len(str(_MOST_NODES))
"""Largest number of digits of a count; Python refuses to parse numbers with thousands of digits."""
_ROOT = "frevo"
"""The root element."""


@dataclass
class Section:
    """A section with entries by key.

    The methods `take_*` read an entry, or FREVO's default if it is missing, and mark it as used.
    """

    name: str
    element: Element
    entries: dict[str, Element] = field(default_factory=dict)
    used_keys: set[str] = field(default_factory=set)
    unfilled: list[str] = field(default_factory=list)
    """Keys with a placeholder of a template, such as `-SEED-`, whose default was used."""

    @property
    def class_name(self) -> str:
        """FREVO's class."""
        return self.element.attribute("class")

    def take_raw(self, key: str, default: str = "") -> str:
        """Return the value of an entry as written in the file, or the default instead of a placeholder."""
        self.used_keys.add(key)
        if key not in self.entries:
            return default
        value = self.entries[key].attribute("value")
        if default and _TO_FILL_IN.fullmatch(value):
            if key not in self.unfilled:
                self.unfilled.append(key)
            return default
        return value

    def error(self, key: str, message: str) -> InputError:
        """Return an error about an entry."""
        element = self.entries.get(key, self.element)
        return InputError(f"{element.file}:{element.line}: {self.name}.{key}: {message}")

    def take_text(self, key: str, default: str, choices: tuple[str, ...] = ()) -> str:
        """Return a text, which must be one of the choices if there are any."""
        text = self.take_raw(key, default).strip()
        if choices and text not in choices:
            raise self.error(
                key, f"{text!r} found, expected one of {', '.join(choices)}{did_you_mean(text, choices)}"
            )
        return text

    def take_integer(self, key: str, default: int, least: int = -(2**63)) -> int:
        """Return an integer of at least `least`."""
        text = self.take_raw(key, str(default)).strip()
        try:
            value = int(text)
        except ValueError:
            raise self.error(key, f"{text!r} found, expected a whole number") from None
        if value < least:
            raise self.error(key, f"{value} found, expected a whole number of at least {least}")
        return value

    def take_number(self, key: str, default: float) -> float:
        """Return a finite number; Java's `0.15f` is 0.15."""
        text = self.take_raw(key, str(default)).strip()
        value = parse_java_number(text)
        if value is None:
            raise self.error(key, f"{text!r} found, expected a number such as 0.15f")
        return value

    def take_flag(self, key: str, default: bool) -> bool:
        """Return true or false."""
        return self.take_text(key, str(default).lower(), ("true", "false")) == "true"

    @property
    def unused_keys(self) -> list[str]:
        """Keys that were not read, in the order of the file."""
        return [key for key in self.entries if key not in self.used_keys]


@dataclass(frozen=True)
class Session:
    """A FREVO file: a session, and in a result file its populations.

    Sections are read on access, which raises InputError if a section is missing or malformed.
    """

    path: Path
    root: Element

    @cached_property
    def config(self) -> Section:
        """Name, seed and number of runs; without entries if the file has no such section."""
        if not self.root.find_all("sessionconfig"):
            return Section("sessionconfig", self.root)
        return _section(self.root, "sessionconfig", "configentry")

    @cached_property
    def problem(self) -> Section:
        """The problem on which candidates are evaluated."""
        return _section(self.root, "problem", "problementry")

    @cached_property
    def method(self) -> Section:
        """The method that evolves candidates."""
        return _section(self.root, "method", "methodentry")

    @cached_property
    def representation(self) -> Section:
        """The representation of candidates."""
        return _section(self.root, "representation", "representationentry")

    @cached_property
    def ranking(self) -> Section:
        """The ranking of candidates."""
        return _section(self.root, "ranking", "rankingentry")


def parse_java_number(text: str) -> float | None:
    """Parse a text as Java's Float.parseFloat does; None if the result is not a finite number."""
    text = text.strip()
    if text[-1:] in {"f", "F", "d", "D"}:
        text = text[:-1]
    try:
        value = float(text) if "_" not in text else math.nan
    except ValueError:
        return None
    return value if math.isfinite(value) else None


def is_single(value: float) -> bool:
    """Return whether a number is finite after rounding to binary32."""
    with np.errstate(over="ignore"):
        return bool(np.isfinite(np.float32(value)))


def read_number(element: Element, name: str) -> float:
    """Return an attribute that is finite after rounding to binary32. Raises InputError for others."""
    text = element.attribute(name)
    value = parse_java_number(text)
    if value is None or not is_single(value):
        raise element.error(f"{name} {text[:40]!r} found, expected a finite number")
    return value


def read_count(element: Element, name: str) -> int:
    """Return an attribute that is a count or an index of nodes. Raises InputError for others."""
    text = element.attribute(name)
    digits = text.lstrip("0") if text.isascii() and text.isdigit() else "x"
    if digits == "x" or len(digits) > _DIGITS or int(digits or 0) > _MOST_NODES:
        raise element.error(f"{name} {text[:40]!r} found, expected a whole number of at most {_MOST_NODES}")
    return int(digits or 0)


def iterate_members(root: Element) -> Iterator[Element]:
    """Yield the members of the populations of a result file, in file order; nothing for a session."""
    for element in root.children:
        if element.tag == "population":
            yield from element.children
        elif element.tag == "populations":
            for population in element.find_all("population"):
                yield from population.children


@check_arguments
def is_session(path: str | PathLike[str]) -> bool:
    """Return whether a file is a FREVO session or result. Raises InputError if it cannot be read."""
    file = Path(path)
    return first_character(file) == "<" and root_of(file).tag == _ROOT


def open_session(path: Path) -> Session:
    """Read a session or result file. Raises InputError, with file and line, for other files."""
    root = read(path)
    if root.tag != _ROOT:
        raise root.error("unknown root element; expected <frevo> of a session (.zse) or result (.zre)")
    return Session(path, root)


def _section(root: Element, name: str, entry: str) -> Section:
    section = Section(name, root.find_one(name))
    for element in section.element.children:
        if element.tag != entry:
            raise element.error(f"found inside <{name}>; expected <{entry}>")
        key = element.attribute("key")
        element.attribute("value")
        if key in section.entries:
            first = section.entries[key].line
            raise element.error(f"duplicate key {key} (first in line {first}); keep one")
        section.entries[key] = element
    return section


EMERGENCY_EXIT = "emergencyexit.EmergencyExit"
MESHED = "fullyMeshedNet.FullyMeshedNet"
COMPLETE = "completeNetwork.CompleteNetwork"
THREE_LAYERS = "threeLayerNetwork.ThreeLayerNetwork"
LAYERS = "multiLayerNetwork.MultiLayerNetwork"
MACHINE = "fsm.MealyFSM"
HEBBIAN = "hebbNet.HebbNet"
NEAT = "neat.NEAT"
NNGA, CEA2D, PSO = "nnga.NNGA", "CEA2D.CEA2D", "pso.PSO"
GA_SPECIES, CUCKOO_SEARCH = "gaspecies.GASpecies", "frevo.cuckoosearch.CuckooSearch"
NOVELTY_SEARCH = "fehervari.noveltysearch.NoveltySearch"
NOVELTY_SPECIES = "fehervari.noveltyspecies.NoveltySpecies"
NOVELTY_RANKING = "fehervari.noveltyranking.NoveltyRanking"
RANDOM_SEARCH = "frevo.method.randomsearch.RandomSearch"
ABSOLUTE = "AbsoluteRanking.AbsoluteRanking"
FULL_TOURNAMENT, SWISS = "fulltournament.FullTournament", "swissSystem.SwissSystem"
MULTI_SWISS, MULTI_SORT = "MultiSwiss.MultiSwiss", "MultiSort.MultiSort"

SUPPORTED = {
    "problem": (EMERGENCY_EXIT,),
    "method": (NNGA, CEA2D, PSO, RANDOM_SEARCH, GA_SPECIES, CUCKOO_SEARCH, NOVELTY_SEARCH, NOVELTY_SPECIES),
    "representation": (MESHED, COMPLETE, THREE_LAYERS, LAYERS, MACHINE, HEBBIAN, NEAT),
    "ranking": (ABSOLUTE, FULL_TOURNAMENT, SWISS, MULTI_SWISS, MULTI_SORT, NOVELTY_RANKING),
}
"""Classes of each section that have a counterpart in Swarmwright."""

OPTIONS = {
    "problem": ("simulation", "a simulation"),
    "method": ("method", "a method"),
    "representation": ("controller", "a controller"),
    "ranking": ("ranking", "a ranking"),
}
"""For each section, the option that replaces the component, and what the option names."""


def check(section: Section, *, replaceable: bool) -> None:
    """Raise InputError if the component of a section has no counterpart in Swarmwright.

    replaceable: whether an option can replace the component; the message then names the option.
    """
    supported = SUPPORTED[section.name]
    if section.class_name in supported:
        return
    option, replacement = OPTIONS[section.name]
    remedy = f", or replace it by {replacement} with --{option}" if replaceable else ""
    raise section.element.error(
        f"the class {section.class_name!r} has no counterpart in Swarmwright"
        f"{did_you_mean(section.class_name, supported)}; use {_join_names(supported)}{remedy}"
    )


def run_all(*steps: Callable[[], None]) -> None:
    """Run all steps; raise a single InputError with the problems of all steps, a line each."""
    problems = []
    for step in steps:
        try:
            step()
        except InputError as error:
            problems.append(str(error))
    if problems:
        raise InputError("\n".join(dict.fromkeys(problems)))


def _join_names(names: Sequence[str]) -> str:
    *most, last = names
    return f"{', '.join(most)} or {last}" if most else last


_NULL, _REFERENCE, _CLASS, _OBJECT, _STRING, _ARRAY, _END = 0x70, 0x71, 0x72, 0x73, 0x74, 0x75, 0x78
_FIRST_HANDLE = 0x7E0000
_SERIALIZABLE = 0x02
_LARGEST_FILE_BYTES = 1 << 27  # bytes


class _UnreadableError(Exception):
    """A problem in a serialized Java object."""


@dataclass
class _Class:
    name: str
    fields: list[tuple[str, str]] = field(default_factory=list)
    """Type code and name."""


class _Stream:
    def __init__(self, data: bytes) -> None:
        self._data = data
        self._at = 0
        self._handles: list[Any] = []

    def take(self, form: str) -> int:
        size = struct.calcsize(form)
        if self._at + size > len(self._data):
            raise _UnreadableError("the file is truncated")
        (value,) = struct.unpack_from(form, self._data, self._at)
        self._at += size
        return cast("int", value)

    def text(self) -> str:
        length = self.take(">H")
        raw = self._data[self._at : self._at + length]
        self._at += length
        return raw.decode("utf-8", "replace")

    def content(self) -> Any:  # noqa: ANN401 - null, text, array or object
        code = self.take(">B")
        if code == _NULL:
            return None
        if code == _REFERENCE:
            index = self.take(">I") - _FIRST_HANDLE
            if not 0 <= index < len(self._handles):
                raise _UnreadableError("a reference has no target")
            return self._handles[index]
        if code == _STRING:
            text = self.text()
            self._handles.append(text)
            return text
        if code == _CLASS:
            return self._class()
        if code == _ARRAY:
            return self._array()
        if code == _OBJECT:
            return self._object()
        raise _UnreadableError(f"{code:#04x} found at byte {self._at - 1}, which is not part of a field")

    def start(self) -> Any:  # noqa: ANN401 - the first content
        if (self.take(">H"), self.take(">H")) != (0xACED, 5):
            raise _UnreadableError("it does not begin with the header of a serialized Java object")
        return self.content()

    def _class(self) -> _Class:
        described = _Class(self.text())
        self.take(">q")
        self._handles.append(described)
        if self.take(">B") != _SERIALIZABLE:
            raise _UnreadableError(f"the class {described.name} has a custom serialization")
        for _ in range(self.take(">H")):
            code = chr(self.take(">B"))
            described.fields.append((code, self.text()))
            if code in "[L":
                self.content()  # the name of the type
        if self.take(">B") != _END or self.content() is not None:
            raise _UnreadableError(f"the class {described.name} has a base class")
        return described

    def _read_class_description(self) -> _Class:
        described = self.content()
        if not isinstance(described, _Class):
            raise _UnreadableError("a class is missing")
        return described

    def _array(self) -> list[Any]:
        described = self._read_class_description()
        items: list[Any] = []
        self._handles.append(items)
        if not described.name.startswith("[L"):
            raise _UnreadableError(f"a field has no arrays of type {described.name}")
        items.extend(self.content() for _ in range(self.take(">i")))
        return items

    def _object(self) -> dict[str, Any]:
        described = self._read_class_description()
        values: dict[str, Any] = {"": described.name}
        self._handles.append(values)
        for code, name in described.fields:
            if code == "I":
                values[name] = self.take(">i")
            elif code in "[L":
                values[name] = self.content()
            else:
                raise _UnreadableError(f"{described.name}.{name} has a type that does not occur in a field")
        return values


def read_field(path: Path) -> dict[str, Any]:
    """Return the field of a `.ser` file: width, height, exits, agents, blockades.

    Raises InputError for other contents.
    """
    try:
        content = _Stream(read_bytes(path, _LARGEST_FILE_BYTES)).start()
        return _field(content)
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from error
    except (_UnreadableError, RecursionError) as error:
        reason = "it is nested too deeply" if isinstance(error, RecursionError) else str(error)
        raise InputError(f"{path}: is not a field of FREVO's Emergency Exit: {reason}") from None


def _field(content: Any) -> dict[str, Any]:  # noqa: ANN401 - any content of the file
    if not isinstance(content, dict) or content.get("") != "emergencyexit.Field":
        actual = content.get("") if isinstance(content, dict) else type(content).__name__
        raise _UnreadableError(f"it contains {actual}; expected emergencyexit.Field")
    result: dict[str, Any] = {"width": content.get("width"), "height": content.get("height")}
    for key, name in (("exits", "EmergencyExits"), ("agents", "agents"), ("blockades", "blockades")):
        points = content.get(name)
        if not isinstance(points, list):
            raise _UnreadableError(f"{name} is missing")
        for point in points:
            if not isinstance(point, dict) or point.get("") != "java.awt.Point":
                raise _UnreadableError(f"{name} contains an object that is not a point")
        result[key] = [[point.get("x"), point.get("y")] for point in points]
    return result


_SHAPE = '{"width": 20, "height": 20, "exits": [[x, y], ..], "agents": [..], "blockades": [..]}'


@dataclass(frozen=True)
class FieldFile:
    """A field and its file."""

    path: Path
    value: dict[str, Any]

    @property
    def is_json(self) -> bool:
        """Whether an experiment can refer to the file; a Java object is written into the experiment."""
        return self.path.suffix.lower() != ".ser"


def find_field(problem: Section, session: Path, field_file: Path | None) -> FieldFile:
    """Return the field of a session: that of `field_file`, or of the file beside the session.

    The session names a `.ser` file, a serialized Java object. A `.json` file of the same name (in any case)
    beside the session takes precedence.

    Raises InputError, which names the expected files, if there is no field.
    """
    name = problem.take_text("Filename", "Components/Problems/EmergencyExit/emergencyexit/Stadium.ser")
    if field_file is not None:
        return FieldFile(field_file, _read(field_file))
    stem = PureWindowsPath(name).stem  # accepts slashes and backslashes
    neighbours = sorted(session.parent.iterdir())
    for ending in (".json", ".ser"):
        for path in neighbours:
            if path.name.lower() == f"{stem}{ending}".lower():
                return FieldFile(path, _read(path))
    raise problem.error(
        "Filename",
        f"the field {name!r} is missing; put {stem}.ser or {stem}.json beside {session.name}, or name "
        f"its file with --field FILE, in JSON {_SHAPE}",
    )


def _read(path: Path) -> dict[str, Any]:
    value = read_field(path) if path.suffix.lower() == ".ser" else read_object(path)
    try:
        mistakes = catalogue.parameter_mistakes("emergency_exit", {"field": value})
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    if mistakes:
        raise InputError("\n".join(f"{path}: {mistake}" for mistake in mistakes))
    return value


def format_field(value: dict[str, Any]) -> list[str]:
    """Return a field as lines of YAML below its key."""
    lines: list[str] = []
    for key, part in value.items():
        if not isinstance(part, list):
            lines.append(f"{key}: {json.dumps(part)}")
            continue
        cells = [json.dumps(cell) for cell in part]
        rows = [", ".join(cells[start : start + 10]) for start in range(0, len(cells), 10)]
        lines += [f"{key}: [", *(f"  {row}," for row in rows), "]"]
    return lines


TITLE = "emergency_exit"
"""Title of FREVO's Emergency Exit here."""


@dataclass(frozen=True)
class Line:
    """A line of the experiment file: key, value, and the name of the entry in FREVO as a comment."""

    key: str
    value: Any
    comment: str


@dataclass
class Mapped:
    """The lines of each section of an experiment, and the omitted entries.

    simulation: its name in the experiment. parameters, controller, method, ranking: lines of these sections.
    not_parameters, not_controller, not_method, not_ranking, not_config: omitted entries of FREVO's problem,
    representation, method, ranking and sessionconfig, each with the reason. field_file: the field, if the
    session has one. notes: differences from FREVO, for the user.
    """

    seed: Line
    simulation: str = TITLE
    controller_kind: str = "fully_meshed"
    method_kind: str = "nnga"
    ranking_kind: str = "absolute"
    parameters: list[Line] = field(default_factory=list)
    controller: list[Line] = field(default_factory=list)
    method: list[Line] = field(default_factory=list)
    ranking: list[Line] = field(default_factory=list)
    mutation: Line | None = None
    """How the method mutates genes, which is an option of the controller in Swarmwright; None: not at all."""
    field_file: FieldFile | None = None
    not_parameters: list[str] = field(default_factory=list)
    not_controller: list[str] = field(default_factory=list)
    not_method: list[str] = field(default_factory=list)
    not_ranking: list[str] = field(default_factory=list)
    not_config: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


def to_single_line(text: str) -> str:
    """Return a text of a file as a single line for a comment."""
    line = " ".join(text.split())[:80]
    return "".join(letter if letter.isprintable() else "?" for letter in line)


def report_unused(section: Section, reason: str) -> list[str]:
    """Return the reason for each unused entry, and mark the entries as used."""
    return [f"{key} = {to_single_line(section.take_raw(key))}: {reason}" for key in section.unused_keys]
