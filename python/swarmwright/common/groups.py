"""Agents of a simulation: their kinds, their sensors and actuators."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from swarmwright.common.ranges import Range

Names = tuple[str | None, ...]
"""Of numbers that are recorded for all agents; None for one that a kind does not have."""


@dataclass(frozen=True)
class DeclaredGroup:
    """What a simulation declares of a kind of agents, with the parameters of an experiment."""

    name: str
    """Of the group."""
    agents: int
    """How many there are."""
    sensors: int
    """Sensor values of an agent."""
    actuators: int
    """Actuator values of an agent."""
    sensor_names: tuple[str, ...] = ()
    """What the sensor values are called, in order; empty where it is not known."""
    actuator_names: tuple[str, ...] = ()
    """What the actuator values are called, in order; empty where it is not known."""
    own_sensor_names: Names = ()
    """Where all kinds have the same sensor values: what this kind calls those that it has."""
    own_actuator_names: Names = ()
    """The same of actuator values."""


@dataclass(frozen=True)
class Kind:
    """Agents that have the same of the sensors and actuators of all."""

    name: str
    agents: int
    sensors: Names
    actuators: Names


def problem_of(channels: Any) -> str | None:  # noqa: ANN401 - whatever a file says
    """Return what is wrong with channels as `catalogue.channels` describes them; None when nothing is."""
    if not isinstance(channels, Mapping) or not isinstance(channels.get("groups", {}), Mapping):
        return "a mapping was expected"
    for where in (channels, *channels.get("groups", {}).values()):
        if not isinstance(where, Mapping):
            return "groups: a mapping for each group was expected"
        for which in ("sensor", "actuator"):
            for about in ("names", "units", "ranges"):
                found = where.get(f"{which}_{about}", [])
                if not isinstance(found, list):
                    return f"{which}_{about}: a list was expected"
                if about != "ranges" and not all(isinstance(name, str) for name in found):
                    return f"{which}_{about}: texts were expected"
            try:
                _ = [Range.of(ends) for ends in where.get(f"{which}_ranges", [])]
            except ValueError as error:
                return f"{which}_ranges: {error}"
    seconds = channels.get("step_seconds")
    if seconds is not None and not (isinstance(seconds, int | float) and 0 < seconds < float("inf")):
        return f"step_seconds: {seconds!r} found, expected seconds above 0, or null"
    return None
