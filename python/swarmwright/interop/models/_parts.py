"""What files of modelling tools describe: parts of an experiment, each with the place that it comes from."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from swarmwright.common.problems import ProblemLines
from swarmwright.controllers.scxml import StateMachine

_LARGEST_INTEGER = 1 << 24


@dataclass(frozen=True)
class Place:
    """Where something stands in a file."""

    file: Path
    line: int
    what: str = ""

    def says(self, message: str) -> str:
        """Return a problem with file and line."""
        return f"{self.file}:{self.line}: {self.what + ': ' if self.what else ''}{message}"


@dataclass(frozen=True)
class Property:
    """A parameter of the simulation that has one value."""

    name: str
    value: int | float | bool | str
    place: Place


@dataclass(frozen=True)
class Optimised:
    """A parameter that is to be optimised.

    low, high: the range as it is in the file; the simulation gets a number of the range times `scale`.
    """

    name: str
    low: int | float
    high: int | float
    scale: float
    meta: str
    """Where the deployment takes the value from: `command_line`, or `file:PACKAGE`."""
    place: Place

    @property
    def whole(self) -> bool:
        """Whether the simulation gets whole numbers, of which each is a 32-bit float."""
        largest = max(abs(self.low), abs(self.high)) * self.scale
        whole = isinstance(self.low, int) and isinstance(self.high, int) and self.scale.is_integer()
        return whole and largest <= _LARGEST_INTEGER

    @property
    def range(self) -> list[int | float]:
        """Lowest and highest number that the simulation gets."""
        if self.whole:
            return [int(bound * self.scale) for bound in (self.low, self.high)]
        return [float(f"{bound * self.scale:.9g}") for bound in (self.low, self.high)]


@dataclass(frozen=True)
class Member:
    """A kind of agents in a swarm."""

    name: str
    launch_file: str
    number: int
    place: Place
    sensors: tuple[str, ...] = ()
    """Names of what they sense; empty where the file does not say."""
    actuators: tuple[str, ...] = ()


@dataclass
class Part:
    """What one file says. Fields that it says nothing about are empty or None."""

    path: Path
    kind: str
    """The kind of file, in words."""
    name: str = ""
    """Of the problem or the model."""
    titles: tuple[str, ...] = ()
    """Names by which the simulation may be known."""
    properties: list[Property] = field(default_factory=list)
    optimised: list[Optimised] = field(default_factory=list)
    members: list[Member] = field(default_factory=list)
    sensors: int | None = None
    actuators: int | None = None
    sensor_names: list[str] = field(default_factory=list)
    actuator_names: list[str] = field(default_factory=list)
    behaviour: StateMachine | None = None
    fitness: str | None = None
    notes: list[str] = field(default_factory=list)
    """What was not taken over, a sentence each."""

    @property
    def differ(self) -> bool:
        """Whether its agents have different sensors or actuators."""
        return len({(member.sensors, member.actuators) for member in self.members}) > 1

    def contents(self) -> list[str]:
        """Return what it holds, in words; two files must not hold the same."""
        held: Mapping[str, Any] = {
            "the problem": self.titles,
            "the swarm": self.members,
            "optimised parameters": self.optimised,
            "sensors and actuators": self.sensor_names or self.actuator_names or self.differ,
            "a behaviour": self.behaviour,
            "a fitness function": self.fitness,
        }
        return [words for words, value in held.items() if value]


class Problems:
    """Everything that is wrong with files, reported at once."""

    def __init__(self) -> None:
        self.lines = ProblemLines()

    def add(self, place: Place, message: str) -> None:
        """Note a problem, once."""
        self.lines.add(place.says(message))

    def stop(self) -> None:
        """Raise InputError if there is a problem."""
        self.lines.stop()
