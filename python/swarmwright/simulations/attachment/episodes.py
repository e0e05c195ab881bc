"""Episodes of robots in a simulator that is attached, as a command that is stepped.

See `swarmwright.simulations.command.stepwise` for what is said over the standard input and output.
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
from typing import Any

from swarmwright.common.errors import InputError
from swarmwright.simulations.attachment.definition import Attachment, Device, Metric
from swarmwright.simulations.attachment.placing import free_place
from swarmwright.simulations.command.process import resolved_word
from swarmwright.simulations.command.ros_sections import Area, Pose
from swarmwright.simulations.ros.reductions import FUNCTIONS

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
                [_limited(_scaled(one, value), one.limits) for one, value in zip(actuators, row, strict=True)]
                for row in actions
            ]
        )
        self._left -= 1
        return self._answer()

    def _answer(self) -> dict[str, Any]:
        given = self._attachment
        sensed = [
            [
                _limited(_scaled(one, one.infinite if value is None else value), one.clip)
                for one, value in zip(given.sensors, row, strict=True)
            ]
            for row in self._simulator.sensed()
        ]
        for name, row in zip(given.robots, sensed, strict=True):
            for one, value in zip(given.sensors, row, strict=True):
                if not math.isfinite(value):
                    raise AttachmentError(
                        f"{name}: sensor {one.sensor}: {value} came, expected a finite number; `infinite` is "
                        "what is read where nothing is detected"
                    )
        poses = self._simulator.poses() if any(one.pose for one in given.metrics.values()) else []
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
            column = [one.sensor for one in self._attachment.sensors].index(metric.sensor or "")
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
        words = [resolved_word(word.replace("{port}", str(port)), folder) for word in command]
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
        return all(math.hypot(place[0] - one.x, place[1] - one.y) >= apart for one in poses)

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
