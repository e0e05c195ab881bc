"""Robots in Webots, each with an extern controller, in lock-step: `python -m swarmwright.simulations.webots`.

The program is a stepwise command of an experiment, see docs/how-to/simulators.md. Each robot has a process
with Webots' module `controller`, because a process can control only one robot; a supervisor resets the
simulation.

Source: https://cyberbotics.com/doc/guide/running-extern-robot-controllers.
"""

import json
import os
import select
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any
from urllib.parse import quote

from swarmwright.simulations import attachment as _attached
from swarmwright.simulations._webots_robot import ACTUATORS, SENSORS
from swarmwright.simulations.attachment import (
    Attachment,
    AttachmentError,
    Simulator,
    SimulatorProcess,
    get_kind,
)
from swarmwright.simulations.command.ros_definition import Pose

PORT = 1234
"""Default port of Webots."""
SUPERVISOR = "supervisor"
"""Name of the supervisor robot that resets the simulation."""
_ROBOT = Path(__file__).with_name("_webots_robot.py")
_CHUNK_BYTES = 1 << 16
"""Largest number of bytes per read."""
_END_S = 2.0
_CHECK_S = 0.5
_LATE_S = 0.1
"""Seconds between the end of a process's connections and the detection of its own end."""


class _Robot:
    """The process of a robot's controller."""

    def __init__(self, name: str, url: str, role: str) -> None:
        self.name = name
        environment = {**os.environ, "WEBOTS_CONTROLLER_URL": f"{url}/{quote(name)}"}
        home = os.environ.get("WEBOTS_HOME")
        if home:
            paths = [str(Path(home) / "lib" / "controller" / "python"), os.environ.get("PYTHONPATH", "")]
            environment["PYTHONPATH"] = os.pathsep.join(filter(None, paths))
        self._process = subprocess.Popen(
            [sys.executable, str(_ROBOT), role],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env=environment,
        )
        self._rest = b""

    def ask(self, request: Mapping[str, Any]) -> None:
        """Send a request; `answer` reads the answer."""
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(f"{json.dumps(request)}\n".encode())
            self._process.stdin.flush()
        except BrokenPipeError:
            raise AttachmentError(f"{self.name}: its controller has ended") from None

    @property
    def output(self) -> int:
        """Descriptor of the answers."""
        assert self._process.stdout is not None
        return self._process.stdout.fileno()

    def answer(self) -> dict[str, Any] | None:
        """Read output; return the answer when it is complete. Raises AttachmentError for an error."""
        piece = os.read(self.output, _CHUNK_BYTES)
        if not piece:
            raise AttachmentError(f"{self.name}: its controller has ended")
        self._rest += piece
        if b"\n" not in self._rest:
            return None
        line, _, self._rest = self._rest.partition(b"\n")
        answer: dict[str, Any] = json.loads(line)
        if "error" in answer:
            raise AttachmentError(f"{self.name}: {answer['error']}")
        return answer

    def leave(self) -> None:
        """Ask the process to end."""
        assert self._process.stdin is not None
        with suppress(OSError):
            self._process.stdin.close()

    def end(self, seconds: float) -> None:
        """Wait until the process has ended; kill it after these seconds."""
        assert self._process.stdout is not None
        try:
            self._process.wait(max(seconds, 0))
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._process.stdout.close()


