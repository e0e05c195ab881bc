"""Agents of a simulation: their kinds, their sensors and actuators, and the sides of a match."""

from dataclasses import dataclass

Names = tuple[str | None, ...]
"""Names of the values recorded for all agents; None for a value that a kind does not have."""


@dataclass(frozen=True)
class DeclaredGroup:
    """A kind of agents that a simulation declares for the parameters of an experiment."""

    name: str
    agents: int
    """Number of agents."""
    sensors: int
    """Sensor values of an agent."""
    actuators: int
    """Actuator values of an agent."""
    sensor_names: tuple[str, ...] = ()
    """Names of the sensor values, in order; empty if unknown."""
    actuator_names: tuple[str, ...] = ()
    """Names of the actuator values, in order; empty if unknown."""
    own_sensor_names: Names = ()
    """If all kinds share one list of sensor values, this kind's names of those it has."""
    own_actuator_names: Names = ()
    """The same for actuator values."""


@dataclass(frozen=True)
class DeclaredSide:
    """A side of a match: groups of agents that are evaluated together."""

    name: str
    groups: tuple[str, ...]
    """Names of its groups; a group belongs to one side."""
    fitness: str | None = None
    """The metric that is its fitness, larger is better; None if the simulation does not define one."""


@dataclass(frozen=True)
class Kind:
    """Agents that share one subset of the sensors and actuators."""

    name: str
    agents: int
    sensors: Names
    actuators: Names
