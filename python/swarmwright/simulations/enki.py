"""E-pucks and Thymios in Enki, a fast two-dimensional robot simulator, and the arena's missions in Enki.

`swarmwright serve swarmwright.simulations.enki:EPucks`, or `simulation: swarmwright.simulations.enki:Thymios`
in an experiment. Enki is Debian's package python3-enki2, which needs Debian's version of Python.

Source: Magnenat, Waibel, Beyeler, Enki: The fast 2D robot simulator, https://github.com/enki-community/enki.
"""

import importlib.util
import sys
import sysconfig
from abc import abstractmethod
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swarmwright.common.errors import InputError
from swarmwright.display import Body, Scene
from swarmwright.simulations.attachment import find_free_position
from swarmwright.simulations.base import Simulation
from swarmwright.simulations.parameters import Parameter
from swarmwright.simulations.physics import Physics, PushedObject, World

_DEBIAN = Path("/usr/lib/python3/dist-packages")


def _library() -> Any:  # noqa: ANN401 - it has no types
    """Import Enki, if necessary from Debian's package. Raises InputError if it is missing."""
    try:
        import pyenki
    except ModuleNotFoundError:
        pass
    else:
        return pyenki
    # Only this file, because the folder's other packages may conflict with those of a virtual environment.
    file = _DEBIAN / f"pyenki{sysconfig.get_config_var('EXT_SUFFIX')}"
    if not file.is_file():
        other_versions = sorted(_DEBIAN.glob("pyenki.*.so"))
        version = f"{sys.version_info.major}.{sys.version_info.minor}"
        raise InputError(
            f"Enki is installed for Debian's Python, not for this Python {version}; serve the simulation "
            "from a separate environment: /usr/bin/python3 -m venv enki"
            if other_versions
            else "Enki is not installed; apt install python3-enki2"
        )
    spec = importlib.util.spec_from_file_location("pyenki", file)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    sys.modules["pyenki"] = module
    return module


enki = _library()


