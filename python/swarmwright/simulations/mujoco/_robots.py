"""What rovers and quadrotors have in common: a model made of parameters, range sensors, contacts.

The arena: a floor with walls around it and obstacles on it, and free places for robots.

x and y are 0 in the middle of the arena; metres.
"""

import math
from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Self

import mujoco
import numpy as np
from numpy.typing import NDArray

from swarmwright.common.errors import InputError
from swarmwright.display import Body, Scene
from swarmwright.simulations.base import Simulation
from swarmwright.simulations.parameters import Parameter

Points = NDArray[np.float64]  # (n, 2)

WALL = 0.05
"""Half the thickness of a wall."""
_KEYS = {"width", "depth", "height", "pillars"}
_TRIED_PLACES = 10_000
"""Places that are tried for a body before it is said that there is none."""


@dataclass(frozen=True)
class Arena:
    """A rectangle with round pillars in it.

    width, depth, height: in x, y and z. pillars: (x, y, radius) of each that is always at the same place.
    """

    width: float
    depth: float
    height: float
    pillars: tuple[tuple[float, float, float], ...]

    @classmethod
    def read(cls, raw: Mapping[str, Any]) -> Self:
        """Check the parameter `arena`. Raises InputError, "arena: why"."""
        unknown = sorted(set(raw) - _KEYS)
        if unknown:
            raise InputError(f"arena: {unknown[0]!r} found, expected {', '.join(sorted(_KEYS))}")
        width, depth, height = (
            _length(raw.get(name, default), f"arena: {name}", 0.5, 100)
            for name, default in (("width", 6), ("depth", 6), ("height", 3))
        )
        pillars = raw.get("pillars", ())
        if not isinstance(pillars, list | tuple):
            raise InputError(f"arena: pillars: {pillars!r} found, expected a list of [x, y, radius]")
        return cls(width, depth, height, tuple(_pillar(pillar, (width, depth)) for pillar in pillars))

    def xml(self, more: int, radius: float) -> str:
        """Return the static bodies of a MuJoCo model.

        more: additional pillars, anywhere. radius: of these.
        """
        x, y, z = self.width / 2, self.depth / 2, self.height / 2
        long = y + 2 * WALL
        walls = [(x + WALL, 0.0, WALL, long), (-x - WALL, 0.0, WALL, long)]
        walls += [(0.0, y + WALL, x, WALL), (0.0, -y - WALL, x, WALL)]
        radii = [pillar[2] for pillar in self.pillars] + [radius] * more
        return "\n".join(
            [
                '<light pos="0 0 9" dir="0.1 0.15 -1" diffuse="0.45 0.45 0.45" directional="true"/>',
                f'<geom name="floor" type="plane" size="{x + 1} {y + 1} 1" material="floor" group="1"/>',
                *(
                    f'<geom name="wall{i}" type="box" pos="{a} {b} {z}" size="{c} {d} {z}" material="wall"/>'
                    for i, (a, b, c, d) in enumerate(walls)
                ),
                *(
                    f'<body name="pillar{i}" mocap="true"><geom name="pillar{i}" type="cylinder" '
                    f'size="{one} {z}" material="pillar"/></body>'
                    for i, one in enumerate(radii)
                ),
            ]
        )

    def place(
        self, random: np.random.Generator, more: int, radius: float, robots: int, size: float, spread: float
    ) -> tuple[Points, Points]:
        """Return places of all pillars and of robots that are free, at random.

        Args:
            random: the random number generator.
            more: additional pillars.
            radius: of these.
            robots: how many.
            size: free radius around the middle of each robot.
            spread: robots are placed within this share of the arena's sides, around the middle.

        Raises InputError where there is not enough space.
        """
        taken = [(x, y, r) for x, y, r in self.pillars]
        half = np.array([self.width, self.depth]) / 2

        def found(count: int, clearance: float, share: float, name: str) -> Points:
            places: list[tuple[float, float]] = []
            for _ in range(_TRIED_PLACES):
                if len(places) == count:
                    break
                x, y = random.uniform(-1, 1, 2) * (half * share - clearance)
                if all((x - a) ** 2 + (y - b) ** 2 > (clearance + r) ** 2 for a, b, r in taken):
                    places.append((x, y))
                    taken.append((x, y, clearance))
            if len(places) < count:
                raise InputError(f"{name}: the arena is too small for {count} of them")
            return np.array(places).reshape(count, 2)

        if min(half) * spread <= size:
            raise InputError("arena: too small for robots")
        pillars = found(more, radius, 1.0, "pillars")
        robots_at = found(robots, size, spread, "agents")
        fixed = np.array([(x, y) for x, y, _ in self.pillars]).reshape(-1, 2)
        return np.vstack([fixed, pillars]), robots_at


