"""The hosts of users' classes: of simulations, and of simulators that move the robots of missions."""

from collections.abc import Callable
from typing import TypeAlias

from swarmwright.simulations.base import Simulation
from swarmwright.simulations.batches import BatchSimulation
from swarmwright.simulations.host import Host
from swarmwright.simulations.physics import Physics
from swarmwright.simulations.physics_host import PhysicsHost

Kind: TypeAlias = type[Simulation] | type[BatchSimulation] | type[Physics]
AnyHost: TypeAlias = Host | PhysicsHost


def hosted(kind: Kind, report: Callable[[str, str], None] | None = None) -> AnyHost:
    """Return a host of a class; report: as they take it.

    Raises InputError when the class does not describe itself properly.
    """
    if issubclass(kind, Physics):
        return PhysicsHost(kind, report)
    return Host(kind, report)
