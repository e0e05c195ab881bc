"""A robot's side of conversations with a node that runs a controller: messages, and what must come of them.

The same for ROS 1, for the nodes of ROS 2, and for the one that speaks DDS alone.
"""

import json
import math
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from swarmwright import _engine
from swarmwright.simulations.ros.topics import Generator
from tests.python.export.specifications import network

EXPORTED = network("fully_meshed", "tanh", [-1.0, 1.0], sensors=7, actuators=3)
"""The exported controller; it has a state."""

Numbers = np.ndarray[Any, np.dtype[np.float32]]


def until(holds: Callable[[], Any], seconds: float = 20) -> None:
    """Wait until something holds."""
    deadline = time.monotonic() + seconds
    while not holds():
        assert time.monotonic() < deadline, "it does not come true"
        time.sleep(0.02)


def row(index: int) -> dict[str, Any]:
    """Messages of all topics of `mistakes.MAPPING`, other ones for each index."""
    ranges = [1.0 + 0.01 * beam + 0.1 * index for beam in range(36)]
    ranges[17] = math.nan
    ranges[35] = math.inf
    ranges[18], ranges[34] = 0.0, 0.05  # below the smallest range: no measurements
    angle = 0.2 * index
    return {
        "scan": {"angle_min": -math.pi, "angle_increment": math.pi / 18, "range_min": 0.1, "range_max": 4.0,
                 "ranges": ranges},
        "sonar": {"min_range": 0.2, "max_range": 3.0, "range": 0.5 + index},
        "odom": {"pose": {"pose": {"position": {"x": -0.3 * index},
                                   "orientation": {"z": math.sin(angle / 2), "w": math.cos(angle / 2)}}}},
        "light": {"data": 0.31 * index},
        "target": {"angular": {"z": 0.07 * index}},
    }  # fmt: skip


def expected_sensors(index: int) -> Numbers:
    """What the mapping makes of `row(index)`, computed in another way than in the nodes."""
    scan = row(index)["scan"]
    # As in the messages, which hold binary32.
    beams = [float(np.float32(one)) for one in scan["ranges"]]
    near, far = float(np.float32(0.1)), float(np.float32(4.0))
    front = [one for one in beams[15:22] if one >= near]
    back = [5.0 if one > far else one for one in [*beams[0:4], *beams[33:36]] if one >= near]
    angle = 0.2 * index
    z, w = math.sin(angle / 2), math.cos(angle / 2)
    sonar = float(np.float32(0.5 + index))
    return np.array(
        [
            min(2.5, *front),
            math.fsum(back) / len(back) * 0.3 - 1,
            min(sonar, 3.0) * 0.1,
            math.atan2(2 * w * z, 1 - 2 * z * z) / math.pi,
            -0.3 * index,
            0.07 * index,
            float(np.float32(0.31 * index)) * 0.7 + 0.1,
        ],
        np.float32,
    )


def commands(actuators: "np.ndarray[Any, Any]") -> list[tuple[float, float]]:
    """linear.x and angular.z for rows of actuators."""
    return [(min(max(float(a) * 0.5 + 0.5, 0.1), 0.8), float(b) * -1.5) for a, b, *_ in actuators.tolist()]


def on_wheels(mapping: dict[str, Any]) -> None:
    """Have two actuators be wheels, and a sensor a random number."""
    twist = {"topic": "cmd_vel", "type": "geometry_msgs/Twist"}
    mapping["actuators"][:2] = [
        {**twist, "actuators": {"actuator 1": 0.3, "actuator 0": 0.7}, "field": "linear.x", "scale": 0.12},
        {**twist, "actuators": {"actuator 0": -1, "actuator 1": 1}, "field": "angular.z", "scale": 2.26,
         "limits": [-1, 1]},
    ]  # fmt: skip
    mapping["sensors"][6] = {"sensor": "sensor 5", "source": "random", "seed": 7}


def wheel_commands(actuators: "np.ndarray[Any, Any]") -> list[tuple[float, float]]:
    """linear.x and angular.z of robots on wheels, for rows of actuators."""
    return [
        ((0.7 * a + 0.3 * b) * 0.12, min(max((b - a) * 2.26, -1.0), 1.0)) for a, b, *_ in actuators.tolist()
    ]


def assert_on_wheels(steps: Numbers, driven: list[tuple[float, float]]) -> None:
    """Sums of actuators were published, and random numbers sensed, to the last bit, and at each step."""
    generator = Generator(7)
    drawn = [generator.next() for _ in range(len(steps) + 200)]
    first = drawn.index(float(steps[0, 5]))
    assert steps[:, 5].tolist() == drawn[first : first + len(steps)]
    rest = iter(wheel_commands(steps[:, 7:]))
    moved = [one for one in driven if one != (0.0, 0.0)]
    assert len(moved) > 5
    assert all(one in rest for one in moved)


def engine() -> "_engine.Controller":
    """The engine's controller, at the start of an episode."""
    return _engine.Controller(json.dumps(EXPORTED))


def computed(controller: "_engine.Controller", sensors: Any) -> Any:
    """What the engine's controller does, bit by bit."""
    rows = [controller.step(np.ascontiguousarray(one)) for one in sensors]
    return np.array(rows, np.float32).reshape(-1, 3).view(np.uint32)
