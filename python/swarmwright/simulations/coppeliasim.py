"""Robots in CoppeliaSim, by its ZeroMQ remote API, stepped: `python -m swarmwright.simulations.coppeliasim`.

The program is a command that an experiment attaches, see docs/how-to/simulators.md. It needs
`pip install 'swarmwright[coppeliasim]'`, and CoppeliaSim 4.6 or later.

Source: https://manual.coppeliarobotics.com/en/zmqRemoteApiOverview.htm.
"""

import sys
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any

from swarmwright.common.errors import InputError
from swarmwright.simulations import attachment as _attached
from swarmwright.simulations.attachment import (
    Attachment,
    AttachmentError,
    Simulator,
    Started,
    kind_of,
)
from swarmwright.simulations.command.ros_definition import Pose

PORT = 23000
"""Of a CoppeliaSim that was started without an option for it."""
_LONGEST_STOP = 1000
"""Checks, `_CHECK_MS` apart, in which a simulation must have stopped."""
_CHECK_MS = 200


def _proximity(sim: Any, handle: int, _: int) -> float | None:  # noqa: ANN401 - of the client
    detected, distance, *_rest = sim.readProximitySensor(handle)
    return float(distance) if detected == 1 else None


def _vision(sim: Any, handle: int, index: int) -> float:  # noqa: ANN401 - of the client
    _, packets, *_rest = sim.readVisionSensor(handle)
    return float(packets[0][index] if isinstance(packets[0], list) else packets[index])


SENSORS: dict[str, Callable[[Any, int, int], float | None]] = {
    "proximity": _proximity,
    "vision": _vision,
    "joint_position": lambda sim, handle, _: float(sim.getJointPosition(handle)),
    "joint_velocity": lambda sim, handle, _: float(sim.getJointVelocity(handle)),
    "position": lambda sim, handle, index: float(sim.getObjectPosition(handle)[index]),
    "orientation": lambda sim, handle, index: float(sim.getObjectOrientation(handle)[index]),
}
"""Kinds of sensors."""
ACTUATORS: dict[str, Callable[[Any, int, float], object]] = {
    "joint_velocity": lambda sim, handle, value: sim.setJointTargetVelocity(handle, value),
    "joint_position": lambda sim, handle, value: sim.setJointTargetPosition(handle, value),
    "joint_force": lambda sim, handle, value: sim.setJointTargetForce(handle, value),
}
"""Kinds of actuators."""


