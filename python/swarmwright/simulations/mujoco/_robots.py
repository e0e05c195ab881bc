"""Robots in MuJoCo: the arena, rovers, quadrotors, and the arena's missions."""

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
from swarmwright.simulations.physics import Physics, PushedObject, RobotModel, World

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


_TOP_WHEEL_SPEED_RAD_S = 10.0
"""Highest speed of a wheel, radians per second."""
_SPEED = 0.5
"""Highest speed of a rover, metres per second."""
_ROVER = """
<body name="robot{i}" pos="0 0 0.051">
  <freejoint/>
  <geom type="box" size="0.1 0.07 0.03" mass="1" material="robot"/>
  <geom type="box" size="0.02 0.03 0.01" pos="0.08 0 0.035" mass="0.01" material="nose" group="2"/>
  {casters}
  <body name="left{i}" pos="0 0.085 0"><joint name="left{i}" axis="0 1 0" armature="0.001"/>{wheel}</body>
  <body name="right{i}" pos="0 -0.085 0"><joint name="right{i}" axis="0 1 0" armature="0.001"/>{wheel}</body>
</body>
"""
# With MuJoCo's harder default contacts, accelerating rovers hop.
_CASTERS = "".join(
    f'<geom type="sphere" size="0.02" pos="{x} 0 -0.028" mass="0.02" material="dark" group="2" condim="1" '
    'solref="0.04 1"/>'
    for x in (0.08, -0.08)
)
_WHEEL = (
    '<geom type="ellipsoid" size="0.05 0.015 0.05" mass="0.1" material="dark" group="2" solref="0.04 1"/>'
)


class Rovers(Robots):
    """Rovers gather from random positions, around pillars.

    Sensors (12): 8 range sensors around the rover, beginning ahead, counterclockwise, 0 (nothing within
    `range`) to 1 (touching); cosine and sine of the bearing to the middle of all rovers, 0 for straight
    ahead; the distance to it over the arena's longer side; the speed ahead, 1 at full speed.
    Actuators (2): speed of the left and of the right wheel, 1 is 0.5 m/s ahead.
    Fitness: minus the distance of rovers from their middle, metres, the mean over the last quarter of the
    episode.
    """

    title = "mujoco rovers"
    sensors = SECTORS + 4
    actuators = 2
    sensor_names = (*RANGES, "bearing cosine", "bearing sine", "distance", "speed")
    actuator_names = ("left wheel", "right wheel")
    sensor_ranges = (*(None,) * (SECTORS + 3), (-_SPEED, _SPEED, "m/s"))
    actuator_ranges = ((-_SPEED, _SPEED, "m/s"), (-_SPEED, _SPEED, "m/s"))
    metrics = {  # noqa: RUF012 - as in the base class
        "distance": "Mean distance of rovers from their middle at the end, metres.",
        "touching": "Share of rovers that touch anything but the floor, mean over the episode.",
    }
    physics_step, physics_steps = 0.01, 10
    clear = 0.25  # transparent walls do not hide robots
    radius, clearance = 0.12, 0.2

    def robot(self, number: int) -> str:
        """Return the body of a rover."""
        return _ROVER.format(i=number, wheel=_WHEEL, casters=_CASTERS)

    def motors(self, number: int) -> str:
        """Return the motors of the wheels: speed servos with at most 0.2 N m."""
        limits = (
            f'kv="0.2" ctrlrange="-{_TOP_WHEEL_SPEED_RAD_S} {_TOP_WHEEL_SPEED_RAD_S}" forcerange="-0.2 0.2"'
        )
        return "".join(f'<velocity joint="{side}{number}" {limits}/>' for side in ("left", "right"))

    def start(self, places: Numbers, headings: Numbers) -> None:
        """Place rovers on their wheels."""
        super().start(places, headings)
        self.data.qpos[self._free[:, 2]] = 0.05

    def prepare(self) -> None:
        """Reset the counters."""
        self._sum, self._counted, self._touched = 0.0, 0, 0.0

    def step(self, actions: NDArray[np.float32]) -> Numbers:
        """Advance by one step of control."""
        self.data.ctrl[:] = _TOP_WHEEL_SPEED_RAD_S * actions.ravel()
        mujoco.mj_step(self.model, self.data, self.physics_steps)
        self.remaining_steps -= 1
        self._touched += float(self.touching().mean())
        if self.late:
            self._sum += self._distance()
            self._counted += 1
        return self.look()

    def look(self) -> Numbers:
        """Return the sensor values."""
        places, ahead = self.positions()[:, :2], self.frames()[:, :2, 0]
        headings = np.arctan2(ahead[:, 1], ahead[:, 0])
        way = places.mean(axis=0) - places
        bearing = np.arctan2(way[:, 1], way[:, 0]) - headings
        speed = (self.data.qvel[self._speeds] * ahead).sum(axis=1)
        side = max(self.arena.width, self.arena.depth)
        rest = (np.cos(bearing), np.sin(bearing), np.hypot(way[:, 0], way[:, 1]) / side, speed / _SPEED)
        return np.column_stack([self.read_ranges(headings), *rest])

    @property
    def message(self) -> str:
        """Caption of a picture."""
        return f"{self._distance():.2f} m from the middle"

    def fitness(self) -> float:
        """Return minus the mean distance from the middle in the last quarter."""
        return -self._sum / self._counted if self._counted else -self._distance()

    def measure(self) -> dict[str, float]:
        """Return the metrics."""
        return {
            "distance": self._distance(),
            "touching": self._touched / max(self.steps - self.remaining_steps, 1),
        }

    def _distance(self) -> float:
        way = self.positions()[:, :2]
        way = way - way.mean(axis=0)
        return float(np.hypot(way[:, 0], way[:, 1]).mean())

    def _make(self, parameters: dict[str, Any]) -> None:
        super()._make(parameters)
        first = self.model.jnt_dofadr[self.model.body_jntadr[self._bodies]]
        self._speeds = first[:, None] + np.arange(2)


