"""What is in FREVO's files: sections of entries, each section with the class that is to be used.

FREVO's components that have a counterpart here.
"""

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
"""Of a number that may be small enough; Python refuses to read one with thousands."""
_ROOT = "frevo"
"""The outermost element."""


@dataclass
class Section:
    """Entries by key.

    `take_*` reads one, FREVO's default where it is left out; what was not taken is left.
    """

    name: str
    element: Element
    entries: dict[str, Element] = field(default_factory=dict)
    taken: set[str] = field(default_factory=set)
    unfilled: list[str] = field(default_factory=list)
    """Entries of a template, such as `-SEED-`, for which the default was taken."""

    @property
    def class_name(self) -> str:
        """FREVO's class."""
        return self.element.attribute("class")

    def shown(self, key: str, default: str = "") -> str:
        """Return an entry's value as it is in the file; a template's place to fill in is left out."""
        self.taken.add(key)
        if key not in self.entries:
            return default
        value = self.entries[key].attribute("value")
        if default and _TO_FILL_IN.fullmatch(value):
            if key not in self.unfilled:
                self.unfilled.append(key)
            return default
        return value

    def error(self, key: str, message: str) -> InputError:
        """Return an error about an entry, to be raised."""
        element = self.entries.get(key, self.element)
        return InputError(f"{element.file}:{element.line}: {self.name}.{key}: {message}")

    def take_text(self, key: str, default: str, choices: tuple[str, ...] = ()) -> str:
        """Return text, one of the choices if there are any."""
        text = self.shown(key, default).strip()
        if choices and text not in choices:
            raise self.error(
                key, f"{text!r} found, expected one of {', '.join(choices)}{did_you_mean(text, choices)}"
            )
        return text

    def take_integer(self, key: str, default: int, least: int = -(2**63)) -> int:
        """Return a whole number of at least `least`."""
        text = self.shown(key, str(default)).strip()
        try:
            value = int(text)
        except ValueError:
            raise self.error(key, f"{text!r} found, expected a whole number") from None
        if value < least:
            raise self.error(key, f"{value} found, expected a whole number of at least {least}")
        return value

    def take_number(self, key: str, default: float) -> float:
        """Return a finite number, Java's `0.15f` as 0.15."""
        text = self.shown(key, str(default)).strip()
        value = java_number(text)
        if value is None:
            raise self.error(key, f"{text!r} found, expected a number such as 0.15f")
        return value

    def take_flag(self, key: str, default: bool) -> bool:
        """Return true or false."""
        return self.take_text(key, str(default).lower(), ("true", "false")) == "true"

    @property
    def left(self) -> list[str]:
        """Keys that were not taken, in the file's order."""
        return [key for key in self.entries if key not in self.taken]


@dataclass(frozen=True)
class Session:
    """A FREVO file: what was to be done, and in a result file the populations that came out.

    A section is read when it is asked for; InputError when it is missing or malformed.
    """

    path: Path
    root: Element

    @cached_property
    def config(self) -> Section:
        """Name, seed, number of runs; without entries where the file has none."""
        if not self.root.find_all("sessionconfig"):
            return Section("sessionconfig", self.root)
        return _section(self.root, "sessionconfig", "configentry")

    @cached_property
    def problem(self) -> Section:
        """What candidates are evaluated on."""
        return _section(self.root, "problem", "problementry")

    @cached_property
    def method(self) -> Section:
        """How candidates are evolved."""
        return _section(self.root, "method", "methodentry")

    @cached_property
    def representation(self) -> Section:
        """What candidates are."""
        return _section(self.root, "representation", "representationentry")

    @cached_property
    def ranking(self) -> Section:
        """How candidates are ordered."""
        return _section(self.root, "ranking", "rankingentry")


def java_number(text: str) -> float | None:
    """Return what Java's Float.parseFloat makes of a text; None when that is not a finite number."""
    text = text.strip()
    if text[-1:] in {"f", "F", "d", "D"}:
        text = text[:-1]
    try:
        value = float(text) if "_" not in text else math.nan
    except ValueError:
        return None
    return value if math.isfinite(value) else None


def is_single(value: float) -> bool:
    """Return whether a number is finite as a binary32, too."""
    with np.errstate(over="ignore"):
        return bool(np.isfinite(np.float32(value)))


def attribute_number(element: Element, name: str) -> float:
    """Return an attribute that is a finite binary32 when it is rounded; raise InputError for others."""
    text = element.attribute(name)
    value = java_number(text)
    if value is None or not is_single(value):
        raise element.error(f"{name} {text[:40]!r} found, expected a finite number")
    return value


def attribute_count(element: Element, name: str) -> int:
    """Return an attribute that counts or numbers nodes; raise InputError for others."""
    text = element.attribute(name)
    digits = text.lstrip("0") if text.isascii() and text.isdigit() else "x"
    if digits == "x" or len(digits) > _DIGITS or int(digits or 0) > _MOST_NODES:
        raise element.error(f"{name} {text[:40]!r} found, expected a whole number of at most {_MOST_NODES}")
    return int(digits or 0)


def members(root: Element) -> Iterator[Element]:
    """Yield what the populations of a result file hold, in the file's order; nothing for a session."""
    for element in root.children:
        if element.tag == "population":
            yield from element.children
        elif element.tag == "populations":
            for population in element.find_all("population"):
                yield from population.children


@check_arguments
def is_session(path: str | PathLike[str]) -> bool:
    """Whether a file is a FREVO session or result. Raises InputError when it cannot be read."""
    file = Path(path)
    return first_character(file) == "<" and root_of(file).tag == _ROOT


def open_session(path: Path) -> Session:
    """Read a session or result file. Raises InputError, with file and line, when it is not one."""
    root = read(path)
    if root.tag != _ROOT:
        raise root.error(
            "found as the outermost element; expected <frevo>, a session (.zse) or result (.zre)"
        )
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

KNOWN = {
    "problem": (EMERGENCY_EXIT,),
    "method": (NNGA, CEA2D, PSO, RANDOM_SEARCH),
    "representation": (MESHED, COMPLETE, THREE_LAYERS, LAYERS, MACHINE, HEBBIAN, NEAT),
    "ranking": ("AbsoluteRanking.AbsoluteRanking",),
}
"""Classes of each section that have a counterpart here."""

OPTIONS = {
    "problem": ("simulation", "a simulation"),
    "method": ("method", "a method"),
    "representation": ("controller", "a controller"),
    "ranking": ("ranking", "a ranking"),
}
"""For each section the option that names something of this program in the component's place, and what."""


def check(section: Section, *, replaceable: bool) -> None:
    """Raise InputError when the component that a section names has no counterpart here.

    replaceable: whether another component can replace it, which the message then says.
    """
    known = KNOWN[section.name]
    if section.class_name in known:
        return
    option, what = OPTIONS[section.name]
    instead = f"; --{option} names {what} to take in its place" if replaceable else ""
    raise section.element.error(
        f"the class {section.class_name!r} has no counterpart here"
        f"{did_you_mean(section.class_name, known)}; what can be taken over is {_any_of(known)}{instead}"
    )


def all_of(*steps: Callable[[], None]) -> None:
    """Take every step; raise one InputError with the problems of all, a line each."""
    problems = []
    for step in steps:
        try:
            step()
        except InputError as error:
            problems.append(str(error))
    if problems:
        raise InputError("\n".join(dict.fromkeys(problems)))


def _any_of(names: Sequence[str]) -> str:
    *most, last = names
    return f"{', '.join(most)} or {last}" if most else last
