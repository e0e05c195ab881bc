"""Episodes of robots in a simulator that is attached, as a command that is stepped.

See `swarmwright.simulations.command.stepwise` for what is said over the standard input and output.

What a file says of robots in a simulator that is attached: robots, sensors, actuators, steps, metrics.

The words are those of `simulation: {ros: ..}`; a sensor or an actuator is a device of the robot's instead of
a topic.
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
from swarmwright.simulations.ros.reductions import FUNCTIONS


class Device(Options):
    """A device of a robot, and how its numbers are converted."""

    device: str = Field(min_length=1)
    """Its name, as the simulator has it."""
    kind: str = ""
    """What is read or set; the simulator's page lists them. Default: the first one there."""
    scale: float = 1.0
    """Factor."""
    offset: float = 0.0
    """Added after the scale."""


class Sensor(Device):
    """A number that controllers sense."""

    sensor: str = Field(min_length=1)
    """Its name."""
    index: int = Field(default=0, ge=0)
    """Which number, of a device that measures several."""
    clip: Interval | None = None
    """[low, high]: where values end, after the scale."""
    infinite: float | None = None
    """What is read, before the scale, where a sensor detects nothing."""


class Actuator(Device):
    """A number that controllers command, -1 to 1 before the scale."""

    actuator: str = Field(min_length=1)
    """Its name."""
    limits: Interval | None = None
    """[low, high] of what is set."""


class Metric(Options):
    """A number of an episode: sampled before the first step and after each one, and reduced."""

    sensor: str | None = Field(default=None, min_length=1)
    """The name of a sensor, whose values are those that controllers get."""
    pose: str | None = Field(default=None, pattern="^(x|y|z|yaw)$")
    """Or where the robot is: x, y or z in metres, yaw in radians."""
    scale: float = 1.0
    """Factor."""
    offset: float = 0.0
    """Added after the scale."""
    time: Reduce = "last"
    """What is made of the values of an episode."""
    robots: Reduce = "mean"
    """What is made of the values of all robots."""

    @model_validator(mode="after")
    def _fits(self) -> Self:
        if (self.sensor is None) == (self.pose is None):
            raise FieldError("sensor", "give either a sensor, or pose: x, y, z or yaw")
        return self


