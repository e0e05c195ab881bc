"""Runs the code of a user's simulator that moves the robots of missions: checks what it returns."""

from collections.abc import Callable, Mapping
from typing import Any, ClassVar, TypeAlias

import numpy as np
from numpy.typing import NDArray

from swarmwright.common.errors import InputError
from swarmwright.common.simulation_names import MISSIONS
from swarmwright.simulations.base import Simulation
from swarmwright.simulations.batches import BatchSimulation
from swarmwright.simulations.calls import Calls, check_methods, short
from swarmwright.simulations.description import check_determinism
from swarmwright.simulations.host import Host
from swarmwright.simulations.physics import (
    Light,
    Patch,
    Physics,
    PushedObject,
    RobotModel,
    Wall,
    World,
    title_of,
)

Numbers = NDArray[np.float32]

_NEEDS = "a simulator of missions needs start, step and poses"


def check(kind: type[Physics]) -> None:
    """Raise InputError where a class has another name than one of missions, or lacks methods."""
    title = title_of(kind)
    if not str(title).startswith(MISSIONS):
        raise InputError(f"{kind.__name__}.title: {short(title)} found, expected {MISSIONS}NAME")
    check_methods(kind, _NEEDS)


class PhysicsHost(Calls[Physics]):
    """One object of a simulator's class, as the engine uses it.

    Args:
        kind: the class.
        report: gets (reason, traceback) of a failure, once for each reason.

    Raises InputError when the class does not describe itself properly.

    """

    _beginning = "start"
    _needs: ClassVar[str] = _NEEDS
    moves_robots = True
    """Says to the engine which of both kinds of hosts this is."""

    def __init__(self, kind: type[Physics], report: Callable[[str, str], None] | None = None) -> None:
        super().__init__(kind, report)
        check(kind)
        self.title = title_of(kind)
        self.determinism, self.tolerance = check_determinism(kind.__name__, kind.determinism, kind.tolerance)
        self.copies = bool(kind.copies)
        self._object = self._made()
        self._world: World | None = None
        self._counts = (0, 0)
        self._most_rays = 0

    def another(self) -> "PhysicsHost":
        """Return a host with another object."""
        other = PhysicsHost(self._kind, self._report)
        other._reports_with(self)
        return other

    def start(
        self, world: Mapping[str, Any], changed: bool, robots: Numbers, objects: Numbers, seed: int
    ) -> None:
        """Begin an episode; world: as the engine gives it.

        Raises the engine's InputError where the simulator refuses, SimulationError when the code fails.
        """
        if changed:
            self._world = _world(world)
            self._most_rays = max(len(model.rays) for model in self._world.models)
        self._counts = (len(robots), len(objects))
        self._call("start", self._world, changed, robots, objects, seed)

    def step(self, motions: Numbers) -> None:
        """Advance by one tick. Raises SimulationError when the code fails."""
        self._call("step", motions)

    def poses(self) -> tuple[Numbers, Numbers]:
        """Return where all are. Raises SimulationError when the code fails."""
        returned = self._call("poses")
        if not isinstance(returned, tuple) or len(returned) != 2:
            self._fail(f"poses: {short(returned)} returned, expected those of robots and those of objects")
        robots, objects = self._counts
        return self._rows("poses", returned[0], (robots, 3)), self._rows("poses", returned[1], (objects, 3))

    def rays(self) -> Numbers | None:
        """Return what rays measure; None for what is to be computed. Raises SimulationError."""
        returned = self._call("rays") if self._most_rays else None
        return None if returned is None else self._rows("rays", returned, (self._counts[0], self._most_rays))

    def _rows(self, method: str, returned: Any, shape: tuple[int, int]) -> Numbers:  # noqa: ANN401 - whatever it returns
        try:
            given = np.asarray(returned)
        except (TypeError, ValueError):  # ragged
            given = np.empty(0, object)
        if not shape[0] and not given.size:
            return np.empty(shape, np.float32)
        if given.dtype.kind not in "biuf" or given.shape != shape:
            found = f"{given.dtype} of the shape {given.shape}" if given.ndim else short(returned)
            self._fail(f"{method}: {found} returned, expected numbers of the shape {shape}")
        with np.errstate(over="ignore"):
            rows = np.ascontiguousarray(given, dtype=np.float32)
        wrong = np.argwhere(~np.isfinite(rows))
        if len(wrong):
            row, column = wrong[0].tolist()
            self._fail(
                f"{method}: number {column} of row {row} is {rows[row, column]}, expected a finite number"
            )
        return rows


def _world(plain: Mapping[str, Any]) -> World:
    def points(one: Mapping[str, Any]) -> Numbers:
        return np.asarray(one["points"], np.float32).reshape(-1, 2)

    return World(
        tick=plain["tick"],
        grey=plain["grey"],
        walls=[Wall(points(one), one["height"]) for one in plain["walls"]],
        patches=[Patch(points(one), one["grey"]) for one in plain["patches"]],
        lights=[Light(**one) for one in plain["lights"]],
        models=[
            RobotModel(**{**one, "rays": np.asarray(one["rays"], np.float32)}) for one in plain["models"]
        ],
        robots=plain["robots"],
        objects=[PushedObject(**one) for one in plain["objects"]],
    )


Kind: TypeAlias = type[Simulation] | type[BatchSimulation] | type[Physics]
AnyHost: TypeAlias = Host | PhysicsHost


def hosted(kind: Kind, report: Callable[[str, str], None] | None = None) -> AnyHost:
    """Return a host of a class; report: as they take it.

    Raises InputError when the class does not describe itself properly.
    """
    if issubclass(kind, Physics):
        return PhysicsHost(kind, report)
    return Host(kind, report)
