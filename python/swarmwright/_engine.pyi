"""The compiled engine. Everything here is built from `engine/python`; `mypy.stubtest` checks the two against each other."""

from collections.abc import Callable, Sequence
from typing import final

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "Broker",
    "Controller",
    "EngineError",
    "Episode",
    "InputError",
    "Pool",
    "__version__",
    "check_parameters",
    "decimals",
    "describe",
    "evaluate",
    "genome_size",
    "levels",
    "serve",
    "servers",
    "simulations",
]

__version__: str

class EngineError(RuntimeError):
    """The engine could not do what was asked; the message says what, where and how to mend it."""

class InputError(ValueError):
    """The input is wrong (parameters, controller, URL); the message names the field."""

def simulations() -> list[str]:
    """Titles of the built-in simulations, sorted."""

def describe(title: str) -> str:
    """JSON object: title, dimensions, max_agents, sensors, actuators, parameters (name -> {type, default, description}).

    Raises InputError for an unknown title.
    """

def check_parameters(title: str, parameters: str) -> None:
    """Raise InputError (naming the parameter) unless the JSON object `parameters` configures the built-in simulation `title`."""

@final
class Controller:
    """Inference of one controller, sensors in, actuators out, in the arithmetic of DESIGN.md section 5.

    specification: JSON text, see protocol/controller.schema.json. State is kept between steps until `reset`.
    """

    def __new__(cls, specification: str) -> Controller: ...
    @property
    def sensors(self) -> int: ...
    @property
    def actuators(self) -> int: ...
    def reset(self) -> None: ...
    def step(self, sensors: NDArray[np.float32]) -> NDArray[np.float32]:
        """(sensors,) float32 -> (actuators,) float32 in -1..1. Raises InputError for another length or a NaN."""

def genome_size(specification: str) -> int:
    """Number of weights that the specification (JSON, its `weights` ignored) needs."""

@final
class Episode:
    """One built-in simulation stepped in this process by one controller for all agents."""

    def __new__(cls, title: str, parameters: str, controller: str) -> Episode: ...
    @property
    def done(self) -> bool: ...
    @property
    def fitness(self) -> float: ...
    @property
    def step_size(self) -> float:
        """Seconds between two frames when shown."""
    def step(self) -> None: ...
    def scene(self) -> str:
        """JSON: {"width", "height", "step", "message", "bodies": [{"kind", "x", "y", "state", "radius"}]}; y points up, metres or cells."""
    def text(self, columns: int, color: bool, rows: int = 24, unicode: bool = True) -> str:
        """The scene as at most `rows` lines of at most `columns` characters."""

def decimals(genomes: NDArray[np.float32]) -> list[str]:
    """Each row of (candidates, genes) as text: the shortest decimals that read back as the same binary32.

    Commas stand between them.

    Raises InputError for a gene that is not finite.
    """

def levels() -> list[str]:
    """How this processor can evaluate, the fastest last: scalar, then instruction sets (portable, avx2, avx512)."""

def evaluate(
    title: str,
    parameters: str,
    architecture: str,
    genomes: NDArray[np.float32],
    seeds: Sequence[int],
    on_progress: Callable[[int, int, str], None] | None = None,
    *,
    level: str = "auto",
    threads: int = 0,
) -> NDArray[np.float64]:
    """Evaluate in this process: (candidates, episodes) fitness; the parameter `seed` of episode e is seeds[e].

    architecture: controller specification as JSON, its weights ignored. genomes: (candidates, weights), finite.
    level: "auto" or one of `levels()`; threads: 0 for one per processor. The fitness depends on neither.
    on_progress(done, total, "") is called about ten times a second and at the end; KeyboardInterrupt is raised promptly.
    Raises InputError for an unknown title, parameters that the simulation refuses, controllers that do not fit it.
    """

@final
class Broker:
    """The embedded MQTT broker, running in threads of this process until `stop`."""

    def __new__(
        cls,
        host: str = "127.0.0.1",
        port: int = 0,
        *,
        websocket_port: int | None = None,
        users: str | None = None,
        certificate: str | None = None,
        key: str | None = None,
    ) -> Broker:
        """port 0: any free one. users: path of a password file. Raises EngineError when the address cannot be bound."""
    @property
    def url(self) -> str: ...
    @property
    def port(self) -> int: ...
    def stop(self) -> None: ...

def serve(
    title: str,
    broker: str,
    *,
    id: int,
    prefix: str = "",
    step_timeout: float = 60.0,
    display: bool = True,
    on_event: Callable[[str], None] | None = None,
) -> None:
    """Offer a built-in simulation on the broker until interrupted (KeyboardInterrupt) or the process ends.

    on_event gets JSON lines {"event": "ready"|"busy"|"warning"|"lost", ...}. Raises EngineError: no broker, refused, id taken.
    """

def servers(broker: str, *, prefix: str = "", wait: float = 1.0) -> str:
    """JSON array, sorted by id: {"server", "state": "ready"|"busy"|"lost", "simulations", "capabilities", "tool", "since", "host", "pid"}."""

@final
class Pool:
    """The optimization tool's side: finds servers, runs episodes on them, returns results in the order of the candidates."""

    def __new__(
        cls,
        broker: str,
        *,
        simulation: str,
        parameters: str,
        requirements: str,
        sensors: int | None = None,
        actuators: int | None = None,
        prefix: str = "",
        tool: str = "",
        mode: str = "auto",
        visual: bool = False,
        discovery_timeout: float = 10.0,
        step_timeout: float = 60.0,
        attempts: int = 3,
        largest: int | None = None,
    ) -> Pool:
        """Connects and discovers. Raises EngineError (no broker, refused) or InputError.

        mode: "auto" (each server in the fastest way that it offers), "stepwise", "batched" or "offloaded". largest: most
        evaluations in one request, None for no limit. visual: servers show their runs, which are stepwise then.
        """
    def wait_for_server(self) -> tuple[int, int]:
        """Block until a fitting server is there; (sensors, actuators). Raises EngineError naming what was required and what was found."""
    def evaluate(
        self,
        architecture: str,
        genomes: NDArray[np.float32],
        seeds: Sequence[int],
        on_progress: Callable[[int, int, str], None] | None = None,
    ) -> tuple[NDArray[np.float64], str]:
        """Every controller in an episode of every seed; `architecture` and `genomes` as in the function `evaluate`.

        Returns fitness (candidates, episodes) float64, NaN where the evaluation failed, and the journal as JSON lines: an
        attempt at a block of evaluations {"mode", "candidate" (the first), "candidates" (how many), "episode", "episodes",
        "server", "attempt", "steps" (unless offloaded), "started", "seconds", "error"}, or {"warning"}.
        on_progress(done, total, waiting_for) is called about ten times a second; KeyboardInterrupt is raised promptly.
        Raises EngineError: no server for too long, or every server refuses the work.
        """
    def close(self) -> None:
        """End the runs that are left, free the servers, disconnect."""