class Attachment(Options):
    """Robots of a simulator."""

    robots: list[str] = Field(min_length=1)
    """Their names, as the simulator has them."""
    sensors: list[Sensor] = Field(min_length=1)
    """What a robot's controller senses."""
    actuators: list[Actuator] = Field(min_length=1)
    """What it commands."""
    ticks: int = Field(default=1, ge=1, le=100_000)
    """Steps of the simulator's from one action to the next."""
    steps: int = Field(default=100, ge=1, le=2**31)
    """Actions in an episode."""
    poses: list[Pose] = Field(default=[])
    """Where robots start, one of each. Default: where the simulator's file has them."""
    area: Area | None = None
    """Or where they are put at random, by the episode's seed."""
    apart: float = Field(default=0.0, ge=0)
    """Metres between two robots in the area, at least."""
    metrics: dict[str, Metric] = Field(default={})
    """Name -> {sensor or pose, time, robots}."""
    start: Command | None = None
    """A command that starts the simulator, which ends with the server. {port} in it is a free port. Default:
    the simulator runs already."""
    startup: float = Field(default=60.0, gt=0, le=86_400)
    """Seconds that the simulator has to start."""
    patience: float = Field(default=30.0, gt=0, le=86_400)
    """Seconds to wait for an answer."""
    host: str = Field(default="localhost", min_length=1)
    """Where a simulator that runs already is."""
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
            raise FieldError("robots", f"{twice} is there twice")
        if self.poses and self.area is not None:
            raise FieldError("poses", "give either poses or area")
        if self.poses and len(self.poses) != len(self.robots):
            raise FieldError(
                "poses", f"{len(self.poses)} found, expected one of each of {len(self.robots)} robots"
            )
        names = [sensor.sensor for sensor in self.sensors]
        for name, metric in self.metrics.items():
            if metric.sensor is not None and metric.sensor not in names:
                raise FieldError(
                    "metrics", f"{name}: there is no sensor {metric.sensor!r}; {', '.join(names)} are"
                )
        return self

    @property
    def folder(self) -> Path:
        """Where the file lies; files that `start` names are relative to it."""
        return self._folder

    def check_kinds(self, sensors: Mapping[str, object], actuators: Mapping[str, object]) -> None:
        """Raise InputError for kinds of devices that the simulator does not have."""
        groups: tuple[tuple[str, Sequence[Device], Mapping[str, object]], ...] = (
            ("sensors", self.sensors, sensors),
            ("actuators", self.actuators, actuators),
        )
        for section, devices, known in groups:
            for number, device in enumerate(devices):
                if device.kind and device.kind not in known:
                    raise InputError(
                        f"{section}[{number}].kind: {device.kind!r} found, expected {', '.join(known)}"
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
            found = [f"{source.locate(at)}{text}" for at, text in problems_of(error, cls)]
            raise InputError("; ".join(found)) from None
        attachment._folder = path.absolute().parent  # type: ignore[misc] # a private attribute
        return attachment


TRIES = 10_000
"""Places that are tried for a robot before it is said that there is none."""

Place = TypeVar("Place")


def free_place(draw: Callable[[], Place], is_free: Callable[[Place], bool]) -> Place | None:
    """Return the first place that is free of those that are drawn; None where none of `TRIES` is.

    Args:
        draw: returns another place each time.
        is_free: whether a place can be taken.
    """
    for _ in range(TRIES):
        place = draw()
        if is_free(place):
            return place
    return None


_PATIENCE_S = 2.0
"""Seconds that a simulator has to end when it is asked to."""


class AttachmentError(Exception):
    """The simulator does not do what it should; the message says what and where."""


class Simulator(ABC):
    """A simulator with robots.

    Methods raise AttachmentError when it does not answer, or answers that something is not there.
    """

    @abstractmethod
    def reset(self, poses: Sequence[Pose]) -> None:
        """Go to the start of an episode; put the robots there, one pose of each, or none where they are."""

    @abstractmethod
    def step(self, commands: Sequence[Sequence[float]]) -> None:
        """Set the actuators, (robots, actuators), and go on by `ticks` steps of the simulator."""

    @abstractmethod
    def sensed(self) -> list[list[float | None]]:
        """Return what sensors read, (robots, sensors); None where nothing is detected."""

    @abstractmethod
    def poses(self) -> list[Pose]:
        """Return where the robots are."""

    @abstractmethod
    def close(self) -> None:
        """Stop the simulation and leave."""


class Episodes:
    """Episodes of the robots that a file describes, in a simulator."""

    def __init__(self, attachment: Attachment, simulator: Simulator) -> None:
        self._attachment, self._simulator = attachment, simulator
        self._left = 0
        self._samples: dict[str, list[float]] = {}

    def reset(self, seed: int) -> dict[str, Any]:
        """Begin an episode; return the answer."""
        given = self._attachment
        poses = (
            given.poses if given.area is None else _placed(given.area, len(given.robots), given.apart, seed)
        )
        self._simulator.reset(poses)
        self._left = given.steps
        self._samples = {name: [] for name in given.metrics}
        return self._answer()

    def step(self, actions: Sequence[Sequence[float]]) -> dict[str, Any]:
        """Go on by one action; return the answer."""
        actuators = self._attachment.actuators
        self._simulator.step(
            [
                [
                    _limited(_scaled(actuator, value), actuator.limits)
                    for actuator, value in zip(actuators, row, strict=True)
                ]
                for row in actions
            ]
        )
        self._left -= 1
        return self._answer()

    def _answer(self) -> dict[str, Any]:
        given = self._attachment
        sensed = [
            [
                _limited(_scaled(sensor, sensor.infinite if value is None else value), sensor.clip)
                for sensor, value in zip(given.sensors, row, strict=True)
            ]
            for row in self._simulator.sensed()
        ]
        for name, row in zip(given.robots, sensed, strict=True):
            for sensor, value in zip(given.sensors, row, strict=True):
                if not math.isfinite(value):
                    raise AttachmentError(
                        f"{name}: sensor {sensor.sensor}: {value} came, expected a finite number; `infinite` "
                        "is what is read where nothing is detected"
                    )
        poses = self._simulator.poses() if any(measured.pose for measured in given.metrics.values()) else []
        for name, metric in given.metrics.items():
            self._samples[name].append(FUNCTIONS[metric.robots](list(self._values(metric, sensed, poses))))
        if self._left > 0:
            return {"sensors": sensed}
        results = {
            name: FUNCTIONS[metric.time](self._samples[name]) for name, metric in given.metrics.items()
        }
        return {"done": True, "metrics": results}

    def _values(self, metric: Metric, sensed: list[list[float]], poses: list[Pose]) -> Iterable[float]:
        if metric.pose is not None:
            read = [float(getattr(pose, metric.pose)) for pose in poses]
        else:
            column = [sensor.sensor for sensor in self._attachment.sensors].index(metric.sensor or "")
            read = [row[column] for row in sensed]
        return (metric.scale * value + metric.offset for value in read)


class Started:
    """The simulator's process.

    Args:
        command: starts it; {port} is replaced.
        port: for that.
        folder: where files that it names are looked for.

    Raises AttachmentError when it cannot be started.
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
        """Raise AttachmentError when it has ended."""
        status = self._process.poll()
        if status is not None:
            how = f"was ended by {signal.Signals(-status).name}" if status < 0 else f"status {status}"
            raise AttachmentError(f"start: {self._name} has ended ({how})")

    def end(self) -> None:
        """End it with all that it has started: it is asked to, and after a while killed."""
        for number in (signal.SIGTERM, signal.SIGKILL):
            with suppress(OSError):
                os.killpg(self._process.pid, number)
            with suppress(subprocess.TimeoutExpired):
                self._process.wait(_PATIENCE_S)
                return


def kind_of(device: Device, known: Mapping[str, object]) -> str:
    """Return the kind of a device; the first that is known where it is left out."""
    return device.kind or next(iter(known))


def free_port() -> int:
    """Return a TCP port that nobody uses."""
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
        raise InputError(f"{words} found, expected one file: python -m {program} robots.yaml")
    return Attachment.read(Path(arguments[0]))


def run(attachment: Attachment, simulator: Simulator) -> None:
    """Run episodes until the standard input ends."""
    episodes = Episodes(attachment, simulator)
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)  # what others print does not get among answers
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
    """Have SIGTERM and SIGINT end the program in an orderly way."""

    def end(number: int, _: object) -> None:
        raise SystemExit(128 + number)

    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, end)


def _placed(area: Area, count: int, apart: float, seed: int) -> list[Pose]:
    """Return places in an area by chance. Raises AttachmentError where not so many fit."""
    numbers = random.Random(seed)
    poses: list[Pose] = []

    def draw() -> tuple[float, ...]:
        return tuple(numbers.uniform(*part) for part in (area.x, area.y, area.yaw))

    def is_free(place: tuple[float, ...]) -> bool:
        return all(math.hypot(place[0] - pose.x, place[1] - pose.y) >= apart for pose in poses)

    for _ in range(count):
        place = free_place(draw, is_free)
        if place is None:
            raise AttachmentError(f"area: it is too small for {count} robots, {apart:g} m apart")
        x, y, yaw = place
        poses.append(Pose(x=x, y=y, z=area.z, yaw=yaw))
    return poses


def _scaled(device: Device, value: float | None) -> float:
    return math.nan if value is None else device.scale * float(value) + device.offset


def _limited(value: float, limits: Sequence[float] | None) -> float:
    return value if limits is None else min(max(value, limits[0]), limits[1])
