"""The controller of a robot, or of the supervisor, in Webots: started by `swarmwright.simulations.webots`.

It needs only Webots' module `controller`. Requests are JSON objects in lines of the standard input; answers
go to the standard output.

    {"devices": {"sensors": [..], "actuators": [..]}, "ticks": 2}   -> {"step": 32}
    {"find": ["e-puck", ..]}                                       -> {}
    {"reset": true}, {"poses": [[x, y, z, yaw], ..]}                -> {}
    {"step": [3.1, ..]}                                            -> {"read": [0.2, null, ..]}
    {"read_poses": true}                                           -> {"poses": [[x, y, z, yaw], ..]}

A request that fails is answered with {"error": "reason"}.
"""

from __future__ import annotations

import json
import math
import os
import sys
from collections.abc import Callable
from typing import Any

SENSORS: dict[str, Callable[[Any, int], float]] = {
    "value": lambda device, _: device.getValue(),
    "values": lambda device, index: device.getValues()[index],
    "range_image": lambda device, index: device.getRangeImage()[index],
    "roll_pitch_yaw": lambda device, index: device.getRollPitchYaw()[index],
}
ACTUATORS: dict[str, Callable[[Any, float], object]] = {
    "velocity": lambda device, value: device.setVelocity(value),
    "position": lambda device, value: device.setPosition(value),
    "torque": lambda device, value: device.setTorque(value),
    "led": lambda device, value: device.set(round(value)),
}


class RequestError(Exception):
    """A request failed."""


class Controller:
    """A robot's controller, which answers requests."""

    def __init__(self, *, supervisor: bool) -> None:
        import controller

        self._robot = controller.Supervisor() if supervisor else controller.Robot()
        self._tick = int(self._robot.getBasicTimeStep())
        self._sensors: list[tuple[Any, str, int]] = []
        self._actuators: list[tuple[Any, str]] = []
        self._nodes: list[Any] = []
        self._step_ms = self._tick

    def answer(self, request: dict[str, Any]) -> dict[str, Any]:
        """Return the answer to a request."""
        for name in ("devices", "find", "reset", "poses", "step", "read_poses"):
            if name in request:
                answer: dict[str, Any] = getattr(self, f"_{name}")(request)
                return answer
        raise RequestError(f"unknown request {request}")

    def _devices(self, request: dict[str, Any]) -> dict[str, Any]:
        self._step_ms = self._tick * int(request["ticks"])
        self._sensors = [
            (self._device(name), kind, index) for name, kind, index in request["devices"]["sensors"]
        ]
        self._actuators = [(self._device(name), kind) for name, kind in request["devices"]["actuators"]]
        self._prepare()
        return {"step": self._step_ms}

    def _device(self, name: str) -> Any:  # noqa: ANN401 - of Webots
        device = self._robot.getDevice(name)
        if device is None:
            raise RequestError(f"it has no device {name!r}")
        return device

    def _prepare(self) -> None:
        """Enable sensors, and configure actuators at rest."""
        for device, _, _ in self._sensors:
            device.enable(self._step_ms)
        for device, kind in self._actuators:
            if kind == "velocity":
                device.setPosition(math.inf)
            if kind in ("velocity", "torque"):
                ACTUATORS[kind](device, 0.0)

    def _find(self, request: dict[str, Any]) -> dict[str, Any]:
        children = self._robot.getRoot().getField("children")
        nodes = {}
        for index in range(children.getCount()):
            node = children.getMFNode(index)
            name = node.getField("name")
            if name is not None:
                nodes[name.getSFString()] = node
        for name in request["find"]:
            if name not in nodes:
                raise RequestError(f"the world has no robot {name!r}; available: {', '.join(sorted(nodes))}")
        self._nodes = [nodes[name] for name in request["find"]]
        return {}

    def _reset(self, request: dict[str, Any]) -> dict[str, Any]:
        if request["reset"] == "simulation":
            self._robot.simulationReset()
        self._prepare()
        return {}

    def _poses(self, request: dict[str, Any]) -> dict[str, Any]:
        for node, (x, y, z, yaw) in zip(self._nodes, request["poses"], strict=True):
            field = node.getField("translation")
            field.setSFVec3f([x, y, field.getSFVec3f()[2] if z is None else z])
            node.getField("rotation").setSFRotation([0.0, 0.0, 1.0, yaw])
            node.resetPhysics()
        return {}

    def _step(self, request: dict[str, Any]) -> dict[str, Any]:
        for (device, kind), value in zip(self._actuators, request["step"], strict=False):  # empty: unchanged
            ACTUATORS[kind](device, value)
        if self._robot.step(self._step_ms) == -1:
            raise RequestError("Webots has ended the simulation")
        read = [SENSORS[kind](device, index) for device, kind, index in self._sensors]
        return {"read": [value if math.isfinite(value) else None for value in read]}

    def _read_poses(self, _: dict[str, Any]) -> dict[str, Any]:
        poses = []
        for node in self._nodes:
            turned = node.getOrientation()  # a matrix, row by row
            poses.append([*node.getPosition()[:3], math.atan2(turned[3], turned[0])])
        return {"poses": poses}


def main() -> int:
    """Answer requests until the standard input ends; return the exit status."""
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)  # keeps Webots' output apart from answers
    controller = None
    for line in sys.stdin:
        try:
            if controller is None:
                controller = Controller(supervisor=sys.argv[1:] == ["supervisor"])
            answer = controller.answer(json.loads(line))
        except ModuleNotFoundError as error:
            answer = {
                "error": f"Python has no module {error.name!r}; set WEBOTS_HOME to the folder of Webots"
            }
        except RequestError as error:
            answer = {"error": str(error)}
        except Exception as error:  # noqa: BLE001 - of Webots; reported in the answer
            answer = {"error": f"{type(error).__name__}: {error}"}
        answers.write(f"{json.dumps(answer)}\n")
        answers.flush()
    return 0


if __name__ == "__main__":
    sys.exit(main())