class CoppeliaSim(Simulator):
    """CoppeliaSim, connected.

    Raises InputError when the client is not installed, AttachmentError when nothing answers, or a robot or a
    device of the file is not in the scene.
    """

    def __init__(self, attachment: Attachment) -> None:
        attachment.check_kinds(SENSORS, ACTUATORS)
        connect = _client()
        self._given, self._seconds = attachment, attachment.startup
        port = PORT if attachment.start is None else _attached.free_port()
        self._started = (
            None if attachment.start is None else Started(attachment.start, port, attachment.folder)
        )
        self._where = f"{attachment.host if self._started is None else '127.0.0.1'}:{port}"
        try:
            host, _, _ = self._where.partition(":")
            self._client = connect(host, port, self._await)
            self._call(self._connect)  # the first request waits for CoppeliaSim to start
            self._seconds = attachment.patience
        except BaseException:
            self.close()
            raise

    def reset(self, poses: Sequence[Pose]) -> None:
        """Stop the simulation, which puts everything back, and start it."""
        self._call(self._restart, poses)

    def step(self, commands: Sequence[Sequence[float]]) -> None:
        """Set joints, then step."""
        self._call(self._go, commands)

    def sensed(self) -> list[list[float | None]]:
        """Read devices."""
        kinds = [SENSORS[kind_of(sensor, SENSORS)] for sensor in self._given.sensors]
        read: list[list[float | None]] = self._call(
            lambda: [
                [
                    kind(self._sim, handle, sensor.index)
                    for kind, handle, sensor in zip(kinds, row, self._given.sensors, strict=True)
                ]
                for row in self._sensors
            ]
        )
        return read

    def poses(self) -> list[Pose]:
        """Read positions and orientations of the robots' objects."""

        def one(robot: int) -> Pose:
            x, y, z = self._sim.getObjectPosition(robot)
            return Pose(x=x, y=y, z=z, yaw=float(self._sim.getObjectOrientation(robot)[2]))

        found: list[Pose] = self._call(lambda: [one(robot) for robot in self._robots])
        return found

    def close(self) -> None:
        """Stop the simulation; end CoppeliaSim where it was started for this."""
        with suppress(Exception):
            if self._started is None:
                self._sim.stopSimulation()
        if self._started is not None:
            self._started.end()

    def _connect(self) -> None:
        self._sim = self._client.require("sim")
        self._robots = [self._object(name) for name in self._given.robots]
        self._sensors, self._actuators = (
            [[self._object(f"{robot}/{device.device}") for device in devices] for robot in self._given.robots]
            for devices in (self._given.sensors, self._given.actuators)
        )

    def _object(self, path: str) -> int:
        path = path if path.startswith("/") else f"/{path}"
        handle = int(self._sim.getObject(path, {"noError": True}))
        if handle < 0:
            raise AttachmentError(f"{path}: the scene in CoppeliaSim has no such object")
        return handle

    def _restart(self, poses: Sequence[Pose]) -> None:
        sim = self._sim
        sim.stopSimulation()
        for _ in range(_LONGEST_STOP):
            if sim.getSimulationState() == sim.simulation_stopped:
                break
            time.sleep(0.01)
        else:
            raise AttachmentError("the simulation does not stop")
        sim.setStepping(True)
        for robot, pose in zip(self._robots, poses, strict=False):
            sim.setObjectPosition(robot, [pose.x, pose.y, pose.z])
            sim.setObjectOrientation(robot, [0.0, 0.0, pose.yaw])
        sim.startSimulation()
        sim.step()  # sensors read nothing before

    def _go(self, commands: Sequence[Sequence[float]]) -> None:
        kinds = [ACTUATORS[kind_of(actuator, ACTUATORS)] for actuator in self._given.actuators]
        for handles, row in zip(self._actuators, commands, strict=True):
            for kind, handle, value in zip(kinds, handles, row, strict=True):
                kind(self._sim, handle, value)
        for _ in range(self._given.ticks):
            self._sim.step()

    def _await(self, has_answer: Callable[[int], object]) -> None:
        """Wait for an answer. Raises AttachmentError when CoppeliaSim has ended, or no time is left."""
        deadline = time.monotonic() + self._seconds
        while not has_answer(_CHECK_MS):
            if self._started is not None:
                self._started.check()
            if time.monotonic() > deadline:
                raise AttachmentError(
                    f"CoppeliaSim does not answer at {self._where} for {self._seconds:g} s; is it running, "
                    "with the ZeroMQ remote API?"
                )

    def _call(self, function: Callable[..., Any], *arguments: object) -> Any:  # noqa: ANN401 - what it returns
        """Call something that calls CoppeliaSim. Raises AttachmentError for any failure."""
        try:
            return function(*arguments)
        except AttachmentError:
            raise
        except Exception as error:  # noqa: BLE001 - the client raises nothing else
            raise AttachmentError(f"CoppeliaSim reports: {' '.join(str(error).split())}") from None


def _client() -> Callable[[str, int, Callable[[Callable[[int], object]], None]], Any]:
    """Return what makes a client, given host, port, and what waits for answers.

    Raises InputError when the published client is not installed.
    """
    try:
        from coppeliasim_zmqremoteapi_client import RemoteAPIClient
    except ModuleNotFoundError as error:
        raise InputError(f"{error.name} is not installed; pip install 'swarmwright[coppeliasim]'") from None

    class Client(RemoteAPIClient):  # type: ignore[misc] # it has no types
        """Waits for an answer for a limited time; the published client does so for ever."""

        def __init__(self, host: str, port: int, wait: Callable[[Callable[[int], object]], None]) -> None:
            super().__init__(host, port)
            self.socket.linger = 0
            self._wait = wait

        def _recv(self) -> Any:  # noqa: ANN401 - what CoppeliaSim answers
            self._wait(self.socket.poll)
            return super()._recv()

    return Client


def main(arguments: Sequence[str]) -> int:
    """Run episodes until the standard input ends; return the exit status."""
    return _attached.serve(arguments, "swarmwright.simulations.coppeliasim", CoppeliaSim)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