_GRAVITY = 9.81
_MASS = 0.5  # kg
_INERTIA = np.array([0.0025, 0.0025, 0.0045])  # kg m^2
_ARM = 0.1  # rotors at (+-ARM, +-ARM), metres
_DRAG = 0.02  # torque about the axis for a thrust of 1 N, N m
_THRUST_N = 3.0  # thrust of a rotor, N
_TOP_SPEED_M_S = 1.0  # m/s
_HEIGHT = 1.0  # height of flight, metres

_QUADROTOR = """
<body name="robot{i}">
  <freejoint/>
  <inertial pos="0 0 0" mass="0.5" diaginertia="0.0025 0.0025 0.0045"/>
  <geom type="cylinder" size="0.18 0.03" rgba="0 0.45 0.7 0.25"/>
  <geom type="box" size="0.05 0.03 0.02" material="robot" group="2" contype="0" conaffinity="0"/>
  <geom type="box" size="0.012 0.012 0.012" pos="0.055 0 0" material="nose" group="2" contype="0"
    conaffinity="0"/>
  {rotors}
</body>
"""
_ROTORS = ((1, 1, 1), (-1, 1, -1), (-1, -1, 1), (1, -1, -1))
"""Position of each rotor in x and y, and the direction of its torque."""
_MIXER = np.linalg.inv([[1, _ARM * y, -_ARM * x, _DRAG * turn] for x, y, turn in _ROTORS]).T
"""(thrust, torque about x, y, z) -> thrusts of the rotors."""


