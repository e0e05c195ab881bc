"""Runs robots in an attached simulator as a stepwise command, see `swarmwright.simulations.command.stepwise`.

A file describes robots, sensors, actuators, steps and metrics. Its keys are those of `simulation: {ros: ..}`,
but sensors and actuators are devices of a robot instead of topics.
"""

import json
import math
import os
import random
import shlex
import signal
import socket
import subprocess
import sys
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, Self, TypeVar

from pydantic import Field, PrivateAttr, ValidationError, field_validator, model_validator

from swarmwright.common import metric_names, yaml
from swarmwright.common.errors import InputError
from swarmwright.common.options import Options
from swarmwright.common.problems import FieldError, problems_of
from swarmwright.simulations.command.definition import Command
from swarmwright.simulations.command.process import resolve_word
from swarmwright.simulations.command.ros_definition import Area, Interval, Pose, Reduce
from swarmwright.simulations.ros.expression import FUNCTIONS


class Device(Options):
    """A device of a robot, and the conversion of its values."""

    device: str = Field(min_length=1)
    """The simulator's name of the device."""
    kind: str = ""
    """The value that is read or set; the simulator's page lists the kinds. Default: the first of the list."""
    scale: float = 1.0
    """Factor by which the value is multiplied."""
    offset: float = 0.0
    """Added after the scale."""


class Sensor(Device):
    """A sensor of a controller."""

    sensor: str = Field(min_length=1)
    """Name of the sensor."""
    index: int = Field(default=0, ge=0)
    """Index of the value, for a device with several."""
    clip: Interval | None = None
    """Limits of the value after the scale, [low, high]."""
    infinite: float | None = None
    """Value before the scale if the device detects nothing."""


class Actuator(Device):
    """An actuator of a controller, -1 to 1 before the scale."""

    actuator: str = Field(min_length=1)
    """Name of the actuator."""
    limits: Interval | None = None
    """Limits of the value that is set, [low, high]."""


class Metric(Options):
    """A metric of an episode: read before the first step and after each step, and reduced."""

    sensor: str | None = Field(default=None, min_length=1)
    """The name of a sensor, with the values that controllers receive."""
    pose: str | None = Field(default=None, pattern="^(x|y|z|yaw)$")
    """Instead of a sensor: a coordinate of the robot's pose, x, y or z in metres, yaw in radians."""
    scale: float = 1.0
    """Factor by which the value is multiplied."""
    offset: float = 0.0
    """Added after the scale."""
    time: Reduce = "last"
    """How the values of an episode are reduced to a number."""
    robots: Reduce = "mean"
    """How the values of all robots are reduced to a number."""

    @model_validator(mode="after")
    def _fits(self) -> Self:
        if (self.sensor is None) == (self.pose is None):
            raise FieldError("sensor", "write either a sensor, or pose: x, y, z or yaw")
        return self


class Attachment(Options):
    """Robots of a simulator."""

    robots: list[str] = Field(min_length=1)
    """The simulator's names of the robots."""
    sensors: list[Sensor] = Field(min_length=1)
    """Sensors of a robot."""
    actuators: list[Actuator] = Field(min_length=1)
    """Actuators of a robot."""
    ticks: int = Field(default=1, ge=1, le=100_000)
    """Steps of the simulator between two actions."""
    steps: int = Field(default=100, ge=1, le=2**31)
    """Actions in an episode."""
    poses: list[Pose] = Field(default=[])
    """Initial pose of each robot. Default: the poses in the simulator's file."""
    area: Area | None = None
    """Instead of `poses`: an area in which robots are placed at random, by the episode's seed."""
    apart: float = Field(default=0.0, ge=0)
    """Smallest distance of two robots in the area, metres."""
    metrics: dict[str, Metric] = Field(default={})
    """Name -> {sensor or pose, time, robots}."""
    start: Command | None = None
    """A command that starts the simulator, which ends with the server. {port} in it is a free port. Default:
    the simulator is already running."""
    startup: float = Field(default=60.0, gt=0, le=86_400)
    """Seconds to wait for the simulator to start."""
    patience: float = Field(default=30.0, gt=0, le=86_400)
    """Seconds to wait for an answer."""
    host: str = Field(default="localhost", min_length=1)
    """Host of a simulator that is already running."""
    _folder: Path = PrivateAttr(default=Path())

    @field_validator("metrics")
    @classmethod
    def _names(cls, value: dict[str, Metric]) -> dict[str, Metric]:
        metric_names.check(value)
        return value

    @model_validator(mode="after")
    def _fits(self) -> Self:
        twice = next((robot for index, robot in enumerate(self.robots) if robot in self.robots[:index]), None)
        if twice is not None:
            raise FieldError("robots", f"{twice} is repeated")
        if self.poses and self.area is not None:
            raise FieldError("poses", "write either poses or area")
        if self.poses and len(self.poses) != len(self.robots):
            raise FieldError(
                "poses", f"{len(self.poses)} found, expected a pose for each of {len(self.robots)} robots"
            )
        names = [sensor.sensor for sensor in self.sensors]
        for name, metric in self.metrics.items():
            if metric.sensor is not None and metric.sensor not in names:
                raise FieldError(
                    "metrics", f"{name}: there is no sensor {metric.sensor!r}; available: {', '.join(names)}"
                )
        return self

    @property
    def folder(self) -> Path:
        """Folder of the file, to which files named by `start` are relative."""
        return self._folder

    def check_kinds(self, sensors: Mapping[str, object], actuators: Mapping[str, object]) -> None:
        """Raise InputError for kinds of devices that the simulator does not have."""
        groups: tuple[tuple[str, Sequence[Device], Mapping[str, object]], ...] = (
            ("sensors", self.sensors, sensors),
            ("actuators", self.actuators, actuators),
        )
        for section, devices, kinds in groups:
            for number, device in enumerate(devices):
                if device.kind and device.kind not in kinds:
                    raise InputError(
                        f"{section}[{number}].kind: {device.kind!r} found, expected {', '.join(kinds)}"
                    )

    @classmethod
    def read(cls, path: Path) -> Self:
        """Read a file. Raises InputError with file, line and field."""
        source = yaml.read(path)
        if source.problems:
            raise InputError("; ".join(f"{source.locate(at)}{text}" for at, _, text in source.problems))
        try:
            attachment = cls.model_validate(source.values)
        except ValidationError as error:
            problems = [f"{source.locate(at)}{text}" for at, text in problems_of(error, cls)]
            raise InputError("; ".join(problems)) from None
        attachment._folder = path.absolute().parent  # type: ignore[misc] # a private attribute
        return attachment


