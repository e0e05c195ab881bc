"""What vehicles and traffic lights have in common: SUMO in this process, episodes, metrics, pictures.

Checks the files of a configuration: SUMO itself ends the process at a network that is not XML.
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
"""Options that name files to be written, or times at which files are written."""
_OUTPUT_OF_A_DEVICE = re.compile(r"device\.(?:ssm|toc)\.file")
_SWITCHED_OFF = {
    "random": ("false", ("", "0", "false", "no", "off", "f", "n", "-")),
    "remote-port": ("0", ("", "0")),
    "gui-settings-file": ("", ("",)),
}
"""Options that take away repeatability or lock-step: what they are set to, and values that change nothing."""
_NOWHERE = "NUL"
"""What SUMO, on every system, calls a file that keeps nothing."""
_UP = "../" * 64
"""To the root of the file system, from any folder."""


@dataclass(frozen=True)
class Configuration:
    """A configuration of SUMO whose files can be read."""

    path: Path
    options: tuple[str, ...]
    """What SUMO gets beside it, so that episodes are repeatable, isolated and in lock-step."""
    overridden: tuple[str, ...]
    """The options and the elements of additional files that therefore have no effect."""

    @property
    def notice(self) -> str | None:
        """What the user is told of them; None where there are none."""
        if not self.overridden:
            return None
        return (
            f"config: {self.path}: without effect here: {', '.join(self.overridden)}; episodes follow from "
            "their seed alone, in lock-step, and SUMO writes no files"
        )


def checked(config: str) -> Configuration:
    """Return a configuration whose network, routes and additional files can be read.

    Raises InputError, "config: why".
    """
    if not config:
        raise InputError(
            "config: missing; expected the path of a configuration of SUMO, such as town.sumocfg"
        )
    path = Path(config).absolute()
    given = {
        _SHORT.get(one.tag, one.tag): one.get("value") or one.get("v") or "" for one in _parse(path).iter()
    }
    if "net-file" not in given:
        raise InputError(f"config: {path}: it names no net-file")
    overridden, options = [], []
    for name, (value, harmless) in _SWITCHED_OFF.items():
        options += [f"--{name}", value]
        if given.get(name, "").strip().lower() not in harmless:
            overridden.append(name)
    for name, value in given.items():
        if value and _OUTPUT.fullmatch(name) and _names_a_file(name):
            options += [f"--{name}", "" if name.startswith("save-") else _NOWHERE]
            overridden.append(name)
        elif value and _OUTPUT_OF_A_DEVICE.fullmatch(name):
            overridden.append(name)
    for name in _INPUTS:
        for file in given.get(name, "").replace(",", " ").split():
            root = _parse(path.parent / file)
            if name == "additional-files":
                overridden += _detectors(root)
    return Configuration(path, tuple(options), tuple(dict.fromkeys(overridden)))


def _names_a_file(name: str) -> bool:
    """Return whether an option that is called as outputs are is one, rather than a detail of another."""
    return not name.startswith("save-") or name in {
        "save-state.times", "save-state.files", "save-configuration", "save-template", "save-schema",
    }  # fmt: skip


def _detectors(root: ET.Element) -> Iterator[str]:
    """Yield the elements of additional files that write files of their own."""
    for one in root.iter():
        written = one.get("file") if one.tag not in _READ else None
        if (written or one.get("dest")) not in {None, "", _NOWHERE, "/dev/null"}:
            yield f"{one.tag} {one.get('id', '')}".strip()


_READ = frozenset({"variableSpeedSign", "calibrator", "include", "rerouter", "poi", "poly"})
"""Elements whose `file` is read."""


class Outputs:
    """A private folder for what SUMO writes nevertheless: detectors and devices with files of their own."""

    def __init__(self) -> None:
        self._folder = TemporaryFolder("sumo")
        folder = str(self._folder.path)
        # SUMO puts the prefix between the folder and the name of each file that it writes.
        self.options = ("--output-prefix", f"{_UP}{folder.lstrip('/')}/")


def _parse(path: Path) -> ET.Element:
    """Return the root of an XML file; an empty one where it is compressed, which SUMO reads, too."""
    try:
        if path.exists() and not path.is_file():
            raise InputError(f"config: {path}: is not a file")
        with path.open("rb") as file:
            if file.read(2) == b"\x1f\x8b":
                return ET.Element("compressed")
            file.seek(0)
            return ET.parse(file).getroot()  # noqa: S314 - the user has SUMO read it, too
    except OSError as error:
        raise InputError(f"config: {path}: {error.strerror}") from None
    except ValueError:  # no path at all
        raise InputError(f"config: {str(path)!r}: is not a path") from None
    except ET.ParseError as error:
        raise InputError(f"config: {path}: not valid XML: {error}") from None


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