class Quadrotors(Robots):
    """Quadrotors spread to see as much of the floor as possible; each sees a disc of the floor below it.

    An autopilot keeps a quadrotor upright, facing x, 1 m above the floor, at the commanded velocity. A
    quadrotor that touches anything falls down and stays there.

    Sensors (10): 8 range sensors around, beginning at x, counterclockwise, 0 (nothing within `range`) to 1
    (touching); the velocity in x and y, 1 at full speed.
    Actuators (2): the velocity in x and y, 1 is 1 m/s.
    Fitness: the share of the floor that is seen, the mean over the last quarter of the episode.
    """

    title = "mujoco quadrotors"
    sensors = SECTORS + 2
    actuators = 2
    sensor_names = (*RANGES, "velocity x", "velocity y")
    actuator_names = ("velocity x", "velocity y")
    sensor_units = (*("",) * SECTORS, "m/s", "m/s")  # 1 is 1 m/s
    actuator_units = ("m/s", "m/s")
    parameters = {  # noqa: RUF012 - as in the base class
        **Robots.parameters,
        "view": Parameter(
            1.2, "Radius of the disc that each sees below it, metres.", minimum=0.1, maximum=100.0
        ),
    }
    metrics = {  # noqa: RUF012 - as in the base class
        "covered": "Share of the floor that is seen at the end.",
        "crashed": "Quadrotors that touched something.",
        "closest": "The smallest distance between two flying quadrotors in the episode, metres.",
    }
    physics_step, physics_steps = 0.01, 10
    radius, clearance = 0.18, 0.3
    spread = 0.5
    clear = 0.25

    def robot(self, number: int) -> str:
        """Return the body of a quadrotor, with a site for each rotor."""
        rotors = "".join(
            f'<site name="rotor{number}{index}" pos="{x * _ARM} {y * _ARM} 0"/>'
            f'<geom type="cylinder" size="0.07 0.004" pos="{x * _ARM} {y * _ARM} 0.02" material="dark" '
            'group="2" contype="0" conaffinity="0"/>'
            for index, (x, y, _) in enumerate(_ROTORS)
        )
        return _QUADROTOR.format(i=number, rotors=rotors)

    def motors(self, number: int) -> str:
        """Return the rotors, each with a thrust and a proportional torque."""
        return "".join(
            f'<motor site="rotor{number}{index}" gear="0 0 1 0 0 {turn * _DRAG}" ctrlrange="0 {_THRUST_N}"/>'
            for index, (_, _, turn) in enumerate(_ROTORS)
        )

    def start(self, places: Numbers, headings: Numbers) -> None:
        """Place hovering quadrotors, all facing x."""
        super().start(places, 0 * headings)
        self._height = min(_HEIGHT, self.arena.height / 2)
        self.data.qpos[self._free[:, 2]] = self._height

    def prepare(self) -> None:
        """Reset the counters."""
        self._flies = np.full(self.agents, True)
        self._sum, self._counted, self._closest = 0.0, 0, np.inf
        self._closest = self._find_closest_distance()

    def step(self, actions: NDArray[np.float32]) -> Numbers:
        """Advance by one step of control."""
        for _ in range(self.physics_steps):
            self._steer(_TOP_SPEED_M_S * actions.astype(float))
            mujoco.mj_step(self.model, self.data)
            self._flies &= ~self._touches()
        self.remaining_steps -= 1
        self._closest = min(self._closest, self._find_closest_distance())
        if self.late:
            self._sum += self._measure_coverage()
            self._counted += 1
        return self.look()

    def acting(self) -> NDArray[np.bool_]:
        """Return which quadrotors fly."""
        return self._flies

    def look(self) -> Numbers:
        """Return the sensor values."""
        around = self.read_ranges(np.zeros(self.agents))
        return np.hstack([around, self.data.qvel[self._speeds[:, :2]] / _TOP_SPEED_M_S])

    @property
    def drawn_radius(self) -> float:
        """Radius of the disc that a quadrotor sees, metres."""
        return self._view

    def states(self) -> list[str]:
        """Return which quadrotors fly."""
        return ["free" if flies else "crashed" for flies in self._flies]

    @property
    def message(self) -> str:
        """Caption of a picture."""
        return f"{100 * self._measure_coverage():.0f} % of the floor is seen"

    def fitness(self) -> float:
        """Return the share of the floor that is seen, the mean of the last quarter."""
        return float(self._sum / self._counted) if self._counted else self._measure_coverage()

    def measure(self) -> dict[str, float]:
        """Return the metrics."""
        closest = self._closest if np.isfinite(self._closest) else 0.0
        crashed = float((~self._flies).sum())
        return {"covered": self._measure_coverage(), "crashed": crashed, "closest": closest}

    def _steer(self, velocities: Numbers) -> None:
        """Run the autopilots. velocities: commands, (agents, 2), m/s.

        A cascade from velocity to acceleration, to the direction of thrust, to torques. Lee, Leok,
        McClamroch, Geometric tracking control of a quadrotor UAV on SE(3), CDC 2010.
        """
        motion, axes = self.data.qvel[self._speeds], self.frames()
        climb = np.clip(self._height - self.positions()[:, 2], -1, 1)
        pull = np.clip(3.0 * (np.column_stack([velocities, climb]) - motion[:, :3]), -4, 4)
        pull[:, 2] += _GRAVITY
        up = axes[:, :, 2]
        thrust = _MASS * (pull * up).sum(axis=1)
        lean = np.cross(up, pull / np.linalg.norm(pull, axis=1, keepdims=True))
        lean[:, 2] -= np.arctan2(axes[:, 1, 0], axes[:, 0, 0])  # face x
        turn = (axes * lean[:, :, None]).sum(axis=1)  # in the axes of the robot
        torque = _INERTIA * (120.0 * turn - 20.0 * motion[:, 3:])
        forces = (np.column_stack([thrust, torque])[:, :, None] * _MIXER.T[None]).sum(axis=1)
        self.data.ctrl[:] = np.where(self._flies[:, None], np.clip(forces, 0, _THRUST_N), 0.0).ravel()

    def _touches(self) -> NDArray[np.bool_]:
        """Return which quadrotors touch anything, including floor and ceiling, (agents,)."""
        low = self.positions()[:, 2]
        touched: NDArray[np.bool_] = self.touching() | (low < 0.06) | (low > self.arena.height)
        return touched

    def _measure_coverage(self) -> float:
        """Return the share of the floor that flying quadrotors see."""
        places = self.positions()[self._flies, None, :2]
        is_visible = ((self._cells - places) ** 2).sum(axis=2) <= self._view**2
        return float(is_visible.any(axis=0).mean())

    def _find_closest_distance(self) -> float:
        """Return the smallest distance between flying quadrotors, infinite for fewer than two."""
        places = self.positions()[self._flies]
        if len(places) < 2:
            return float("inf")
        distances = ((places[:, None] - places[None]) ** 2).sum(axis=2)
        return float(np.sqrt(distances[~np.eye(len(places), dtype=bool)].min()))

    def _make(self, parameters: dict[str, Any]) -> None:
        super()._make(parameters)
        self._view: float = parameters["view"]
        self._speeds = self.model.jnt_dofadr[self.model.body_jntadr[self._bodies]][:, None] + np.arange(6)
        width, depth = self.arena.width, self.arena.depth
        x, y = (
            (np.arange(count) + 0.5) / count * size - size / 2 for count, size in ((40, width), (40, depth))
        )
        self._cells = np.stack(np.meshgrid(x, y), axis=2).reshape(1, -1, 2)


