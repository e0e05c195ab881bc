"""Kinds of agents of a simulation."""

from dataclasses import dataclass


@dataclass(frozen=True)
class DeclaredGroup:
    """What a simulation declares of a kind of agents, with the parameters of an experiment."""

    name: str
    agents: int
    sensors: int
    actuators: int
    sensor_names: tuple[str, ...] = ()
    actuator_names: tuple[str, ...] = ()
