"""Sections and entries of FREVO's files, and the FREVO classes that can be converted."""

import math
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from os import PathLike
from pathlib import Path

import numpy as np

from swarmwright.common.arguments import check_arguments
from swarmwright.common.errors import InputError
from swarmwright.common.files import first_character
from swarmwright.common.suggestions import did_you_mean
from swarmwright.common.xml import Element, read, root_of

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
RANDOM_SEARCH = "frevo.method.randomsearch.RandomSearch"
ABSOLUTE = "AbsoluteRanking.AbsoluteRanking"
FULL_TOURNAMENT, SWISS = "fulltournament.FullTournament", "swissSystem.SwissSystem"
MULTI_SWISS, MULTI_SORT = "MultiSwiss.MultiSwiss", "MultiSort.MultiSort"

SUPPORTED = {
    "problem": (EMERGENCY_EXIT,),
    "method": (NNGA, CEA2D, PSO, RANDOM_SEARCH),
    "representation": (MESHED, COMPLETE, THREE_LAYERS, LAYERS, MACHINE, HEBBIAN, NEAT),
    "ranking": (ABSOLUTE, FULL_TOURNAMENT, SWISS, MULTI_SWISS, MULTI_SORT),
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
