"""Shared code of rovers and quadrotors: the arena, the MuJoCo model, range sensors, contacts.

The arena is a floor with walls and obstacles. Coordinates are metres; x and y are 0 in its middle.
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
"""Largest number of positions that are tried for bodies."""


@dataclass(frozen=True)
class Arena:
    """A rectangle with round pillars.

    width, depth, height: in x, y and z. pillars: (x, y, radius) of fixed pillars.
    """

    width: float
    depth: float
    height: float
    pillars: tuple[tuple[float, float, float], ...]

    @classmethod
    def read(cls, raw: Mapping[str, Any]) -> Self:
        """Check and read the parameter `arena`. Raises InputError, "arena: reason"."""
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

        more: number of further pillars. radius: their radius.
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
                    f'size="{pillar_radius} {z}" material="pillar"/></body>'
                    for i, pillar_radius in enumerate(radii)
                ),
            ]
        )

    def draw_layout(
        self, random: np.random.Generator, more: int, radius: float, robots: int, size: float, spread: float
    ) -> tuple[Points, Points]:
        """Return positions of all pillars, and free random positions of robots.

        Args:
            random: the random number generator.
            more: number of further pillars.
            radius: their radius.
            robots: number of robots.
            size: free radius around the middle of each robot.
            spread: robots are placed within this share of the arena's sides, around the middle.

        Raises InputError if there is not enough space.
        """
        occupied = [(x, y, r) for x, y, r in self.pillars]
        half = np.array([self.width, self.depth]) / 2

        def draw_positions(count: int, clearance: float, share: float, name: str) -> Points:
            places: list[tuple[float, float]] = []
            for _ in range(_TRIED_PLACES):
                if len(places) == count:
                    break
                x, y = random.uniform(-1, 1, 2) * (half * share - clearance)
                if all((x - a) ** 2 + (y - b) ** 2 > (clearance + r) ** 2 for a, b, r in occupied):
                    places.append((x, y))
                    occupied.append((x, y, clearance))
            if len(places) < count:
                raise InputError(f"{name}: the arena is too small for {count} of them")
            return np.array(places).reshape(count, 2)

        if min(half) * spread <= size:
            raise InputError("arena: too small for robots")
        pillars = draw_positions(more, radius, 1.0, "pillars")
        robots_at = draw_positions(robots, size, spread, "agents")
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
"""Number of range sensors around a robot, and of the rays of each, whose nearest hit is used."""
RANGES = tuple(f"range {360 * sector // SECTORS} degrees" for sector in range(SECTORS))
"""Names of range sensors: counterclockwise from straight ahead, or from x."""
_VISIBLE_GROUPS = np.array([1, 0, 0, 1, 0, 0], np.uint8)
"""Groups of geoms that range sensors detect: all but the floor (1) and parts of robots (2)."""

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
    """Robots in an arena.

    Deterministic: the same parameters, seed and actions give bit-identical results on machines with the same
    MuJoCo and the same kind of processor.
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
    """Seconds of a physics step."""
    physics_steps: ClassVar[int]
    """Physics steps in a control step."""
    radius: ClassVar[float]
    """Radius of a robot, metres."""
    clearance: ClassVar[float]
    """Free distance around a robot's middle at the start, metres."""
    spread: ClassVar[float] = 1.0
    """Share of the arena's sides within which robots start."""
    clear: ClassVar[float] = 1.0
    """Opacity of the walls in pictures."""

    _made_for: dict[str, Any] | None = None

    def __init_subclass__(cls) -> None:
        """Reset inherited names, units and ranges of sensors or actuators if a class redefines these."""
        super().__init_subclass__()
        for kind in ("sensor", "actuator"):
            for about in ("names", "units", "ranges"):
                if f"{kind}s" in cls.__dict__ and f"{kind}_{about}" not in cls.__dict__:
                    setattr(cls, f"{kind}_{about}", ())

    @abstractmethod
    def robot(self, number: int) -> str:
        """Return the body of a robot, MJCF, named `robot{number}`, with a free joint."""

    @abstractmethod
    def motors(self, number: int) -> str:
        """Return the actuators of a robot, MJCF."""

    @abstractmethod
    def prepare(self) -> None:
        """Prepare an episode, after robots have been placed."""

    @abstractmethod
    def look(self) -> Numbers:
        """Return the sensor values, (agents, sensors)."""

    def reset(self, parameters: dict[str, Any], seed: int) -> Numbers:
        """Start an episode."""
        if parameters != self._made_for:
            self._make(parameters)
            self._made_for = dict(parameters)
        mujoco.mj_resetData(self.model, self.data)
        random = np.random.default_rng(seed)
        pillars, robots = self.arena.draw_layout(
            random, parameters["pillars"], PILLAR, self.agents, self.clearance, self.spread
        )
        self.data.mocap_pos[:, :2] = pillars
        self.data.mocap_pos[:, 2] = self.arena.height / 2
        headings = random.uniform(-np.pi, np.pi, self.agents)
        self.remaining_steps, self.steps = parameters["steps"], parameters["steps"]
        self.start(robots, headings)
        mujoco.mj_forward(self.model, self.data)
        self.prepare()
        return self.look()

    def start(self, places: Numbers, headings: Numbers) -> None:
        """Place robots on the floor. places: positions, (agents, 2); headings: radians."""
        state = self.data.qpos[self._free]
        state[:, :2] = places
        state[:, 3], state[:, 6] = np.cos(headings / 2), np.sin(headings / 2)
        self.data.qpos[self._free] = state

    def done(self) -> bool:
        """Return whether the time is over."""
        return bool(self.remaining_steps == 0)

    @property
    def late(self) -> bool:
        """Whether the last quarter of the episode has begun, which determines the fitness."""
        return bool(4 * self.remaining_steps <= self.steps)

    def positions(self) -> Numbers:
        """Return the positions of robots, (agents, 3)."""
        places: Numbers = self.data.xpos[self._bodies]
        return places

    def frames(self) -> Numbers:
        """Return the axes of robots as columns, (agents, 3, 3)."""
        axes: Numbers = self.data.xmat[self._bodies].reshape(-1, 3, 3)
        return axes

    def read_ranges(self, headings: Numbers) -> Numbers:
        """Return the values of range sensors, (agents, SECTORS): 0 for nothing in range, 1 for touching.

        The first sensor looks ahead, the others follow counterclockwise. headings: radians, (agents,).
        """
        hits = np.empty((self.agents, SECTORS * RAYS))
        geoms = np.empty(SECTORS * RAYS, np.int32)
        angles = headings[:, None] + self._angles
        rays = np.stack([np.cos(angles), np.sin(angles), np.zeros_like(angles)], axis=2)
        for agent, position in enumerate(self.positions()):
            mujoco.mj_multiRay(
                self.model, self.data, position, rays[agent].ravel(), _VISIBLE_GROUPS, 1, self._bodies[agent],
                geoms, hits[agent], None, len(geoms), self._range + self.radius,
            )  # fmt: skip
        free = np.where(hits < 0, self._range, hits - self.radius)
        nearest = free.reshape(self.agents, SECTORS, RAYS).min(axis=2)
        readings: Numbers = 1 - np.clip(nearest / self._range, 0, 1)
        return readings

    def touching(self) -> NDArray[np.bool_]:
        """Return which robots touch anything but the floor, (agents,)."""
        both = self._owner[self.data.contact.geom].reshape(-1, 2)
        met = (both[:, 0] != both[:, 1]) & (both.min(axis=1) >= _OTHER)
        touched = np.zeros(self.agents + 1, bool)
        touched[both[met].ravel()] = True  # other geoms have -1, the last
        return touched[:-1]

    def scene(self) -> Scene:
        """Return the arena from above."""
        half = np.array([self.arena.width, self.arena.depth]) / 2
        pillars = self.data.mocap_pos[:, :2] + half
        radii = self.model.geom_size[self.model.body_geomadr[self.model.body_mocapid >= 0], 0]
        bodies = [Body("obstacle", x, y, "", radius) for (x, y), radius in zip(pillars, radii, strict=True)]
        places = self.positions()[:, :2] + half
        robots = zip(places, self.states(), strict=True)
        bodies += [Body("agent", x, y, state, self.drawn_radius) for (x, y), state in robots]
        size, step = (self.arena.width, self.arena.depth), self.steps - self.remaining_steps
        return Scene(*size, step, self.message, bodies, origin=(-float(half[0]), -float(half[1])))

    @property
    def drawn_radius(self) -> float:
        """Radius of the disc that is drawn for a robot, metres."""
        return self.radius

    def states(self) -> list[str]:
        """Return the state of each robot: free or crashed."""
        return ["free"] * self.agents

    @property
    @abstractmethod
    def message(self) -> str:
        """Caption of a picture."""

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
        # The robot of a geom is the one with the same root body.
        roots = self.model.body_rootid[self.model.geom_bodyid]
        robot_of = {int(body): number for number, body in enumerate(self._bodies)}
        self._owner = np.array([robot_of.get(int(root), _OTHER) for root in roots])
        self._owner[self.model.geom("floor").id] = _FLOOR


_OTHER, _FLOOR = -1, -2
"""The owner of geoms that are not part of a robot."""