def _length(value: Any, name: str, least: float, most: float) -> float:  # noqa: ANN401 - any JSON value
    if isinstance(value, bool) or not isinstance(value, int | float) or not least <= value <= most:
        raise InputError(f"{name}: {value!r} found, expected metres, from {least} to {most}")
    return float(value)


def _pillar(raw: Any, sizes: tuple[float, float]) -> tuple[float, float, float]:  # noqa: ANN401 - any JSON value
    fits = isinstance(raw, list | tuple) and len(raw) == 3
    if not fits or not all(isinstance(v, int | float) and math.isfinite(v) for v in raw) or raw[2] <= 0:
        raise InputError(f"arena: pillars: {raw!r} found, expected [x, y, radius] in metres")
    x, y, radius = (float(v) for v in raw)
    if abs(x) > sizes[0] / 2 or abs(y) > sizes[1] / 2:
        raise InputError(f"arena: pillars: {raw!r} is outside; (0, 0) is the middle of the arena")
    return x, y, radius


Numbers = NDArray[np.float64]

PILLAR = 0.25
"""Radius of pillars that are placed by the seed, metres."""
SECTORS, RAYS = 8, 3
"""Range sensors around a robot, and the rays of each, of which the nearest hit counts."""
RANGES = tuple(f"range {360 * sector // SECTORS} degrees" for sector in range(SECTORS))
"""Names of range sensors: counterclockwise from straight ahead, or from x."""
_SEEN = np.array([1, 0, 0, 1, 0, 0], np.uint8)
"""Groups of geoms that range sensors see: all but the floor (1), and what hangs on robots (2)."""

_MODEL = """
<mujoco model="swarm">
  <option timestep="{step}" integrator="implicitfast"/>
  <visual><global offwidth="1280" offheight="960"/><quality shadowsize="2048"/>
    <headlight ambient="0.35 0.35 0.35" diffuse="0.35 0.35 0.35"/></visual>
  <asset>
    <texture name="tiles" type="2d" builtin="checker" rgb1="0.93 0.93 0.91" rgb2="0.86 0.86 0.84" width="256"
      height="256"/>
    <material name="floor" texture="tiles" texrepeat="1 1" texuniform="true"/>
    <material name="wall" rgba="0.55 0.57 0.6 {clear}"/>
    <material name="pillar" rgba="0.35 0.37 0.4 0.6"/>
    <material name="robot" rgba="0 0.45 0.7 1"/>
    <material name="dark" rgba="0.13 0.13 0.13 1"/>
    <material name="nose" rgba="0.9 0.62 0 1"/>
  </asset>
  <worldbody>
    {arena}
    {robots}
  </worldbody>
  <actuator>
    {actuators}
  </actuator>
</mujoco>
"""


