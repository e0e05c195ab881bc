"""What vehicles and traffic lights have in common: SUMO in this process, episodes, metrics, pictures."""

import contextlib
import io
from abc import abstractmethod
from collections.abc import Mapping
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmwright.common.errors import EpisodeError, InputError
from swarmwright.common.warn_once import warn_once
from swarmwright.display import Body, Scene, Wall
from swarmwright.simulations.base import Simulation
from swarmwright.simulations.parameters import Parameter
from swarmwright.simulations.sumo._files import Outputs, checked

_LARGEST_SEED = 0x7FFF_FFFF
HALTING = 0.1
"""Metres per second; slower vehicles wait, as in SUMO's own statistics."""


def _library() -> ModuleType:
    """Return SUMO; InputError where there is none."""
    try:
        # It prints a warning where pyarrow is not the version that it was built with, which only matters to
        # those who use both to write files.
        with contextlib.redirect_stdout(io.StringIO()):
            import libsumo
    except ModuleNotFoundError as error:
        raise InputError(f"{error.name} is not installed; pip install 'swarmwright[sumo]'") from error
    return libsumo  # type: ignore[no-any-return,unused-ignore]


class Traffic(Simulation):
    """Traffic of a SUMO configuration; who the agents are is left to subclasses.

    An agent acts every `interval` seconds, one or more steps of SUMO's. `libsumo.load` begins an episode,
    with SUMO's random numbers set by the episode's seed.
    """

    copies = False  # libsumo has one simulation in a process
    determinism = "bitwise"
    metrics = {  # noqa: RUF012 - as in the base class
        "speed": "Mean speed of the vehicles, m/s, over vehicles and steps; 0 before they can enter.",
        "waiting": "Seconds slower than 0.1 m/s or unable to enter, mean over all vehicles that were due.",
        "backlog": "Vehicles that were due but could not enter the network by the end.",
        "arrived": "Vehicles that have arrived.",
        "collisions": "Collisions, counted in each step of SUMO.",
        "teleported": "Vehicles that SUMO moved on, since they waited too long or collided.",
    }
    parameters: Mapping[str, Any] = {
        "config": Parameter("", "Path of the configuration, such as town.sumocfg."),
        "interval": Parameter(1.0, "Seconds from one action to the next.", minimum=0.01, maximum=60.0),
        "steps": Parameter(300, "Actions in an episode.", minimum=1),
    }

    def __init__(self) -> None:
        self.sumo = _library()
        self._config = ""
        self._outputs = Outputs()

    @abstractmethod
    def begin(self, parameters: dict[str, Any], lately: list[str]) -> NDArray[np.float64]:
        """Find the agents of an episode that has been loaded; return what they sense.

        lately: vehicles that have departed before the first action, sorted.
        """

    @abstractmethod
    def act(self, actions: NDArray[np.float32]) -> None:
        """Pass the agents' actions to SUMO."""

    @abstractmethod
    def look(self, lately: list[str]) -> NDArray[np.float64]:
        """Return what agents sense, (agents, sensors).

        lately: vehicles that have departed in this step, sorted.
        """

    def reset(self, parameters: dict[str, Any], seed: int) -> NDArray[np.float64]:
        """Go to the start of an episode."""
        if parameters["config"] != self._config or not self._config:
            self._read(parameters["config"])
        options = ["-c", str(self._path), "--seed", str((seed ^ seed >> 32) & _LARGEST_SEED)]
        options += [*self._files.options, *self._outputs.options]
        try:
            self.sumo.load([*options, "--no-step-log", "--no-warnings", "--duration-log.disable"])
        except self.sumo.TraCIException as error:
            raise InputError(f"config: {self._path}: SUMO reports: {_words(error)}") from None
        self.interval, self.steps = parameters["interval"], parameters["steps"]
        tick = self.sumo.simulation.getDeltaT()
        self._ticks = round(self.interval / tick)
        if self._ticks < 1 or abs(self._ticks * tick - self.interval) > 1e-6:
            raise InputError(
                f"interval: {self.interval:g} s found, expected a multiple of SUMO's step-length, {tick:g} s"
            )
        self._taken = 0
        self._speeds = self._seen = self._waited = self._departed = 0.0
        self._outside: set[str] = set()
        self._counts = dict.fromkeys(("arrived", "collisions", "teleported"), 0)
        self.vehicles: tuple[str, ...] = ()
        return self.begin(parameters, self._advance(1))  # vehicles depart in a step

    def step(self, actions: NDArray[np.float32]) -> NDArray[np.float64]:
        """Go on by `interval` seconds."""
        self.act(actions)
        lately = self._advance(self._ticks)
        self._taken += 1
        vehicle = self.sumo.vehicle
        speeds = [vehicle.getSpeed(one) for one in self.vehicles]
        self._speeds += sum(speeds)
        self._seen += len(speeds)
        self._waited += self.interval * sum(speed < HALTING for speed in speeds)
        # Vehicles that cannot enter stand, too: blocking the entry must not pay.
        self._outside |= set(self.sumo.simulation.getPendingVehicles())
        self._seen += len(self._outside)
        self._waited += self.interval * len(self._outside)
        return self.look(lately)

    def done(self) -> bool:
        """Return whether the time is over, or no vehicle is left and none will come."""
        return bool(self._taken == self.steps or self.sumo.simulation.getMinExpectedNumber() == 0)

    def measure(self) -> dict[str, float]:
        """Return the metrics."""
        return {
            "speed": self._speeds / max(self._seen, 1),
            "waiting": self._waited / max(self._departed + len(self._outside), 1),
            "backlog": len(self._outside),
            **self._counts,
        }

    def scene(self) -> Scene:
        """Return roads and vehicles as seen from above, in metres."""
        sumo = self.sumo
        (left, low), (right, high) = sumo.simulation.getNetBoundary()
        margin = 0.05 * max(right - left, high - low, 1.0)
        left, low = left - margin, low - margin

        def place(point: tuple[float, float]) -> tuple[float, float]:
            return point[0] - left, point[1] - low

        roads = [Wall([place(point) for point in sumo.lane.getShape(lane)]) for lane in sumo.lane.getIDList()]
        bodies = []
        for one in self.vehicles:
            x, y = place(sumo.vehicle.getPosition(one))
            bodies.append(Body("vehicle", x, y, self.state(one)))
        return Scene(
            right - left + margin,
            high - low + margin,
            self._taken,
            f"{self.title}, {sumo.simulation.getTime():.0f} s",
            bodies,
            walls=roads,
            origin=(left, low),
        )

    def state(self, vehicle: str) -> str:
        """Return what pictures call a vehicle: waiting or driving."""
        return "waiting" if self.sumo.vehicle.getSpeed(vehicle) < HALTING else "driving"

    @classmethod
    def notice_before_run(cls, parameters: Mapping[str, Any]) -> str | None:
        """Say which options of the configuration have no effect; one that cannot be read is refused later."""
        with contextlib.suppress(InputError):
            return checked(str(parameters.get("config", ""))).notice
        return None

    def _read(self, config: str) -> None:
        """Check the files of a configuration; say which of its options have no effect here."""
        self._files = checked(config)
        self._path, self._config = self._files.path, config
        if self._files.notice is not None:
            warn_once(self._files.notice)

    def _advance(self, ticks: int) -> list[str]:
        """Let SUMO go on; return the vehicles that have departed and are still there, sorted."""
        simulation, counts = self.sumo.simulation, self._counts
        departed: list[str] = []
        for _ in range(ticks):
            try:
                self.sumo.simulationStep()
            except self.sumo.TraCIException as error:
                raise EpisodeError(f"SUMO reports: {_words(error)}") from None
            departed += simulation.getDepartedIDList()
            counts["arrived"] += simulation.getArrivedNumber()
            counts["collisions"] += len(simulation.getCollisions())
            counts["teleported"] += simulation.getStartingTeleportNumber()
        self._departed += len(departed)
        self._outside.difference_update(departed)
        self.vehicles = self.sumo.vehicle.getIDList()
        there = set(self.vehicles)
        return sorted(one for one in departed if one in there)


def _words(error: Exception) -> str:
    return " ".join(str(error).split())
