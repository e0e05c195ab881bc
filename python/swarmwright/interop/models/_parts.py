"""Parts of an experiment, read from files of modelling tools, with their source locations."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from swarmwright.common.problems import ProblemLines
from swarmwright.common.suggestions import alike, did_you_mean, fold_name
from swarmwright.controllers.scxml import StateMachine
from swarmwright.simulations import catalogue

_LARGEST_INTEGER = 1 << 24


@dataclass(frozen=True)
class Location:
    """A location in a file."""

    file: Path
    line: int
    element: str = ""

    def format(self, message: str) -> str:
        """Prefix a message with file, line and element."""
        return f"{self.file}:{self.line}: {self.element + ': ' if self.element else ''}{message}"


@dataclass(frozen=True)
class Property:
    """A parameter of the simulation with a fixed value."""

    name: str
    value: int | float | bool | str
    location: Location


@dataclass(frozen=True)
class OptimisedParameter:
    """A parameter to optimise.

    low, high: the range in the file; the simulation gets a number of this range times `scale`.
    """

    name: str
    low: int | float
    high: int | float
    scale: float
    meta: str
    """Source of the value at deployment: `command_line`, or `file:PACKAGE`."""
    location: Location

    @property
    def whole(self) -> bool:
        """Whether the simulation gets integers that are exact as 32-bit floats."""
        largest = max(abs(self.low), abs(self.high)) * self.scale
        whole = isinstance(self.low, int) and isinstance(self.high, int) and self.scale.is_integer()
        return whole and largest <= _LARGEST_INTEGER

    @property
    def range(self) -> list[int | float]:
        """Lowest and highest number for the simulation."""
        if self.whole:
            return [int(bound * self.scale) for bound in (self.low, self.high)]
        return [float(f"{bound * self.scale:.9g}") for bound in (self.low, self.high)]


@dataclass(frozen=True)
class Member:
    """A kind of agents of a swarm."""

    name: str
    launch_file: str
    number: int
    location: Location
    sensors: tuple[str, ...] = ()
    """Names of the sensors; empty if the file has none."""
    actuators: tuple[str, ...] = ()


@dataclass
class Part:
    """Content of one file. Fields without content are empty or None."""

    path: Path
    kind: str
    """Description of the kind of file."""
    name: str = ""
    """Name of the problem or the model."""
    titles: tuple[str, ...] = ()
    """Candidate names of the simulation."""
    properties: list[Property] = field(default_factory=list)
    optimised: list[OptimisedParameter] = field(default_factory=list)
    members: list[Member] = field(default_factory=list)
    sensors: int | None = None
    actuators: int | None = None
    sensor_names: list[str] = field(default_factory=list)
    actuator_names: list[str] = field(default_factory=list)
    behaviour: StateMachine | None = None
    fitness: str | None = None
    notes: list[str] = field(default_factory=list)
    """Notes on content that was not imported."""

    @property
    def has_groups(self) -> bool:
        """Whether its kinds of agents differ in sensors or actuators."""
        return len({(member.sensors, member.actuators) for member in self.members}) > 1

    def describe_contents(self) -> list[str]:
        """Return descriptions of its content, which must be unique among files."""
        contents: Mapping[str, Any] = {
            "the problem": self.titles,
            "the swarm": self.members,
            "optimised parameters": self.optimised,
            "sensors and actuators": self.sensor_names or self.actuator_names or self.has_groups,
            "a behaviour": self.behaviour,
            "a fitness function": self.fitness,
        }
        return [words for words, value in contents.items() if value]


class Problems:
    """Collector of problems, reported together."""

    def __init__(self) -> None:
        self.lines = ProblemLines()

    def add(self, location: Location, message: str) -> None:
        """Add a problem, without repetition."""
        self.lines.add(location.format(message))

    def stop(self) -> None:
        """Raise InputError with all problems, if any."""
        self.lines.stop()


_ALIASES = {"swarmmembers": ("numAgents", "robots"), "steps": ("maxSteps", "steps")}
"""Names that Modelio's CPSwarm module writes into each problem -> names in built-in simulations."""
AGENTS = ("numAgents", "robots")
"""Parameters of built-in simulations with the number of agents."""


def find_title(names: Iterable[str]) -> str | None:
    """Return the built-in simulation with one of these names; None if there is none."""
    titles = list(catalogue.titles())
    return next((titles[indices[0]] for name in names if (indices := alike(name, titles))), None)


class SimulationParameters:
    """The parameters of a simulation, if it is described."""

    def __init__(self, simulation: str) -> None:
        described = catalogue.has_description(simulation)
        self.description: dict[str, Any] | None = catalogue.description(simulation) if described else None
        self.simulation = simulation

    @property
    def parameters(self) -> dict[str, Any] | None:
        """Name -> type, default; None if the simulation is not described, or takes any parameters."""
        return None if self.description is None else (self.description["parameters"] or None)

    def find(self, name: str) -> str | None:
        """Return the simulation's name of a parameter; None without a match, or with several."""
        if self.parameters is None:
            return name
        matches = self._find_matches(name)
        return matches[0] if len(matches) == 1 else None

    def is_ambiguous(self, name: str) -> bool:
        """Whether the simulation has several parameters that a name may stand for."""
        return len(self._find_matches(name)) > 1

    def _find_matches(self, name: str) -> list[str]:
        names = list(self.parameters or ())
        for candidate in (name, *_ALIASES.get(fold_name(name), ())):
            if indices := alike(candidate, names):
                return [names[index] for index in indices]
        return []

    @property
    def agents(self) -> str | None:
        """The parameter with the number of agents; None without one, or if `parameters` is None."""
        return (
            None
            if self.parameters is None
            else next((name for name in AGENTS if name in self.parameters), None)
        )

    def find_agents_of(self, kind: str) -> str | None:
        """Return the parameter with the number of agents of a kind, e.g. numScouts; None without one."""
        return kind if self.parameters is None else self.find(f"num {kind}") or self.find(kind)

    def describe_problem(self, name: str) -> str:
        """Return the message for an unknown or ambiguous parameter."""
        if self.is_ambiguous(name):
            candidates = " or ".join(map(repr, self._find_matches(name)))
            return f"{name!r} is ambiguous in {self.simulation}: {candidates}; write one of these names"
        return f"{self.simulation} has no parameter {name!r}{did_you_mean(name, self.parameters or ())}"


def parse_integer(text: str, location: Location, problems: Problems) -> int | None:
    """Parse an integer; add a problem and return None for other text."""
    try:
        value = int(text) if "_" not in text else None
    except ValueError:
        value = None
    if value is None or abs(value) >= 2**63:
        problems.add(location, f"{text[:80]!r} found, expected a whole number")
        return None
    return value


def parse_number(text: str, location: Location, problems: Problems) -> float | None:
    """Parse a finite number, also Java's `0.15f`; add a problem and return None for other text."""
    digits = text[:-1] if text[-1:] in {"f", "F", "d", "D"} else text
    try:
        value = float(digits) if "_" not in digits else math.nan
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        problems.add(location, f"{text[:80]!r} found, expected a number such as 0.15")
        return None
    return value
