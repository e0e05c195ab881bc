"""Parts of an experiment, read from files of modelling tools, with their source locations."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from swarmwright.common.problems import ProblemLines
from swarmwright.controllers.scxml import StateMachine

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
