"""What figures of controllers are drawn from."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Self

_NAME_CHARACTERS = 24
"""Letters of a name; of a longer one the beginning and the end are drawn.

Names of several kinds of robots begin with those of the kinds, and end with the sensor's.
"""


@dataclass(frozen=True)
class Drawing:
    """A controller to be drawn."""

    specification: Mapping[str, Any]
    """As plain values, see protocol/schemas/controller.schema.json."""
    title: str = ""
    """Above the figure."""
    simulation: Mapping[str, Any] | None = None
    """Its description, for the names of sensors and actuators, which are numbered without."""
    options: Mapping[str, Any] = field(default_factory=dict)
    """The experiment's `controller`, which knows the ranges of parameters."""
    first_color: int = 0
    """Index of the colour of state 0; each group of a team has colours of its own."""

    @cached_property
    def names(self) -> "Names":
        """The names of sensors and actuators."""
        return Names.of(self.specification, self.simulation)


@dataclass(frozen=True)
class Names:
    """Names of a controller's inputs and outputs."""

    sensors: tuple[str, ...]
    actuators: tuple[str, ...]

    @classmethod
    def of(cls, specification: Mapping[str, Any], simulation: Mapping[str, Any] | None = None) -> Self:
        """Return the names in a simulation's description if their number fits, else numbered ones."""
        described = simulation or {}
        return cls(
            _fitting(described.get("sensor_names", ()), "sensor", int(specification["sensors"])),
            _fitting(described.get("actuator_names", ()), "actuator", int(specification["actuators"])),
        )


def _fitting(names: Sequence[str], what: str, count: int) -> tuple[str, ...]:
    if len(names) == count:
        return tuple(map(_abbreviated, names))
    return tuple(f"{what} {index}" for index in range(count))


def _abbreviated(name: str) -> str:
    if len(name) <= _NAME_CHARACTERS:
        return name
    last = _NAME_CHARACTERS // 2
    return f"{name[: _NAME_CHARACTERS - 1 - last]}…{name[-last:]}"
