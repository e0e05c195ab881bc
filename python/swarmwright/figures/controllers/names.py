"""The names of sensors and actuators of built-in simulations."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self

_SENSORS = {
    "minisim": ("goal x", "goal y", "defender x", "defender y"),
    "emergency_exit": ("exit x", "exit y", "N free", "NE free", "E free", "SE free", "S free", "SW free",
                       "W free", "NW free"),
}  # fmt: skip
_ACTUATORS = {"minisim": ("heading",), "emergency_exit": ("move x", "move y")}


@dataclass(frozen=True)
class Names:
    """Names of a controller's inputs and outputs."""

    sensors: tuple[str, ...]
    actuators: tuple[str, ...]

    @classmethod
    def of(cls, specification: Mapping[str, Any], simulation: str | None) -> Self:
        """Return the simulation's names where they are known and their number fits, else numbered ones."""
        sensors, actuators = int(specification["sensors"]), int(specification["actuators"])
        return cls(
            _fitting(_SENSORS.get(simulation or ""), "sensor", sensors),
            _fitting(_ACTUATORS.get(simulation or ""), "actuator", actuators),
        )


def _fitting(known: tuple[str, ...] | None, what: str, count: int) -> tuple[str, ...]:
    if known is not None and len(known) == count:
        return known
    return tuple(f"{what} {index}" for index in range(count))
