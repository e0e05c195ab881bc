"""Kinds of agents of a simulation."""

from dataclasses import dataclass

Names = tuple[str | None, ...]
"""Of numbers that are recorded for all agents; None for one that a kind does not have."""


@dataclass(frozen=True)
class DeclaredGroup:
    """What a simulation declares of a kind of agents, with the parameters of an experiment."""

    name: str
    agents: int
    sensors: int
    actuators: int
    sensor_names: tuple[str, ...] = ()
    actuator_names: tuple[str, ...] = ()
    own_sensor_names: Names = ()
    """Where all kinds have the same numbers: what this kind calls those that it has."""
    own_actuator_names: Names = ()


@dataclass(frozen=True)
class Kind:
    """Agents that have the same of the sensors and actuators of all."""

    name: str
    agents: int
    sensors: Names
    actuators: Names