_STEP = 0.005
"""Seconds of a step of MuJoCo."""
_THICKNESS = 0.05
"""Thickness of walls, metres."""
_SERVO = 0.01
"""Seconds in which a drive reaches its speed unless its largest force limits it."""


class Missions(Physics):
    """Robots are cylinders that stay upright on the floor, and touch walls, objects and each other.

    Drives are speed servos along the robot, across it and around its axis. The forces of the first two are
    limited to the acceleration of the model's drive; the wheels of a differential drive resist being pushed
    sideways with the same force. Objects lie on the floor, with gravity and friction.
    """

    title = "arena-mujoco"
    determinism = "bitwise"

    def start(
        self,
        world: World,
        changed: bool,
        robots: NDArray[np.float32],
        objects: NDArray[np.float32],
        seed: int,  # noqa: ARG002 - there is no randomness
    ) -> None:
        """Start an episode."""
        if changed:
            self._model = mujoco.MjModel.from_xml_string(_xml(world))
            self._data = mujoco.MjData(self._model)
            self._parts = round(world.tick / _STEP)
            self._robots, self._heights = (
                len(robots),
                [pushed_object.height / 2 for pushed_object in world.objects],
            )
        mujoco.mj_resetData(self._model, self._data)
        at = 3 * self._robots
        self._data.qpos[:at] = robots.ravel()
        for (x, y, heading), height in zip(objects.tolist(), self._heights, strict=True):
            turned = (math.cos(heading / 2), 0.0, 0.0, math.sin(heading / 2))
            self._data.qpos[at : at + 7] = (x, y, height, *turned)
            at += 7
        mujoco.mj_forward(self._model, self._data)

    def step(self, motions: NDArray[np.float32]) -> None:
        """Advance by one tick."""
        self._data.ctrl[:] = motions.ravel()
        mujoco.mj_step(self._model, self._data, self._parts)

    def poses(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the poses of robots and objects."""
        at = 3 * self._robots
        objects = self._data.qpos[at:].reshape(-1, 7)
        w, x, y, z = objects[:, 3:].T
        heading = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
        return self._data.qpos[:at].reshape(-1, 3), np.column_stack([objects[:, :2], heading])


def _xml(world: World) -> str:
    bodies = [_robot(index, world.model(index)) for index in range(len(world.robots))]
    drives = [_drive(index, world.model(index)) for index in range(len(world.robots))]
    objects = [_object(index, pushed_object) for index, pushed_object in enumerate(world.objects)]
    walls = [
        f'<geom type="box" pos="{box.x} {box.y} {box.height / 2}" euler="0 0 {box.angle}" '
        f'size="{box.length / 2} {box.thickness / 2} {box.height / 2}"/>'
        for box in world.wall_boxes(_THICKNESS)
    ]
    return f"""<mujoco>
  <compiler angle="radian" autolimits="true"/>
  <option timestep="{_STEP}" integrator="implicitfast" cone="elliptic"/>
  <size memory="256M"/>
  <default><geom condim="3" friction="0.3 0.005 0.0001" priority="0"/></default>
  <worldbody>
    <geom name="floor" type="plane" size="0 0 1" contype="2" conaffinity="2"/>
    {"".join(walls)}
    {"".join(bodies)}
    {"".join(objects)}
  </worldbody>
  <actuator>{"".join(drives)}</actuator>
</mujoco>"""


def _robot(index: int, model: RobotModel) -> str:
    """Return the body of a robot, without gravity, so that it does not fall over."""
    half = model.height / 2
    return (
        f'<body name="robot{index}" gravcomp="1"><joint type="slide" axis="1 0 0"/>'
        '<joint type="slide" axis="0 1 0"/>'
        f'<joint type="hinge" axis="0 0 1"/><site name="robot{index}"/><geom type="cylinder" '
        f'pos="0 0 {half}" size="{model.radius} {half}" mass="{model.mass}"/></body>'
    )


def _drive(index: int, model: RobotModel) -> str:
    gain, most = model.mass / _SERVO, model.mass * model.acceleration
    inertia = model.mass * model.radius**2 / 2
    along, across, around = ("1 0 0 0 0 0", "0 1 0 0 0 0", "0 0 0 0 0 1")
    return "".join(
        f'<velocity site="robot{index}" gear="{axis}" kv="{gain}" forcerange="-{most} {most}"/>'
        for axis in (along, across)
    ) + (f'<velocity site="robot{index}" gear="{around}" kv="{inertia / _SERVO}"/>')


def _object(index: int, pushed: PushedObject) -> str:
    half = pushed.height / 2
    form = (
        f'type="cylinder" size="{pushed.radius} {half}"'
        if pushed.radius
        else f'type="box" size="{pushed.width / 2} {pushed.depth / 2} {half}"'
    )
    return (
        f'<body name="object{index}"><freejoint/><geom {form} mass="{pushed.mass}" contype="3" '
        f'conaffinity="3" '
        f'priority="1" friction="{pushed.friction} 0.005 0.0001"/></body>'
    )
