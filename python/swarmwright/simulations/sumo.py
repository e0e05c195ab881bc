"""Traffic in SUMO as a swarm: vehicles, or traffic lights, are the agents.

`simulation: swarmwright.simulations.sumo:Vehicles`, or `:TrafficLights`, with `parameters: {config:
town.sumocfg}`. SUMO runs in the same process (libsumo), `pip install 'swarmwright[sumo]'`.

Source: Alvarez Lopez et al., Microscopic Traffic Simulation using SUMO, ITSC 2018, https://sumo.dlr.de.
"""

import contextlib
import io
import re
from abc import abstractmethod
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
from numpy.typing import NDArray

from swarmwright.common.errors import EpisodeError, InputError
from swarmwright.common.temporary import TemporaryFolder
from swarmwright.common.warn_once import warn_once
from swarmwright.display import Body, Scene, Wall
from swarmwright.simulations.base import Simulation
from swarmwright.simulations.parameters import Parameter

_INPUTS = ("net-file", "route-files", "additional-files")
_SHORT = {"n": "net-file", "net": "net-file", "r": "route-files", "a": "additional-files", "l": "log"}
_OUTPUT = re.compile(
    r".*-output|.*\.output|netstate-dump|log|message-log|error-log|pedestrian\.jupedsim\.(?:wkt|py)|save-.*"
)
"""Options that name output files, or times at which files are written."""
_OUTPUT_OF_A_DEVICE = re.compile(r"device\.(?:ssm|toc)\.file")
_SWITCHED_OFF = {
    "random": ("false", ("", "0", "false", "no", "off", "f", "n", "-")),
    "remote-port": ("0", ("", "0")),
    "gui-settings-file": ("", ("",)),
}
"""Options that prevent repeatability or lock-step -> the value they are set to, and harmless values."""
_NOWHERE = "NUL"
"""SUMO's name, on every system, of a file that discards output."""
_UP = "../" * 64
"""Relative path to the root of the file system from any folder."""


@dataclass(frozen=True)
class Configuration:
    """A SUMO configuration with readable files."""

    path: Path
    options: tuple[str, ...]
    """Further options that make episodes repeatable, isolated and in lock-step."""
    overridden: tuple[str, ...]
    """The options and the elements of additional files that therefore have no effect."""

    @property
    def notice(self) -> str | None:
        """Notice about overridden options; None if there are none."""
        if not self.overridden:
            return None
        return (
            f"config: {self.path}: these have no effect: {', '.join(self.overridden)}; episodes depend only "
            "on their seed, run in lock-step, and write no files"
        )


def read_configuration(config: str) -> Configuration:
    """Read a configuration, and check its network, routes and additional files.

    Raises InputError, "config: reason".
    """
    if not config:
        raise InputError("config: missing; expected the path of a SUMO configuration, such as town.sumocfg")
    path = Path(config).absolute()
    options_by_name = {
        _SHORT.get(element.tag, element.tag): element.get("value") or element.get("v") or ""
        for element in _parse(path).iter()
    }
    if "net-file" not in options_by_name:
        raise InputError(f"config: {path}: does not name a net-file")
    overridden, options = [], []
    for name, (value, harmless) in _SWITCHED_OFF.items():
        options += [f"--{name}", value]
        if options_by_name.get(name, "").strip().lower() not in harmless:
            overridden.append(name)
    for name, value in options_by_name.items():
        if value and _OUTPUT.fullmatch(name) and _names_a_file(name):
            options += [f"--{name}", "" if name.startswith("save-") else _NOWHERE]
            overridden.append(name)
        elif value and _OUTPUT_OF_A_DEVICE.fullmatch(name):
            overridden.append(name)
    for name in _INPUTS:
        for file in options_by_name.get(name, "").replace(",", " ").split():
            root = _parse(path.parent / file)
            if name == "additional-files":
                overridden += _detectors(root)
    return Configuration(path, tuple(options), tuple(dict.fromkeys(overridden)))


def _names_a_file(name: str) -> bool:
    """Return whether an option with the name of an output names a file, rather than a detail."""
    return not name.startswith("save-") or name in {
        "save-state.times", "save-state.files", "save-configuration", "save-template", "save-schema",
    }  # fmt: skip