class Webots(Simulator):
    """A connection to Webots, with a controller for each robot and one for the supervisor.

    Raises InputError for unknown kinds of devices; AttachmentError if Webots does not answer, or a robot or
    device is not in the world.
    """

    def __init__(self, attachment: Attachment) -> None:
        attachment.check_kinds(SENSORS, ACTUATORS)
        self._attachment, self._seconds = attachment, attachment.startup
        self._robots: list[_Robot] = []
        port = PORT if attachment.start is None else _attached.free_port()
        self._started = (
            None if attachment.start is None else SimulatorProcess(attachment.start, port, attachment.folder)
        )
        remote = self._started is None and attachment.host not in ("localhost", "127.0.0.1")
        url = f"tcp://{attachment.host}:{port}" if remote else f"ipc://{port}"
        try:
            self._robots = [_Robot(name, url, "robot") for name in attachment.robots]
            self._robots.append(_Robot(SUPERVISOR, url, "supervisor"))
            self._connect()
        except BaseException:
            self.close()
            raise
        self._seconds = attachment.patience

    def reset(self, poses: Sequence[Pose]) -> None:
        """Reset the simulation and place the robots."""
        *robots, supervisor = self._robots
        self._exchange([{"reset": "devices"}] * len(robots) + [{"reset": "simulation"}])
        self._step([[]] * len(robots))  # the reset takes place in a step
        if poses:
            places = [[pose.x, pose.y, pose.z or None, pose.yaw] for pose in poses]
            self._exchange([{"poses": places}], [supervisor])
        self._exchange([{"reset": "devices"}] * len(robots), robots)
        self._step([[]] * len(robots))

    def step(self, commands: Sequence[Sequence[float]]) -> None:
        """Set actuators and make a step."""
        self._step(commands)

    def read_sensors(self) -> list[list[float | None]]:
        """Return the values of devices in the last step."""
        return self._read

    def poses(self) -> list[Pose]:
        """Request poses from the supervisor."""
        (answer,) = self._exchange([{"read_poses": True}], [self._robots[-1]])
        return [Pose(x=x, y=y, z=z, yaw=yaw) for x, y, z, yaw in answer["poses"]]

    def close(self) -> None:
        """End the controllers, and Webots if this object has started it."""
        deadline = time.monotonic() + _END_S
        for robot in self._robots:
            robot.leave()
        for robot in self._robots:
            robot.end(deadline - time.monotonic())
        if self._started is not None:
            self._started.end()

    def _connect(self) -> None:
        attachment = self._attachment
        sensors = [(sensor.device, get_kind(sensor, SENSORS), sensor.index) for sensor in attachment.sensors]
        actuators = [(actuator.device, get_kind(actuator, ACTUATORS)) for actuator in attachment.actuators]
        devices = {"devices": {"sensors": sensors, "actuators": actuators}, "ticks": attachment.ticks}
        no_devices = {"devices": {"sensors": [], "actuators": []}, "ticks": attachment.ticks}
        self._exchange([devices] * len(attachment.robots) + [no_devices])
        self._exchange([{"find": attachment.robots}], [self._robots[-1]])

    def _step(self, commands: Sequence[Sequence[float]]) -> None:
        answers = self._exchange([{"step": row} for row in commands] + [{"step": []}])
        self._read: list[list[float | None]] = [answer["read"] for answer in answers[:-1]]

    def _exchange(
        self, requests: Sequence[Mapping[str, Any]], robots: Sequence[_Robot] | None = None
    ) -> list[dict[str, Any]]:
        """Send each robot a request, then read all answers: Webots waits for all controllers in a step."""
        addressed = self._robots if robots is None else robots
        for robot, request in zip(addressed, requests, strict=True):
            robot.ask(request)
        waiting = {robot.output: robot for robot in addressed}
        answers: dict[str, dict[str, Any]] = {}
        deadline = time.monotonic() + self._seconds
        while waiting:
            remaining_s = deadline - time.monotonic()
            ready = select.select(list(waiting), [], [], max(min(remaining_s, _CHECK_S), 0))[0]
            if not ready:
                self._check(remaining_s, [robot.name for robot in waiting.values()])
            for output in ready:
                try:
                    answer = waiting[output].answer()
                except AttachmentError:
                    time.sleep(_LATE_S)
                    self._check(1, [])  # reports the end of Webots if that is the reason
                    raise
                if answer is not None:
                    answers[waiting.pop(output).name] = answer
        return [answers[robot.name] for robot in addressed]

    def _check(self, remaining_s: float, silent: Sequence[str]) -> None:
        """Raise AttachmentError if Webots has ended, or on a time-out."""
        if self._started is not None:
            self._started.check()
        if remaining_s <= 0:
            raise AttachmentError(
                f"{', '.join(silent)}: Webots did not answer for {self._seconds:g} s; does the world have a "
                "robot "
                'with each of these names and the controller "<extern>", and no other such robot?'
            )


def main(arguments: Sequence[str]) -> int:
    """Run episodes until the standard input ends; return the exit status."""
    return _attached.serve(arguments, "swarmwright.simulations.webots", Webots)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
