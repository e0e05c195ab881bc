"""Robots in CoppeliaSim, through its ZeroMQ remote API: `python -m swarmwright.simulations.coppeliasim`.

The program is a stepwise command of an experiment, see docs/how-to/simulators.md. It needs
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
    SimulatorProcess,
    get_kind,
)
from swarmwright.simulations.command.ros_definition import Pose

PORT = 23000
"""Default port of CoppeliaSim."""
_LONGEST_STOP = 1000
"""Largest number of checks, 10 ms apart, whether a simulation has stopped."""
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
    """A connection to CoppeliaSim.

    Raises InputError if the client is not installed; AttachmentError if CoppeliaSim does not answer, or a
    robot or device is not in the scene.
    """

    def __init__(self, attachment: Attachment) -> None:
        attachment.check_kinds(SENSORS, ACTUATORS)
        connect = _client()
        self._attachment, self._seconds = attachment, attachment.startup
        port = PORT if attachment.start is None else _attached.free_port()
        self._started = (
            None if attachment.start is None else SimulatorProcess(attachment.start, port, attachment.folder)
        )
        self._address = f"{attachment.host if self._started is None else '127.0.0.1'}:{port}"
        try:
            host, _, _ = self._address.partition(":")
            self._client = connect(host, port, self._await)
            self._call(self._connect)  # the first request waits for CoppeliaSim to start
            self._seconds = attachment.patience
        except BaseException:
            self.close()
            raise

    def reset(self, poses: Sequence[Pose]) -> None:
        """Stop the simulation, which resets it, and start it again."""
        self._call(self._restart, poses)

    def step(self, commands: Sequence[Sequence[float]]) -> None:
        """Set joints, then step."""
        self._call(self._go, commands)

    def read_sensors(self) -> list[list[float | None]]:
        """Read devices."""
        kinds = [SENSORS[get_kind(sensor, SENSORS)] for sensor in self._attachment.sensors]
        read: list[list[float | None]] = self._call(
            lambda: [
                [
                    kind(self._sim, handle, sensor.index)
                    for kind, handle, sensor in zip(kinds, row, self._attachment.sensors, strict=True)
                ]
                for row in self._sensors
            ]
        )
        return read

    def poses(self) -> list[Pose]:
        """Read positions and orientations of the robots' objects."""

        def read_pose(robot: int) -> Pose:
            x, y, z = self._sim.getObjectPosition(robot)
            return Pose(x=x, y=y, z=z, yaw=float(self._sim.getObjectOrientation(robot)[2]))

        poses: list[Pose] = self._call(lambda: [read_pose(robot) for robot in self._robots])
        return poses

    def close(self) -> None:
        """Stop the simulation, or end CoppeliaSim if this object has started it."""
        with suppress(Exception):
            if self._started is None:
                self._sim.stopSimulation()
        if self._started is not None:
            self._started.end()

    def _connect(self) -> None:
        self._sim = self._client.require("sim")
        self._robots = [self._object(name) for name in self._attachment.robots]
        self._sensors, self._actuators = (
            [
                [self._object(f"{robot}/{device.device}") for device in devices]
                for robot in self._attachment.robots
            ]
            for devices in (self._attachment.sensors, self._attachment.actuators)
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
        sim.step()  # sensors have no values before the first step

    def _go(self, commands: Sequence[Sequence[float]]) -> None:
        kinds = [ACTUATORS[get_kind(actuator, ACTUATORS)] for actuator in self._attachment.actuators]
        for handles, row in zip(self._actuators, commands, strict=True):
            for kind, handle, value in zip(kinds, handles, row, strict=True):
                kind(self._sim, handle, value)
        for _ in range(self._attachment.ticks):
            self._sim.step()

    def _await(self, has_answer: Callable[[int], object]) -> None:
        """Wait for an answer. Raises AttachmentError if CoppeliaSim has ended, or on a time-out."""
        deadline = time.monotonic() + self._seconds
        while not has_answer(_CHECK_MS):
            if self._started is not None:
                self._started.check()
            if time.monotonic() > deadline:
                raise AttachmentError(
                    f"CoppeliaSim at {self._address} did not answer for {self._seconds:g} s; is it running "
                    "with the ZeroMQ remote API?"
                )

    def _call(self, function: Callable[..., Any], *arguments: object) -> Any:  # noqa: ANN401 - what it returns
        """Call a function that calls CoppeliaSim. Raises AttachmentError for any failure."""
        try:
            return function(*arguments)
        except AttachmentError:
            raise
        except Exception as error:  # noqa: BLE001 - the client raises plain exceptions
            raise AttachmentError(f"CoppeliaSim reports: {' '.join(str(error).split())}") from None


def _client() -> Callable[[str, int, Callable[[Callable[[int], object]], None]], Any]:
    """Return the class of the client, with the arguments host, port, and a function that waits for answers.

    Raises InputError if the published client is not installed.
    """
    try:
        from coppeliasim_zmqremoteapi_client import RemoteAPIClient
    except ModuleNotFoundError as error:
        raise InputError(f"{error.name} is not installed; pip install 'swarmwright[coppeliasim]'") from None

    class Client(RemoteAPIClient):  # type: ignore[misc] # it has no types
        """Client with a time limit for answers, which the published client lacks."""

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