def _detectors(root: ET.Element) -> Iterator[str]:
    """Yield the elements of additional files that write files."""
    for element in root.iter():
        written = element.get("file") if element.tag not in _READ else None
        if (written or element.get("dest")) not in {None, "", _NOWHERE, "/dev/null"}:
            yield f"{element.tag} {element.get('id', '')}".strip()


_READ = frozenset({"variableSpeedSign", "calibrator", "include", "rerouter", "poi", "poly"})
"""Elements whose `file` is read."""


class Outputs:
    """A private folder for remaining output of SUMO: that of detectors and devices."""

    def __init__(self) -> None:
        self._folder = TemporaryFolder("sumo")
        folder = str(self._folder.path)
        # SUMO inserts the prefix between the folder and the name of each output file.
        self.options = ("--output-prefix", f"{_UP}{folder.lstrip('/')}/")


def _parse(path: Path) -> ET.Element:
    """Return the root of an XML file; an empty element if it is compressed, which SUMO supports."""
    try:
        if path.exists() and not path.is_file():
            raise InputError(f"config: {path}: is not a file")
        with path.open("rb") as file:
            if file.read(2) == b"\x1f\x8b":
                return ET.Element("compressed")
            file.seek(0)
            return ET.parse(file).getroot()  # noqa: S314 - SUMO reads it, too
    except OSError as error:
        raise InputError(f"config: {path}: {error.strerror}") from None
    except ValueError:  # not a path
        raise InputError(f"config: {str(path)!r}: is not a path") from None
    except ET.ParseError as error:
        raise InputError(f"config: {path}: not valid XML: {error}") from None


_LARGEST_SEED = 0x7FFF_FFFF
HALTING = 0.1
"""Speed in metres per second below which vehicles are waiting, as in SUMO's own statistics."""


def _library() -> ModuleType:
    """Import SUMO. Raises InputError if it is not installed."""
    try:
        # It prints a warning about the version of pyarrow, which is only relevant for writing files with
        # both.
        with contextlib.redirect_stdout(io.StringIO()):
            import libsumo
    except ModuleNotFoundError as error:
        raise InputError(f"{error.name} is not installed; pip install 'swarmwright[sumo]'") from error
    return libsumo  # type: ignore[no-any-return,unused-ignore]