class Robots(Simulation):
    """Robots drive in an arena with pillars and avoid collisions.

    Sensors: one for each of the robot's proximity sensors, 0 (nothing in range) to 1 (touching).
    Actuators (2): speed of the left and of the right wheel, 1 is full speed ahead.
    Fitness: the mean over robots and steps of V (1 - sqrt(D)) (1 - S), where V is the mean speed of the
    wheels, D their difference, and S the largest sensor reading, each from 0 to 1. Floreano, Mondada,
    Automatic creation of an autonomous agent: genetic evolution of a neural-network driven robot, SAB 1994.

    Wheels and sensors are noisy. The seed sets all positions and the noise, but Enki steps objects in the
    order of their memory addresses, so that two runs may differ.
    """

    actuators = 2
    determinism = "none"
    step_seconds = 0.1
    copies = False  # the process has a single random number generator for noise
    metrics = {"touching": "Share of robots with something within 1 cm, mean over the episode."}  # noqa: RUF012
    parameters = {  # noqa: RUF012 - as in the base class
        "agents": Parameter(4, "Robots.", minimum=1, maximum=200),
        "size": Parameter(100.0, "Side of the arena, centimetres.", minimum=30.0, maximum=10_000.0),
        "pillars": Parameter(4, "Pillars of 5 cm radius, placed by the seed.", minimum=0, maximum=100),
        "steps": Parameter(300, "Steps of control in an episode, 0.1 s each.", minimum=1),
    }

    reach: ClassVar[float]
    """Range of proximity sensors, centimetres."""
    fastest: ClassVar[float]
    """Highest speed of a wheel, centimetres per second."""
    half: ClassVar[float]
    """Radius of a circle around the robot, centimetres."""

    @abstractmethod
    def robot(self) -> Any:  # noqa: ANN401 - one of Enki's
        """Return a new robot."""

    def reset(self, parameters: dict[str, Any], seed: int) -> NDArray[np.float64]:
        """Start an episode."""
        random = np.random.default_rng(seed)
        self.size, self.remaining_steps = parameters["size"], parameters["steps"]
        self.steps = self.remaining_steps
        self._sum = self._touched = 0.0
        self.world = enki.World(self.size, self.size)
        self.world.setRandomSeed((seed ^ seed >> 32) & 0x7FFF_FFFF)
        occupied: list[tuple[float, float, float]] = []
        self.pillars = []
        for _ in range(parameters["pillars"]):
            pillar = enki.CircularObject(5, 10, -1, enki.Color(0.4, 0.4, 0.4))
            pillar.pos = _place_body(random, occupied, self.size, 5, "pillars")
            self.pillars.append(pillar)
        self.robots = []
        for _ in range(parameters["agents"]):
            robot = self.robot()
            robot.pos = _place_body(random, occupied, self.size, self.half + 1, "agents")
            robot.angle = float(random.uniform(-np.pi, np.pi))
            self.robots.append(robot)
        for body in (*self.pillars, *self.robots):
            self.world.addObject(body)
        self.world.step(0.001)  # sensors have no values before the first step
        return self._read_sensors()

    def step(self, actions: NDArray[np.float32]) -> NDArray[np.float64]:
        """Advance by one step of control."""
        for robot, (left, right) in zip(self.robots, actions.tolist(), strict=True):
            robot.leftSpeed, robot.rightSpeed = self.fastest * left, self.fastest * right
        self.world.step(self.step_seconds, 3)
        self.remaining_steps -= 1
        readings = self._read_sensors()
        wheels = (actions.astype(float) + 1) / 2
        fast, differ = np.abs(actions).mean(axis=1), np.abs(wheels[:, 0] - wheels[:, 1])
        self._sum += float((fast * (1 - np.sqrt(differ)) * (1 - readings.max(axis=1))).mean())
        self._touched += float((readings.max(axis=1) > 1 - 1 / self.reach).mean())
        return readings

    def done(self) -> bool:
        """Return whether the time is over."""
        return bool(self.remaining_steps == 0)

    def fitness(self) -> float:
        """Return the mean of V (1 - sqrt(D)) (1 - S)."""
        return float(self._sum / max(self.steps - self.remaining_steps, 1))

    def measure(self) -> dict[str, float]:
        """Return the metrics."""
        return {"touching": self._touched / max(self.steps - self.remaining_steps, 1)}

    def scene(self) -> Scene:
        """Return the arena from above, in centimetres."""
        bodies = [Body("obstacle", x, y, "", 5.0) for x, y in (pillar.pos for pillar in self.pillars)]
        bodies += [Body("agent", x, y, "free", self.half) for x, y in (robot.pos for robot in self.robots)]
        return Scene(self.size, self.size, self.steps - self.remaining_steps, self.title, bodies)

    def _read_sensors(self) -> NDArray[np.float64]:
        distances = np.array([list(robot.proximitySensorDistances) for robot in self.robots])
        return 1 - np.clip(distances / self.reach, 0, 1)


class EPucks(Robots):
    """E-pucks, with 8 proximity sensors around."""

    title = "enki e-pucks"
    sensors = 8
    reach, fastest, half = 12.0, 12.8, 3.7

    def robot(self) -> Any:  # noqa: ANN401 - Enki's
        """Return an e-puck."""
        return enki.EPuck()


class Thymios(Robots):
    """Thymios II, with 5 proximity sensors in front and 2 behind."""

    title = "enki thymios"
    sensors = 7
    reach, fastest, half = 14.0, 16.6, 8.0

    def robot(self) -> Any:  # noqa: ANN401 - Enki's
        """Return a Thymio II."""
        return enki.Thymio2()


