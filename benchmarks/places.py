"""Simulators in which missions of the arena can be computed here, and servers of them."""

import contextlib
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from benchmarks.gazebo import GAZEBO_ROOT, PROJECT
from benchmarks.gazebo import command as gazebo_command
from benchmarks.processes import Broker, processor_seconds
from benchmarks.wrappers import Server
from swarmwright.common.errors import InputError
from swarmwright.simulations import catalogue
from tests.attached import ARGOS, STAGE, Simulator, build

PREFIX = "bench/missions"
"""Of the topics of these servers."""


@dataclass(frozen=True)
class Place:
    """A simulator: its name in experiments; why it cannot be used here, if so; what starts a server of it.

    command: None where the simulation is in this process.
    """

    name: str
    simulation: str
    missing: Callable[[], str | None]
    command: Callable[[], list[str]] | None = None


def _in_process(simulation: str) -> Callable[[], str | None]:
    def missing() -> str | None:
        try:
            catalogue.description(simulation, {"mission": "aggregation"})
        except (InputError, ModuleNotFoundError) as error:
            return " ".join(str(error).split())
        return None

    return missing


def _attached(simulator: Simulator) -> tuple[Callable[[], str | None], Callable[[], list[str]]]:
    def missing() -> str | None:
        if simulator.prefix is not None:
            return None
        return f"not installed; {simulator.variable} names the folder where it is"

    return missing, lambda: [str(build(simulator) / f"swarmwright-{simulator.name.lower()}")]


def _no_gazebo() -> str | None:
    built = (PROJECT / "build" / "swarmwright-gazebo").exists() and (GAZEBO_ROOT / ".complete").exists()
    return None if built else "its server is not built; `make gazebo` builds it"


ENKI, MUJOCO = "swarmwright.simulations.enki:Missions", "swarmwright.simulations.mujoco:Missions"
PLACES = (
    Place("arena", "arena", lambda: None),
    Place("Enki", ENKI, _in_process(ENKI)),
    Place("MuJoCo", MUJOCO, _in_process(MUJOCO)),
    Place("Stage", "arena-stage", *_attached(STAGE)),
    Place("ARGoS", "arena-argos", *_attached(ARGOS)),
    Place("Gazebo", "arena-gazebo", _no_gazebo, lambda: gazebo_command("swarmwright-gazebo")),
)


@contextlib.contextmanager
def running(place: Place, broker: Broker) -> Iterator[Callable[[], float]]:
    """Start a server where a simulator needs one; yield what tells the processor time so far, seconds."""
    if place.command is None:
        yield time.process_time
        return
    with contextlib.closing(Server(place.command(), broker, PREFIX)) as server:
        yield lambda: processor_seconds(server.pid)