TRIES = 10_000
"""Largest number of positions that are tried for a robot."""

Position = TypeVar("Position")


def find_free_position(draw: Callable[[], Position], is_free: Callable[[Position], bool]) -> Position | None:
    """Draw positions until one is free; return None after `TRIES` attempts.

    Args:
        draw: draws a position.
        is_free: returns whether a position is free.
    """
    for _ in range(TRIES):
        position = draw()
        if is_free(position):
            return position
    return None


_PATIENCE_S = 2.0
"""Seconds that a simulator has to end after SIGTERM."""


class AttachmentError(Exception):
    """A failure of the simulator."""


class Simulator(ABC):
    """A simulator with robots.

    Methods raise AttachmentError if it does not answer, or reports that something is missing.
    """

    @abstractmethod
    def reset(self, poses: Sequence[Pose]) -> None:
        """Start an episode with a pose for each robot; if empty, with the poses in the simulator's file."""

    @abstractmethod
    def step(self, commands: Sequence[Sequence[float]]) -> None:
        """Set the actuators, (robots, actuators), and advance by `ticks` steps of the simulator."""

    @abstractmethod
    def read_sensors(self) -> list[list[float | None]]:
        """Return the values of the sensors, (robots, sensors); None if nothing is detected."""

    @abstractmethod
    def poses(self) -> list[Pose]:
        """Return the poses of the robots."""

    @abstractmethod
    def close(self) -> None:
        """Stop the simulation and disconnect."""


class Episodes:
    """Episodes in a simulator, as described by a file."""

    def __init__(self, attachment: Attachment, simulator: Simulator) -> None:
        self._attachment, self._simulator = attachment, simulator
        self._remaining_steps = 0
        self._samples: dict[str, list[float]] = {}

    def reset(self, seed: int) -> dict[str, Any]:
        """Start an episode; return the answer."""
        attachment = self._attachment
        poses = (
            attachment.poses
            if attachment.area is None
            else _draw_poses(attachment.area, len(attachment.robots), attachment.apart, seed)
        )
        self._simulator.reset(poses)
        self._remaining_steps = attachment.steps
        self._samples = {name: [] for name in attachment.metrics}
        return self._answer()

    def step(self, actions: Sequence[Sequence[float]]) -> dict[str, Any]:
        """Advance by one action; return the answer."""
        actuators = self._attachment.actuators
        self._simulator.step(
            [
                [
                    _limit(_scale(actuator, value), actuator.limits)
                    for actuator, value in zip(actuators, row, strict=True)
                ]
                for row in actions
            ]
        )
        self._remaining_steps -= 1
        return self._answer()

    def _answer(self) -> dict[str, Any]:
        attachment = self._attachment
        sensed = [
            [
                _limit(_scale(sensor, sensor.infinite if value is None else value), sensor.clip)
                for sensor, value in zip(attachment.sensors, row, strict=True)
            ]
            for row in self._simulator.read_sensors()
        ]
        for name, row in zip(attachment.robots, sensed, strict=True):
            for sensor, value in zip(attachment.sensors, row, strict=True):
                if not math.isfinite(value):
                    raise AttachmentError(
                        f"{name}: sensor {sensor.sensor} is {value}, expected a finite number; set "
                        "`infinite` to the value for no detection"
                    )
        poses = (
            self._simulator.poses() if any(measured.pose for measured in attachment.metrics.values()) else []
        )
        for name, metric in attachment.metrics.items():
            self._samples[name].append(FUNCTIONS[metric.robots](list(self._values(metric, sensed, poses))))
        if self._remaining_steps > 0:
            return {"sensors": sensed}
        results = {
            name: FUNCTIONS[metric.time](self._samples[name]) for name, metric in attachment.metrics.items()
        }
        return {"done": True, "metrics": results}

    def _values(self, metric: Metric, sensed: list[list[float]], poses: list[Pose]) -> Iterable[float]:
        if metric.pose is not None:
            read = [float(getattr(pose, metric.pose)) for pose in poses]
        else:
            column = [sensor.sensor for sensor in self._attachment.sensors].index(metric.sensor or "")
            read = [row[column] for row in sensed]
        return (metric.scale * value + metric.offset for value in read)