class Missions(Physics):
    """The arena's missions with Enki's e-pucks: with contacts, and motors with 5 % noise.

    Enki steps objects in the order of their memory addresses, so that two episodes may differ.
    """

    title = "arena-enki"
    determinism = "none"
    copies = False  # as above

    def start(
        self,
        world: World,
        changed: bool,
        robots: NDArray[np.float32],
        objects: NDArray[np.float32],
        seed: int,
    ) -> None:
        """Start an episode. Raises InputError for robots that are not e-pucks."""
        if changed:
            self._check(world)
        self._world = enki.World()
        self._world.setRandomSeed((seed ^ seed >> 32) & 0x7FFF_FFFF)
        for box in world.wall_boxes(_WALL):
            sides = (100 * box.length, 100 * box.thickness, 100 * box.height)
            self._add(enki.RectangularObject(*sides, -1, _GREY), box.x, box.y, box.angle)
        self._objects = [
            self._add(_make_pushed_object(pushed_object), *pose)
            for pushed_object, pose in zip(world.objects, objects.tolist(), strict=True)
        ]
        self._robots = [self._add(enki.EPuck(), *pose) for pose in robots.tolist()]
        self._tick, self._bases = world.tick, [model.wheel_base for model in world.models]
        self._models = world.robots

    def step(self, motions: NDArray[np.float32]) -> None:
        """Advance by one tick."""
        for robot, model, (ahead, _, turn) in zip(self._robots, self._models, motions.tolist(), strict=True):
            half = turn * self._bases[model] / 2
            robot.leftSpeed, robot.rightSpeed = 100 * (ahead - half), 100 * (ahead + half)
        self._world.step(self._tick, _PARTS)

    def poses(self) -> tuple[ArrayLike, ArrayLike]:
        """Return the poses of robots and objects."""
        return _read_poses(self._robots), _read_poses(self._objects)

    def _add(self, body: Any, x: float, y: float, angle: float) -> Any:  # noqa: ANN401 - Enki's
        body.pos, body.angle = (100 * x, 100 * y), angle
        self._world.addObject(body)
        return body

    @staticmethod
    def _check(world: World) -> None:
        for model in world.models:
            if not model.wheel_base or abs(model.radius - _EPUCK) > 0.005:
                raise InputError(
                    f"robot: a robot with a radius of {model.radius:.3g} m"
                    f"{'' if model.wheel_base else ' and without wheels'} found, but Enki simulates e-pucks; "
                    "expected a robot with a differential drive and a radius of 0.035 m, such as e-puck-rm1.1"
                )


_EPUCK = 0.035
"""Radius of an e-puck, metres."""
_WALL = 0.05
"""Thickness of walls, metres."""
_PARTS = 10
"""Physics steps in a tick."""
_GREY = enki.Color(0.4, 0.4, 0.4)


def _make_pushed_object(pushed: PushedObject) -> Any:  # noqa: ANN401 - Enki's
    """Return an object that robots push."""
    if pushed.radius:
        body = enki.CircularObject(100 * pushed.radius, 100 * pushed.height, pushed.mass, _GREY)
    else:
        body = enki.RectangularObject(
            100 * pushed.width, 100 * pushed.depth, 100 * pushed.height, pushed.mass, _GREY
        )
    body.dryFrictionCoefficient = pushed.friction
    return body


def _read_poses(bodies: list[Any]) -> ArrayLike:
    return [(body.pos[0] / 100, body.pos[1] / 100, body.angle) for body in bodies]


def _place_body(
    random: np.random.Generator,
    occupied: list[tuple[float, float, float]],
    size: float,
    clearance: float,
    name: str,
) -> tuple[float, float]:
    """Draw a free position in the arena, and mark it as occupied. Raises InputError if there is none."""

    def draw() -> tuple[float, float]:
        x, y = random.uniform(clearance, size - clearance, 2).tolist()
        return x, y

    def is_free(position: tuple[float, float]) -> bool:
        x, y = position
        return all((x - a) ** 2 + (y - b) ** 2 > (clearance + r) ** 2 for a, b, r in occupied)

    position = find_free_position(draw, is_free)
    if position is None:
        raise InputError(f"{name}: the arena is too small for all of them")
    occupied.append((*position, clearance))
    return position
