"""Base class of simulators that move the robots of missions, and the host that runs and checks their code."""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swarmwright.common.errors import InputError
from swarmwright.common.simulation_names import MISSIONS
from swarmwright.simulations.base import BatchSimulation, Simulation
from swarmwright.simulations.calls import Calls, check_methods, summarize
from swarmwright.simulations.host import Host, check_determinism


@dataclass(frozen=True)
class Wall:
    """A wall: a closed polygon."""

    points: NDArray[np.float32]
    """Corners counter-clockwise, (corners, 2), metres."""
    height: float
    """Height in metres."""


@dataclass(frozen=True)
class Patch:
    """A part of the floor with its own colour."""

    points: NDArray[np.float32]
    """Corners counter-clockwise, (corners, 2), metres."""
    grey: float
    """0 black to 1 white; below 0: black or white, drawn anew for each episode."""


@dataclass(frozen=True)
class Light:
    """A lamp."""

    x: float
    """Metres."""
    y: float
    """Metres."""
    z: float
    """Height, metres."""
    intensity: float
    """Relative to the reference model's lamp."""


@dataclass(frozen=True)
class RobotModel:
    """Properties of a kind of robot."""

    radius: float
    """Metres."""
    height: float
    """Metres."""
    mass: float
    """Kilograms."""
    wheel_base: float
    """Between the wheels of a differential drive, metres; 0 for other drives."""
    top_speed: float
    """Of a wheel or of the robot, m/s."""
    acceleration: float
    """Largest change of velocity by the drive, m/s^2."""
    rays: NDArray[np.float32]
    """Directions of proximity rays, radians counter-clockwise from ahead."""
    ray_start: float
    """Where rays begin, metres from the middle."""
    ray_range: float
    """How far they reach from there, metres."""


@dataclass(frozen=True)
class PushedObject:
    """Something that robots can push: a disc or a box."""

    radius: float
    """Of a disc, metres; 0 for a box."""
    width: float
    """Of a box along its heading, metres."""
    depth: float
    """Of a box across its heading, metres."""
    height: float
    """Metres."""
    mass: float
    """Kilograms."""
    friction: float
    """Coefficient of friction with the floor."""


@dataclass(frozen=True)
class WallBox:
    """A box that stands on the floor."""

    x: float
    """Of its middle, metres."""
    y: float
    """Of its middle, metres."""
    angle: float
    """Of its length, radians counter-clockwise from x."""
    length: float
    """Metres."""
    thickness: float
    """Metres."""
    height: float
    """Metres."""


def _boxes(wall: Wall, left: float) -> Iterator[WallBox]:
    """Yield a box for each side of a wall; left: thickness, to the left of the side's direction, metres."""
    for (x, y), (end_x, end_y) in zip(
        wall.points.tolist(), np.roll(wall.points, -1, 0).tolist(), strict=True
    ):
        length, angle = math.hypot(end_x - x, end_y - y), math.atan2(end_y - y, end_x - x)
        yield WallBox(
            (x + end_x) / 2 - math.sin(angle) * left / 2,
            (y + end_y) / 2 + math.cos(angle) * left / 2,
            angle,
            length,
            abs(left),
            wall.height,
        )


@dataclass(frozen=True)
class World:
    """The world of a mission; the same in all its episodes."""

    tick: float
    """Seconds of a step."""
    grey: float
    """Grey of the floor outside the patches, 0 black to 1 white."""
    walls: Sequence[Wall]
    """The first is the outline around the robots, the others are obstacles."""
    patches: Sequence[Patch]
    """For pictures, and for the simulator's own sensors; later patches cover earlier ones."""
    lights: Sequence[Light]
    """Lamps."""
    models: Sequence[RobotModel]
    """The kinds of robots."""
    robots: Sequence[int]
    """The model of each robot."""
    objects: Sequence[PushedObject]
    """Objects that robots can push."""

    def model(self, robot: int) -> RobotModel:
        """Return the model of a robot."""
        return self.models[self.robots[robot]]

    def wall_boxes(self, thickness: float) -> list["WallBox"]:
        """Return all walls as boxes of this thickness, metres: a box behind each face that robots touch."""
        return [
            box
            for index, wall in enumerate(self.walls)
            for box in _boxes(wall, thickness if index else -thickness)
        ]


class Physics(ABC):
    """A simulator that moves robots, with the missions, sensors and metrics of the simulation `arena`.

    An experiment names the class as its simulation; its parameters are those of the arena (mission, robots,
    robot, duration, failures, seed).

    The constructor takes no arguments. An episode is a call of `start`, then of `step` and `poses` for each
    tick. An exception ends the episode and fails its evaluation; the next episode begins with `start`.
    """

    title: str = ""
    """The name in discovery, `arena-NAME`; default: that of the class in small letters after `arena-`."""
    determinism: Literal["bitwise", "statistical", "none"] | None = None
    """Whether the same motions give the same poses, as in `Simulation`."""
    tolerance: float = 0.0
    """Where `determinism` is statistical: as in `Simulation`."""
    copies: bool = True
    """Whether a process can have several objects of this class."""

    @abstractmethod
    def start(
        self,
        world: World,
        changed: bool,
        robots: NDArray[np.float32],
        objects: NDArray[np.float32],
        seed: int,
    ) -> None:
        """Start an episode with robots and objects at rest.

        Args:
            world: the world to simulate.
            changed: whether the world differs from the previous episode's; true for the first episode.
            robots: poses, (robots, 3): x and y in metres, heading in radians counter-clockwise from x.
            objects: poses, (objects, 3), likewise.
            seed: seed of the episode, 0 to 2**64 - 1; the only source of randomness.

        Raises:
            swarmwright.InputError: the simulator does not support this world; the message is
                "name of the parameter: reason".
        """

    @abstractmethod
    def step(self, motions: NDArray[np.float32]) -> None:
        """Advance the world by one tick.

        Args:
            motions: (robots, 3): speed ahead and to the left in m/s, rotation in rad/s, including noise of
                the drive. In a differential drive, the speed of the left wheel is ahead - rotation *
                wheel_base / 2, and of the right wheel ahead + rotation * wheel_base / 2.
        """

    @abstractmethod
    def poses(self) -> tuple[ArrayLike, ArrayLike]:
        """Return the poses of robots and objects, (robots, 3) and (objects, 3), as in `start`."""

    def rays(self) -> ArrayLike | None:
        """Return the lengths of proximity rays from their start, (robots, most rays of a model), metres.

        A ray that hits nothing has the model's range. None, the default, lets the arena compute them from the
        poses, as at the start of each episode.
        """
        return None


