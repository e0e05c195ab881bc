"""Input of the figures of controllers."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Self

_NAME_CHARACTERS = 24
"""Longest name that is drawn in full; of longer names the beginning and the end are drawn.

With several kinds of robots, names begin with the kind and end with the sensor.
"""


@dataclass(frozen=True)
class Drawing:
    """A controller to be drawn."""

    specification: Mapping[str, Any]
    """As plain values, see protocol/schemas/controller.schema.json."""
    title: str = ""
    """Above the figure."""
    simulation: Mapping[str, Any] | None = None
    """Description of the simulation, for the names of sensors and actuators; None: they are numbered."""
    options: Mapping[str, Any] = field(default_factory=dict)
    """The experiment's `controller`, which knows the ranges of parameters."""
    first_color: int = 0
    """Index of the colour of state 0; each group of a team has its own colours."""

    @cached_property
    def names(self) -> "Names":
        """The names of sensors and actuators."""
        return Names.from_specification(self.specification, self.simulation)


@dataclass(frozen=True)
class Names:
    """Names of a controller's inputs and outputs."""

    sensors: tuple[str, ...]
    actuators: tuple[str, ...]

    @classmethod
    def from_specification(
        cls, specification: Mapping[str, Any], simulation: Mapping[str, Any] | None = None
    ) -> Self:
        """Return the names in a simulation's description if their number matches, else numbered names."""
        described = simulation or {}
        return cls(
            _label_values(described.get("sensor_names", ()), "sensor", int(specification["sensors"])),
            _label_values(described.get("actuator_names", ()), "actuator", int(specification["actuators"])),
        )


def _label_values(names: Sequence[str], noun: str, count: int) -> tuple[str, ...]:
    if len(names) == count:
        return tuple(map(_abbreviate, names))
    return tuple(f"{noun} {index}" for index in range(count))


def _abbreviate(name: str) -> str:
    if len(name) <= _NAME_CHARACTERS:
        return name
    last = _NAME_CHARACTERS // 2
    return f"{name[: _NAME_CHARACTERS - 1 - last]}…{name[-last:]}"