class SimulatorProcess:
    """The simulator's process.

    Args:
        command: command that starts it; {port} is replaced.
        port: port of the simulator.
        folder: folder of files that the command names.

    Raises AttachmentError if it cannot be started.
    """

    def __init__(self, command: Sequence[str], port: int, folder: Path) -> None:
        words = [resolve_word(word.replace("{port}", str(port)), folder) for word in command]
        self._name = words[0]
        try:
            self._process = subprocess.Popen(
                words, stdin=subprocess.DEVNULL, stdout=sys.stderr, start_new_session=True
            )
        except OSError as error:
            raise AttachmentError(f"start: {words[0]}: {error.strerror}") from None

    def check(self) -> None:
        """Raise AttachmentError if it has ended."""
        status = self._process.poll()
        if status is not None:
            how = f"was ended by {signal.Signals(-status).name}" if status < 0 else f"status {status}"
            raise AttachmentError(f"start: {self._name} has ended ({how})")

    def end(self) -> None:
        """Ask the process group to end, and kill it after a while."""
        for number in (signal.SIGTERM, signal.SIGKILL):
            with suppress(OSError):
                os.killpg(self._process.pid, number)
            with suppress(subprocess.TimeoutExpired):
                self._process.wait(_PATIENCE_S)
                return


def get_kind(device: Device, kinds: Mapping[str, object]) -> str:
    """Return the kind of a device, by default the first."""
    return device.kind or next(iter(kinds))


def free_port() -> int:
    """Return a free TCP port."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def serve(arguments: Sequence[str], program: str, simulator: Callable[[Attachment], Simulator]) -> int:
    """Run episodes in an attached simulator until the standard input ends; return the exit status.

    Args:
        arguments: the command line, which names the file of the robots.
        program: module that is run, such as swarmwright.simulations.webots.
        simulator: class of the simulator that is attached.
    """
    exit_on_signals()
    try:
        attachment = read(arguments, program)
        attached = simulator(attachment)
    except (InputError, AttachmentError) as error:
        print(f"Error: {error}", file=sys.stderr)
        return 2
    run(attachment, attached)
    return 0


def read(arguments: Sequence[str], program: str) -> Attachment:
    """Read the file that the command line names. Raises InputError."""
    if len(arguments) != 1:
        words = shlex.join(arguments) or "nothing"
        raise InputError(f"{words} found, expected a single file: python -m {program} robots.yaml")
    return Attachment.read(Path(arguments[0]))


def run(attachment: Attachment, simulator: Simulator) -> None:
    """Run episodes until the standard input ends."""
    episodes = Episodes(attachment, simulator)
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)  # keeps other output apart from answers
    try:
        for line in sys.stdin:
            message = json.loads(line)
            try:
                if "reset" in message:
                    answer = episodes.reset(int(message["reset"]["seed"]))
                else:
                    answer = episodes.step(message["actuators"])
            except AttachmentError as error:
                answer = {"error": str(error)}
            answers.write(f"{json.dumps(answer)}\n")
            answers.flush()
    except BrokenPipeError:
        pass
    finally:
        simulator.close()


def exit_on_signals() -> None:
    """Let SIGTERM and SIGINT end the program cleanly."""

    def end(number: int, _: object) -> None:
        raise SystemExit(128 + number)

    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, end)


def _draw_poses(area: Area, count: int, apart: float, seed: int) -> list[Pose]:
    """Draw random poses in an area. Raises AttachmentError if the area is too small."""
    numbers = random.Random(seed)
    poses: list[Pose] = []

    def draw() -> tuple[float, ...]:
        return tuple(numbers.uniform(*part) for part in (area.x, area.y, area.yaw))

    def is_free(position: tuple[float, ...]) -> bool:
        return all(math.hypot(position[0] - pose.x, position[1] - pose.y) >= apart for pose in poses)

    for _ in range(count):
        position = find_free_position(draw, is_free)
        if position is None:
            raise AttachmentError(f"area: it is too small for {count} robots, {apart:g} m apart")
        x, y, yaw = position
        poses.append(Pose(x=x, y=y, z=area.z, yaw=yaw))
    return poses


def _scale(device: Device, value: float | None) -> float:
    return math.nan if value is None else device.scale * float(value) + device.offset


def _limit(value: float, limits: Sequence[float] | None) -> float:
    return value if limits is None else min(max(value, limits[0]), limits[1])