class Robots(Simulation):
    """Robots in an arena. Deterministic: the same parameters, seed and actions give the same bits.

    That holds on machines with the same MuJoCo and the same kind of processor.
    """

    dimensions = 3
    determinism = "bitwise"
    parameters = {  # noqa: RUF012 - as in the base class
        "agents": Parameter(6, "Robots.", minimum=1, maximum=100),
        "arena": Parameter(
            {},
            "width, depth (6), height (3), metres; pillars, a list of [x, y, radius], (0, 0) in the middle.",
        ),
        "pillars": Parameter(0, "Further pillars, placed by the seed.", minimum=0, maximum=100),
        "range": Parameter(2.5, "How far range sensors see, metres.", minimum=0.1, maximum=100.0),
        "steps": Parameter(150, "Steps of control in an episode, 0.1 s each.", minimum=1, maximum=100_000),
    }
    frame_seconds = 0.1

    physics_step: ClassVar[float]
    """Seconds of a step of the physics."""
    physics_steps: ClassVar[int]
    """Steps of the physics in a step of control."""
    radius: ClassVar[float]
    """Of a robot, metres."""
    clearance: ClassVar[float]
    """Distance from a robot's middle that is free at the start, metres."""
    spread: ClassVar[float] = 1.0
    """Share of the arena's sides in which robots begin."""
    clear: ClassVar[float] = 1.0
    """Opacity of the walls in pictures."""

    _made_of: dict[str, Any] | None = None

    def __init_subclass__(cls) -> None:
        """Forget names, units and ranges of inherited sensors or actuators where a class has others."""
        super().__init_subclass__()
        for which in ("sensor", "actuator"):
            for about in ("names", "units", "ranges"):
                if f"{which}s" in cls.__dict__ and f"{which}_{about}" not in cls.__dict__:
                    setattr(cls, f"{which}_{about}", ())

    @abstractmethod
    def robot(self, number: int) -> str:
        """Return the body of a robot, MJCF, named `robot{number}`, with a free joint."""

    @abstractmethod
    def motors(self, number: int) -> str:
        """Return the actuators of a robot, MJCF."""

    @abstractmethod
    def prepare(self) -> None:
        """Be ready for an episode, after robots have been placed."""

    @abstractmethod
    def look(self) -> Numbers:
        """Return what robots sense, (agents, sensors)."""

    def reset(self, parameters: dict[str, Any], seed: int) -> Numbers:
        """Go to the start of an episode."""
        if parameters != self._made_of:
            self._make(parameters)
            self._made_of = dict(parameters)
        mujoco.mj_resetData(self.model, self.data)
        random = np.random.default_rng(seed)
        pillars, robots = self.arena.place(
            random, parameters["pillars"], PILLAR, self.agents, self.clearance, self.spread
        )
        self.data.mocap_pos[:, :2] = pillars
        self.data.mocap_pos[:, 2] = self.arena.height / 2
        headings = random.uniform(-np.pi, np.pi, self.agents)
        self.left, self.steps = parameters["steps"], parameters["steps"]
        self.start(robots, headings)
        mujoco.mj_forward(self.model, self.data)
        self.prepare()
        return self.look()

    def start(self, places: Numbers, headings: Numbers) -> None:
        """Put robots on their places, on the floor. places: (agents, 2); headings: radians."""
        state = self.data.qpos[self._free]
        state[:, :2] = places
        state[:, 3], state[:, 6] = np.cos(headings / 2), np.sin(headings / 2)
        self.data.qpos[self._free] = state

    def done(self) -> bool:
        """Return whether the time is over."""
        return bool(self.left == 0)

    @property
    def late(self) -> bool:
        """Whether the last quarter of the episode has begun, which is what counts."""
        return bool(4 * self.left <= self.steps)

    def positions(self) -> Numbers:
        """Return where robots are, (agents, 3)."""
        places: Numbers = self.data.xpos[self._bodies]
        return places

    def frames(self) -> Numbers:
        """Return the axes of robots as columns, (agents, 3, 3)."""
        axes: Numbers = self.data.xmat[self._bodies].reshape(-1, 3, 3)
        return axes

    def near(self, headings: Numbers) -> Numbers:
        """Return what range sensors read, (agents, SECTORS): 0 for nothing in range, 1 for touching.

        The first looks ahead, the others follow counterclockwise. headings: radians, (agents,).
        """
        hits = np.empty((self.agents, SECTORS * RAYS))
        geoms = np.empty(SECTORS * RAYS, np.int32)
        angles = headings[:, None] + self._angles
        rays = np.stack([np.cos(angles), np.sin(angles), np.zeros_like(angles)], axis=2)
        for agent, place in enumerate(self.positions()):
            mujoco.mj_multiRay(
                self.model, self.data, place, rays[agent].ravel(), _SEEN, 1, self._bodies[agent], geoms,
                hits[agent], None, len(geoms), self._range + self.radius,
            )  # fmt: skip
        free = np.where(hits < 0, self._range, hits - self.radius)
        nearest = free.reshape(self.agents, SECTORS, RAYS).min(axis=2)
        readings: Numbers = 1 - np.clip(nearest / self._range, 0, 1)
        return readings

    def touching(self) -> NDArray[np.bool_]:
        """Return which robots touch anything but the floor, (agents,)."""
        both = self._owner[self.data.contact.geom].reshape(-1, 2)
        met = (both[:, 0] != both[:, 1]) & (both.min(axis=1) >= _THING)
        touched = np.zeros(self.agents + 1, bool)
        touched[both[met].ravel()] = True  # other geoms have -1, the last
        return touched[:-1]

    def scene(self) -> Scene:
        """Return what the arena looks like from above."""
        half = np.array([self.arena.width, self.arena.depth]) / 2
        pillars = self.data.mocap_pos[:, :2] + half
        radii = self.model.geom_size[self.model.body_geomadr[self.model.body_mocapid >= 0], 0]
        bodies = [Body("obstacle", x, y, "", radius) for (x, y), radius in zip(pillars, radii, strict=True)]
        places = self.positions()[:, :2] + half
        seen = zip(places, self.states(), strict=True)
        bodies += [Body("agent", x, y, state, self.drawn) for (x, y), state in seen]
        size, step = (self.arena.width, self.arena.depth), self.steps - self.left
        return Scene(*size, step, self.message, bodies, origin=(-float(half[0]), -float(half[1])))

    @property
    def drawn(self) -> float:
        """Radius of the disc that is drawn for a robot, metres."""
        return self.radius

    def states(self) -> list[str]:
        """Return how each robot fares: free, or crashed."""
        return ["free"] * self.agents

    @property
    @abstractmethod
    def message(self) -> str:
        """The line above a picture."""

    def _make(self, parameters: dict[str, Any]) -> None:
        """Build the model."""
        self.agents = parameters["agents"]
        self._range = parameters["range"]
        self.arena = Arena.read(parameters["arena"])
        numbers = range(self.agents)
        self.model = mujoco.MjModel.from_xml_string(
            _MODEL.format(
                step=self.physics_step,
                clear=self.clear,
                arena=self.arena.xml(parameters["pillars"], PILLAR),
                robots="\n".join(self.robot(number) for number in numbers),
                actuators="\n".join(self.motors(number) for number in numbers),
            )
        )
        self.data = mujoco.MjData(self.model)
        self._bodies = np.array([self.model.body(f"robot{number}").id for number in numbers])
        first = self.model.jnt_qposadr[self.model.body_jntadr[self._bodies]]
        self._free = first[:, None] + np.arange(7)
        offsets = (np.arange(SECTORS * RAYS) - (RAYS - 1) / 2) / RAYS
        self._angles = offsets * 2 * np.pi / SECTORS
        # Which robot a geom belongs to: its root body is the robot's.
        roots = self.model.body_rootid[self.model.geom_bodyid]
        robot_of = {int(body): number for number, body in enumerate(self._bodies)}
        self._owner = np.array([robot_of.get(int(root), _THING) for root in roots])
        self._owner[self.model.geom("floor").id] = _FLOOR


_THING, _FLOOR = -1, -2
"""The owner of geoms that are not part of a robot."""