def get_title(kind: type[Physics]) -> str:
    """Return the title of a class in discovery."""
    return kind.title or f"{MISSIONS}{kind.__name__.lower()}"


Numbers = NDArray[np.float32]

_NEEDS = "a simulator of missions needs start, step and poses"


def check(kind: type[Physics]) -> None:
    """Raise InputError if a class lacks methods, or its title does not have the prefix of missions."""
    title = get_title(kind)
    if not str(title).startswith(MISSIONS):
        raise InputError(f"{kind.__name__}.title: {summarize(title)} found, expected {MISSIONS}NAME")
    check_methods(kind, _NEEDS)


class PhysicsHost(Calls[Physics]):
    """An object of a simulator's class, for use by the engine.

    Args:
        kind: the class.
        report: called with (reason, traceback) of a failure, once for each reason.

    Raises InputError if the class's attributes are not valid.
    """

    _beginning = "start"
    _needs: ClassVar[str] = _NEEDS
    moves_robots = True
    """Tells the engine that this host runs missions."""

    def __init__(self, kind: type[Physics], report: Callable[[str, str], None] | None = None) -> None:
        super().__init__(kind, report)
        check(kind)
        self.title = get_title(kind)
        self.determinism, self.tolerance = check_determinism(kind.__name__, kind.determinism, kind.tolerance)
        self.copies = bool(kind.copies)
        self._object = self._make_object()
        self._world: World | None = None
        self._counts = (0, 0)
        self._most_rays = 0

    def another(self) -> "PhysicsHost":
        """Return a host with another object."""
        other = PhysicsHost(self._kind, self._report)
        other._share_reports(self)
        return other

    def start(
        self, world: Mapping[str, Any], changed: bool, robots: Numbers, objects: Numbers, seed: int
    ) -> None:
        """Start an episode; world: the engine's dictionary.

        Raises the engine's InputError if the simulator refuses, and SimulationError if its code fails.
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
        """Return the poses of robots and objects. Raises SimulationError if the code fails."""
        returned = self._call("poses")
        if not isinstance(returned, tuple) or len(returned) != 2:
            self._fail(
                f"poses: {summarize(returned)} returned, expected a tuple: poses of robots, poses of objects"
            )
        robots, objects = self._counts
        return self._rows("poses", returned[0], (robots, 3)), self._rows("poses", returned[1], (objects, 3))

    def rays(self) -> Numbers | None:
        """Return the lengths of rays; None if the arena computes them. Raises SimulationError."""
        returned = self._call("rays") if self._most_rays else None
        return None if returned is None else self._rows("rays", returned, (self._counts[0], self._most_rays))

    def _rows(self, method: str, returned: Any, shape: tuple[int, int]) -> Numbers:  # noqa: ANN401 - whatever it returns
        try:
            array = np.asarray(returned)
        except (TypeError, ValueError):  # ragged
            array = np.empty(0, object)
        if not shape[0] and not array.size:
            return np.empty(shape, np.float32)
        if array.dtype.kind not in "biuf" or array.shape != shape:
            description = f"{array.dtype} of the shape {array.shape}" if array.ndim else summarize(returned)
            self._fail(f"{method}: {description} returned, expected numbers of the shape {shape}")
        with np.errstate(over="ignore"):
            rows = np.ascontiguousarray(array, dtype=np.float32)
        wrong = np.argwhere(~np.isfinite(rows))
        if len(wrong):
            row, column = wrong[0].tolist()
            self._fail(
                f"{method}: number {column} of row {row} is {rows[row, column]}, expected a finite number"
            )
        return rows


def _world(plain: Mapping[str, Any]) -> World:
    def points(shape: Mapping[str, Any]) -> Numbers:
        return np.asarray(shape["points"], np.float32).reshape(-1, 2)

    return World(
        tick=plain["tick"],
        grey=plain["grey"],
        walls=[Wall(points(wall), wall["height"]) for wall in plain["walls"]],
        patches=[Patch(points(patch), patch["grey"]) for patch in plain["patches"]],
        lights=[Light(**light) for light in plain["lights"]],
        models=[
            RobotModel(**{**model, "rays": np.asarray(model["rays"], np.float32)})
            for model in plain["models"]
        ],
        robots=plain["robots"],
        objects=[PushedObject(**pushed) for pushed in plain["objects"]],
    )


Kind: TypeAlias = type[Simulation] | type[BatchSimulation] | type[Physics]
AnyHost: TypeAlias = Host | PhysicsHost


def make_host(kind: Kind, report: Callable[[str, str], None] | None = None) -> AnyHost:
    """Return a host of a class; report: see `Host`.

    Raises InputError if the class's attributes are not valid.
    """
    if issubclass(kind, Physics):
        return PhysicsHost(kind, report)
    return Host(kind, report)
