"""Agents of a simulation: their kinds, their sensors and actuators."""

from dataclasses import dataclass

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