class Traffic(Simulation):
    """Traffic of a SUMO configuration; subclasses define the agents.

    An agent acts every `interval` seconds, one or more steps of SUMO. `libsumo.load` starts an episode, with
    SUMO's random numbers seeded by the episode's seed.
    """

    copies = False  # libsumo allows a single simulation in a process
    determinism = "bitwise"
    metrics = {  # noqa: RUF012 - as in the base class
        "speed": "Mean speed of the vehicles, m/s, over vehicles and steps; 0 before they can enter.",
        "waiting": "Seconds slower than 0.1 m/s or unable to enter, mean over all vehicles that were due.",
        "backlog": "Vehicles that were due but could not enter the network by the end.",
        "arrived": "Vehicles that have arrived.",
        "collisions": "Collisions, counted in each step of SUMO.",
        "teleported": "Vehicles that SUMO moved because they waited too long or collided.",
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
        """Find the agents of a loaded episode; return their sensor values.

        lately: vehicles that have departed before the first action, sorted.
        """

    @abstractmethod
    def act(self, actions: NDArray[np.float32]) -> None:
        """Pass the agents' actions to SUMO."""

    @abstractmethod
    def look(self, lately: list[str]) -> NDArray[np.float64]:
        """Return the sensor values, (agents, sensors).

        lately: vehicles that have departed in this step, sorted.
        """

    def reset(self, parameters: dict[str, Any], seed: int) -> NDArray[np.float64]:
        """Start an episode."""
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
        self._steps_taken = 0
        self._speeds = self._vehicle_samples = self._waited = self._departed = 0.0
        self._outside: set[str] = set()
        self._counts = dict.fromkeys(("arrived", "collisions", "teleported"), 0)
        self.vehicles: tuple[str, ...] = ()
        return self.begin(parameters, self._advance(1))  # vehicles depart in a step

    def step(self, actions: NDArray[np.float32]) -> NDArray[np.float64]:
        """Advance by `interval` seconds."""
        self.act(actions)
        lately = self._advance(self._ticks)
        self._steps_taken += 1
        vehicle = self.sumo.vehicle
        speeds = [vehicle.getSpeed(vehicle_id) for vehicle_id in self.vehicles]
        self._speeds += sum(speeds)
        self._vehicle_samples += len(speeds)
        self._waited += self.interval * sum(speed < HALTING for speed in speeds)
        # Vehicles that cannot enter are waiting, too, so that blocking the entry does not improve the
        # fitness.
        self._outside |= set(self.sumo.simulation.getPendingVehicles())
        self._vehicle_samples += len(self._outside)
        self._waited += self.interval * len(self._outside)
        return self.look(lately)

    def done(self) -> bool:
        """Return whether the time is over, or no vehicle is left and none will come."""
        return bool(self._steps_taken == self.steps or self.sumo.simulation.getMinExpectedNumber() == 0)

    def measure(self) -> dict[str, float]:
        """Return the metrics."""
        return {
            "speed": self._speeds / max(self._vehicle_samples, 1),
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

        def to_picture(point: tuple[float, float]) -> tuple[float, float]:
            return point[0] - left, point[1] - low

        roads = [
            Wall([to_picture(point) for point in sumo.lane.getShape(lane)]) for lane in sumo.lane.getIDList()
        ]
        bodies = []
        for vehicle in self.vehicles:
            x, y = to_picture(sumo.vehicle.getPosition(vehicle))
            bodies.append(Body("vehicle", x, y, self.state(vehicle)))
        return Scene(
            right - left + margin,
            high - low + margin,
            self._steps_taken,
            f"{self.title}, {sumo.simulation.getTime():.0f} s",
            bodies,
            walls=roads,
            origin=(left, low),
        )

    def state(self, vehicle: str) -> str:
        """Return the state of a vehicle in pictures: waiting or driving."""
        return "waiting" if self.sumo.vehicle.getSpeed(vehicle) < HALTING else "driving"

    @classmethod
    def notice_before_run(cls, parameters: Mapping[str, Any]) -> str | None:
        """Return a notice about options without effect; an unreadable configuration is refused later."""
        with contextlib.suppress(InputError):
            return read_configuration(str(parameters.get("config", ""))).notice
        return None

    def _read(self, config: str) -> None:
        """Check the files of a configuration, and warn about options without effect."""
        self._files = read_configuration(config)
        self._path, self._config = self._files.path, config
        if self._files.notice is not None:
            warn_once(self._files.notice)

    def _advance(self, ticks: int) -> list[str]:
        """Advance SUMO; return the vehicles that have departed and are still present, sorted."""
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
        present = set(self.vehicles)
        return sorted(vehicle for vehicle in departed if vehicle in present)


def _words(error: Exception) -> str:
    return " ".join(str(error).split())


_FOR_EVER_S = 1e6
"""Seconds of a phase that ends only by a change."""
_VEHICLE_M = 7.5
"""Metres of a lane that a waiting vehicle occupies."""
_LONG_WAIT_S = 60.0
"""Seconds of green at which the sensor of green time is 1."""


@dataclass(frozen=True)
class _Green:
    """Lanes of a green phase: those with green, those with red, and the exits of the former."""

    driving: tuple[str, ...]
    waiting: tuple[str, ...]
    exits: tuple[str, ...]


class TrafficLights(Traffic):
    """Traffic lights that change to the next green phase when their controllers decide.

    Phases, their order, and the yellow times are those of the network's program; the controller determines
    the duration of green, at least `green`.

    Sensors: occupancy of the lanes with green by waiting vehicles; the same for lanes with red; occupancy of
    the exit lanes of those with green; time since the beginning of green, in minutes, at most 1.
    Actuators: above 0 change to the next green phase.
    Fitness: minus the mean waiting time of a vehicle in seconds.

    Source of the task: Gershenson, Self-organizing traffic lights, Complex Systems 16, 2005.
    """

    title = "sumo traffic lights"
    sensors, actuators = 4, 1
    sensor_names = ("waiting at green", "waiting at red", "taken behind", "green time")
    actuator_names = ("change",)
    parameters = {  # noqa: RUF012 - as in the base class
        **Traffic.parameters,
        "green": Parameter(5.0, "Seconds that a green phase lasts, at least.", minimum=0.0, maximum=600.0),
    }

    def begin(self, parameters: dict[str, Any], lately: list[str]) -> NDArray[np.float64]:
        """Read the programs of the lights."""
        lights, self._least = self.sumo.trafficlight, parameters["green"]
        self.lights = sorted(lights.getIDList())
        if not self.lights:
            raise InputError(f"config: {self._path}: the network has no traffic lights")
        self._phases = {light: self._program(light) for light in self.lights}
        self._since: dict[str, float | None] = dict.fromkeys(self.lights)
        lanes = {
            lane
            for phases in self._phases.values()
            for phase in phases
            if phase
            for lane in _get_lanes(phase)
        }
        self._holds = {lane: max(self.sumo.lane.getLength(lane) / _VEHICLE_M, 1.0) for lane in sorted(lanes)}
        for light in self.lights:
            self._hold(light)
        return self.look(lately)

    def act(self, actions: NDArray[np.float32]) -> None:
        """Change the lights whose action is above 0 and that have been green for long enough."""
        lights = self.sumo.trafficlight
        for light, (action,) in zip(self.lights, actions.tolist(), strict=True):
            since = self._since[light]
            if action > 0 and since is not None and self._now() - since >= self._least - 1e-6:
                lights.setPhase(light, (lights.getPhase(light) + 1) % len(self._phases[light]))
                self._since[light] = None
                self._hold(light)

    def look(self, lately: list[str]) -> NDArray[np.float64]:  # noqa: ARG002 - for vehicles
        """Return the sensor values, (lights, 4)."""
        readings = np.zeros((len(self.lights), 4))
        for row, light in zip(readings, self.lights, strict=True):
            green = self._hold(light)
            if green is None:
                continue
            halting, count_vehicles = (
                self.sumo.lane.getLastStepHaltingNumber,
                self.sumo.lane.getLastStepVehicleNumber,
            )
            row[0] = self._share(green.driving, halting)
            row[1] = self._share(green.waiting, halting)
            row[2] = self._share(green.exits, count_vehicles)
            row[3] = min((self._now() - (self._since[light] or 0.0)) / _LONG_WAIT_S, 1)
        return readings

    def fitness(self) -> float:
        """Return minus the mean waiting time, seconds."""
        return -self.measure()["waiting"]

    def _hold(self, light: str) -> _Green | None:
        """Keep a light green; return its phase, None while it changes."""
        lights = self.sumo.trafficlight
        green: _Green | None = self._phases[light][lights.getPhase(light)]
        if green is not None:
            lights.setPhaseDuration(light, _FOR_EVER_S)
            if self._since[light] is None:
                self._since[light] = self._now()
        return green

    def _now(self) -> float:
        return float(self.sumo.simulation.getTime())

    def _share(self, lanes: tuple[str, ...], count: Any) -> float:  # noqa: ANN401 - a function of SUMO's
        """Return the occupancy of lanes by vehicles."""
        return float(min(sum(map(count, lanes)) / max(sum(self._holds[lane] for lane in lanes), 1.0), 1.0))

    def _program(self, light: str) -> list[_Green | None]:
        """Return the phases of a light; None for transitions between green phases."""
        lights = self.sumo.trafficlight
        running = lights.getProgram(light)
        logic = next(
            getAllProgramLogic
            for getAllProgramLogic in lights.getAllProgramLogics(light)
            if getAllProgramLogic.programID == running
        )
        links = lights.getControlledLinks(light)
        return [_green(phase.state, links) for phase in logic.phases]


def _green(state: str, links: Any) -> _Green | None:  # noqa: ANN401 - lists of SUMO's
    """Return the lanes of a green phase from its signals and their links; None for other phases."""
    if "y" in state or "Y" in state or not ("g" in state or "G" in state):
        return None
    driving, waiting, exits = set(), set(), set()
    for signal, controlled in zip(state, links, strict=False):
        for entry, leaving, _ in controlled:
            if signal in "gG":
                driving.add(entry)
                exits.add(leaving)
            else:
                waiting.add(entry)
    return _Green(tuple(sorted(driving)), tuple(sorted(waiting - driving)), tuple(sorted(exits)))


def _get_lanes(green: _Green) -> tuple[str, ...]:
    return (*green.driving, *green.waiting, *green.exits)


_ALL_CHECKS, _NO_CHECKS = 31, 32
"""Speed modes: all of SUMO's checks; none, not even of the right of way."""


class Vehicles(Traffic):
    """Vehicles of one type that controllers accelerate, among others that follow SUMO's models.

    Agents are the vehicles of the type `type`, in the order of their departure; they act while they are on
    the road.

    Sensors: own speed; proximity of the vehicle ahead, 0 (none within `range`) to 1 (bumper to bumper); its
    relative speed; the same two for the vehicle behind. Speeds are relative to `fastest`, at most 1.
    Actuators: acceleration; 1 and -1 are the largest acceleration and deceleration of the vehicle's type.
    Fitness: the mean speed of all vehicles, m/s.

    A task with a single agent among 21 other vehicles on a ring: Stern et al., Dissipation of stop-and-go
    waves via control of autonomous vehicles, Transportation Research Part C 89, 2018.
    """

    title = "sumo vehicles"
    sensors, actuators = 5, 1
    sensor_names = ("speed", "near ahead", "faster ahead", "near behind", "faster behind")
    actuator_names = ("acceleration",)
    parameters = {  # noqa: RUF012 - as in the base class
        **Traffic.parameters,
        "agents": Parameter(1, "Most vehicles that are agents.", minimum=1, maximum=10_000),
        "type": Parameter("agent", "The vType of vehicles that are agents."),
        "range": Parameter(50.0, "How far vehicles sense others, metres.", minimum=1.0, maximum=1000.0),
        "fastest": Parameter(15.0, "The speed that reads 1, m/s.", minimum=0.1, maximum=100.0),
        "safe": Parameter(True, "Whether SUMO brakes agents that would collide otherwise."),
    }

    def begin(self, parameters: dict[str, Any], lately: list[str]) -> NDArray[np.float64]:
        """Reset the vehicles of the previous episode."""
        self._kind, self._safe = parameters["type"], parameters["safe"]
        self._range, self._fastest = parameters["range"], parameters["fastest"]
        kinds = self.sumo.vehicletype.getIDList()
        if self._kind not in kinds:
            available = ", ".join(kind for kind in kinds if not kind.startswith("DEFAULT_")) or "none"
            raise InputError(f"type: the configuration has no vType {self._kind!r}; available: {available}")
        self.agents: list[str] = []
        self._most = parameters["agents"]
        return self.look(lately)

    def act(self, actions: NDArray[np.float32]) -> None:
        """Accelerate until the next action."""
        vehicle = self.sumo.vehicle
        for index in self._acting:
            agent, action = self.agents[index], float(actions[index, 0])
            most = vehicle.getAccel(agent) if action > 0 else vehicle.getDecel(agent)
            vehicle.setAcceleration(agent, action * most, self.interval)

    def look(self, lately: list[str]) -> NDArray[np.float64]:
        """Return the sensor values; rows of agents that are not on the road are 0."""
        vehicle = self.sumo.vehicle
        for vehicle_id in lately:
            if len(self.agents) < self._most and vehicle.getTypeID(vehicle_id) == self._kind:
                vehicle.setSpeedMode(vehicle_id, _ALL_CHECKS if self._safe else _NO_CHECKS)
                self.agents.append(vehicle_id)
        present = set(self.vehicles)
        self._acting = [index for index, agent in enumerate(self.agents) if agent in present]
        readings = np.zeros((self._most, 5))
        for index in self._acting:
            vehicle_id = self.agents[index]
            speed = vehicle.getSpeed(vehicle_id)
            readings[index, 0] = min(speed / self._fastest, 1)
            ahead, behind = (
                vehicle.getLeader(vehicle_id, self._range),
                vehicle.getFollower(vehicle_id, self._range),
            )
            for column, neighbour in ((1, ahead), (3, behind)):
                if neighbour is not None and neighbour[0]:
                    # SUMO subtracts the minimum gap of the vehicle behind.
                    gap = neighbour[1] + vehicle.getMinGap(vehicle_id if column == 1 else neighbour[0])
                    readings[index, column] = 1 - min(max(gap / self._range, 0), 1)
                    faster = (vehicle.getSpeed(neighbour[0]) - speed) / self._fastest
                    readings[index, column + 1] = min(max(faster, -1), 1)
        return readings

    def acting(self) -> list[int]:
        """Return the agents on the road."""
        return self._acting

    def fitness(self) -> float:
        """Return the mean speed of all vehicles, m/s."""
        return self.measure()["speed"]

    def state(self, vehicle: str) -> str:
        """Return the state of a vehicle in pictures: agent, waiting or driving."""
        return "agent" if vehicle in self.agents else super().state(vehicle)
