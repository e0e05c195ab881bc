"""The names of sensors and actuators in drawings of controllers."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Self

_NAME_CHARACTERS = 24
"""Letters of a name; of a longer one the beginning and the end are drawn.

Names of several kinds of robots begin with those of the kinds, and end with the sensor's.
"""


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
