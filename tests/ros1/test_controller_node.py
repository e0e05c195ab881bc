"""The node `swarmwright_controller` of exported packages, on a real roscore."""

import copy
import json
import math
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmwright import _engine
from tests.ros1.machine import EXPORTED, Driver, Master, end

SCAN, RANGE, ODOMETRY = "sensor_msgs/LaserScan", "sensor_msgs/Range", "nav_msgs/Odometry"
TWIST, FLOAT = "geometry_msgs/Twist", "std_msgs/Float32"
MAPPING: dict[str, Any] = {
    "rate": 50,
    "timeout": 1.5,
    "sensors": [
        {"sensor": "sensor 0", "topic": "scan", "type": SCAN, "sector": [-30, 30], "clip": [0, 2.5]},
        {"sensor": "sensor 1", "topic": "scan", "type": SCAN, "sector": [150, 210], "reduce": "mean",
         "scale": 0.3, "offset": -1, "infinite": 5},
        {"sensor": "sensor 2", "topic": "sonar", "type": RANGE, "field": "range", "scale": 0.1},
        {"sensor": "sensor 3", "topic": "odom", "type": ODOMETRY, "field": "yaw", "scale": 1 / math.pi},
        {"sensor": "sensor 4", "topic": "odom", "type": ODOMETRY, "field": "pose.pose.position.x"},
        {"sensor": "sensor 6", "topic": "light", "type": FLOAT, "scale": 0.7, "offset": 0.1},
        {"sensor": "sensor 5", "topic": "target", "type": TWIST, "field": "angular.z"},
    ],
    "actuators": [
        {"actuator": "actuator 1", "topic": "cmd_vel", "type": TWIST, "field": "angular.z", "scale": -1.5},
        {"actuator": "actuator 0", "topic": "cmd_vel", "type": TWIST, "field": "linear.x", "scale": 0.5,
         "offset": 0.5, "limits": [0.1, 0.8]},
        {"actuator": "actuator 2", "topic": "gripper", "type": FLOAT},
    ],
}  # fmt: skip
TOPICS = {"scan": SCAN, "sonar": RANGE, "odom": ODOMETRY, "light": FLOAT, "target": TWIST}


class Running:
    """A node, in a namespace of its own, and what it says."""

    def __init__(self, driver: Driver, process: "subprocess.Popen[str]", name: str, output: Path) -> None:
        self._driver, self.process, self.name, self._output = driver, process, name, output

    def said(self) -> str:
        return self._output.read_text(encoding="utf-8")

    def publish(self, row: "dict[str, Any]") -> None:
        for topic, message in row.items():
            self._driver("publish", topic=f"{self.name}/{topic}", kind=TOPICS[topic], message=message)

    def silence(self, topic: str) -> None:
        self._driver("silence", topic=f"{self.name}/{topic}")

    def record(self, topic: str, kind: str) -> None:
        self._driver("record", topic=f"{self.name}/{topic}", kind=kind)

    def recorded(self, topic: str) -> list[Any]:
        found: list[Any] = self._driver("recorded", topic=f"{self.name}/{topic}")
        return found

    def steps(self) -> np.ndarray[Any, np.dtype[np.float32]]:
        """(steps, sensors + actuators)."""
        data = [step["data"] for step in self.recorded("swarmwright_controller/steps")]
        return np.array(data, np.float32).reshape(len(data), 10)


def grown(running: Running, steps: int) -> bool:
    return len(running.steps()) > steps


def until(holds: Callable[[], Any], seconds: float = 20) -> None:
    """Wait until something holds."""
    deadline = time.monotonic() + seconds
    while not holds():
        assert time.monotonic() < deadline, "it does not come true"
        time.sleep(0.02)


@contextmanager
def node(
    master: Master, driver: Driver, mapping: "dict[str, Any] | None", folder: Path, name: str = "robot"
) -> Iterator[Running]:
    """The node with a mapping, in the namespace `/name`."""
    if mapping is not None:
        driver("set", name=f"/{name}/swarmwright_controller/mapping", value=mapping)
    output = folder / "said.txt"
    with output.open("w", encoding="utf-8") as file:
        process = master.workspace.start(
            "devel/lib/rover/swarmwright_controller", f"__ns:={name}",
            stdin=subprocess.DEVNULL, stdout=file, stderr=subprocess.STDOUT,
        )  # fmt: skip
    try:
        yield Running(driver, process, f"/{name}", output)
    finally:
        end(process)
        print(output.read_text(encoding="utf-8"))


def row(index: int) -> dict[str, Any]:
    """Messages of all topics, other ones for each index."""
    ranges = [1.0 + 0.01 * beam + 0.1 * index for beam in range(36)]
    ranges[17] = math.nan
    ranges[35] = math.inf
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


def expected_sensors(index: int) -> "np.ndarray[Any, np.dtype[np.float32]]":
    """What the mapping makes of `row(index)`, computed in another way than in the node."""
    scan = row(index)["scan"]
    # As in the messages, which hold binary32.
    beams = [float(np.float32(one)) for one in scan["ranges"]]
    far = float(np.float32(4.0))
    front = [one for one in beams[15:22] if not math.isnan(one)]
    back = [5.0 if one > far else one for one in [*beams[0:4], *beams[33:36]]]
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


def driven(running: Running) -> list[tuple[float, float]]:
    return [(one["linear"]["x"], one["angular"]["z"]) for one in running.recorded("cmd_vel")]


def computed(controller: "_engine.Controller", sensors: Any) -> Any:
    """What the engine's controller does, bit by bit."""
    rows = [controller.step(np.ascontiguousarray(one)) for one in sensors]
    return np.array(rows, np.float32).reshape(-1, 3).view(np.uint32)


@pytest.mark.timeout(120)
def test_the_node_computes_what_the_engine_computes(master: Master, driver: Driver, tmp_path: Path) -> None:
    controller = _engine.Controller(json.dumps(EXPORTED))
    with node(master, driver, MAPPING, tmp_path) as running:
        running.record("swarmwright_controller/steps", "std_msgs/Float32MultiArray")
        running.record("cmd_vel", TWIST)
        running.record("gripper", FLOAT)
        for index in range(12):
            running.publish(row(index))
            count = len(running.steps())
            until(partial(grown, running, count + 8))
        steps = running.steps()
        sensors, actuators = steps[:, :7], np.ascontiguousarray(steps[:, 7:])
        # Every sensor had all its values, in their order, and no others: up to the last bit of a sum.
        wanted = np.array([expected_sensors(index) for index in range(12)])
        for number in range(7):
            seen = [
                value
                for value, before in zip(sensors[1:, number], sensors[:, number], strict=False)
                if value != before
            ]
            distinct = list(dict.fromkeys(wanted[:, number].tolist()))
            np.testing.assert_allclose(
                [sensors[0, number], *seen], distinct, rtol=3e-7, err_msg=f"sensor {number}"
            )
        # The same actuators as the engine's controller, which has the same state, in every step.
        np.testing.assert_array_equal(actuators.view(np.uint32), computed(controller, sensors))
        assert len(np.unique(actuators, axis=0)) >= 12
        # Every command is that of a step, in their order; zeros before the first one.
        said = commands(actuators)
        until(lambda: driven(running)[-1] == said[-1] or len(running.steps()) > len(steps))
        given = [one for one in driven(running) if one != (0.0, 0.0)]
        rest = iter(commands(running.steps()[:, 7:]))
        assert all(one in rest for one in given)
        assert len(given) > len(said) / 2
        assert running.recorded("gripper")[-1]["data"] in running.steps()[:, 9].tolist()
        assert running.process.poll() is None
        count = len(driven(running))
        running.process.send_signal(signal.SIGINT)
        assert running.process.wait(10) == 0
        # The last command stops the robot.
        until(lambda: len(driven(running)) > count and driven(running)[-1] == (0.0, 0.0))


@pytest.mark.timeout(120)
def test_silence_stops_the_robot_until_it_ends(master: Master, driver: Driver, tmp_path: Path) -> None:
    controller = _engine.Controller(json.dumps(EXPORTED))
    mapping = {**MAPPING, "timeout": 2.0}
    with node(master, driver, mapping, tmp_path, "silent") as running:
        running.record("swarmwright_controller/steps", "std_msgs/Float32MultiArray")
        running.record("cmd_vel", TWIST)
        until(lambda: "waiting for /silent/scan, /silent/sonar" in running.said())
        running.publish({topic: message for topic, message in row(1).items() if topic != "light"})
        until(lambda: len(driven(running)) > 20)
        # One sensor is missing: no step, the robot stands.
        assert len(running.steps()) == 0
        assert set(driven(running)) == {(0.0, 0.0)}
        running.publish(row(1))
        until(lambda: len(running.steps()) > 5)
        assert "all sensors are there: the controller runs at 50 Hz" in running.said()

        running.silence("sonar")
        silent = time.monotonic()
        until(lambda: driven(running)[-1] == (0.0, 0.0))
        assert 1.0 < time.monotonic() - silent < 10
        until(lambda: "stopped: nothing comes from /silent/sonar" in running.said())
        stopped = len(running.steps())
        count = len(driven(running))
        until(lambda: len(driven(running)) > count + 20)
        assert set(driven(running)[count:]) == {(0.0, 0.0)}
        assert len(running.steps()) == stopped
        assert running.said().count("stopped:") == 1

        # It goes on where it was.
        running.publish(row(2))
        until(lambda: len(running.steps()) > stopped + 5)
        steps = running.steps()
        np.testing.assert_array_equal(
            np.ascontiguousarray(steps[:, 7:]).view(np.uint32), computed(controller, steps[:, :7])
        )

        # The service begins a new episode; nothing is sensed meanwhile: it is known between which steps.
        running.silence("odom")
        until(lambda: running.said().count("stopped:") == 2)
        before = len(running.steps())
        driver("call", service="/silent/swarmwright_controller/reset")
        running.publish(row(3))
        until(lambda: len(running.steps()) > before + 5)
        after = running.steps()[before:]
        controller.reset()
        np.testing.assert_array_equal(
            np.ascontiguousarray(after[:, 7:]).view(np.uint32), computed(controller, after[:, :7])
        )


@pytest.mark.timeout(120)
def test_a_controller_that_begins_anew_after_silence(master: Master, driver: Driver, tmp_path: Path) -> None:
    controller = _engine.Controller(json.dumps(EXPORTED))
    mapping = {**MAPPING, "timeout": 2.0, "reset_after_silence": True}
    with node(master, driver, mapping, tmp_path, "anew") as running:
        running.record("swarmwright_controller/steps", "std_msgs/Float32MultiArray")
        running.publish(row(1))
        until(lambda: len(running.steps()) > 5)
        # A number that is none is as good as nothing.
        running.publish({"light": {"data": math.nan}})
        until(lambda: "stopped: nothing comes from /anew/light" in running.said())
        before = len(running.steps())
        running.publish(row(2))
        until(lambda: len(running.steps()) > before + 5)
        after = running.steps()[before:]
        np.testing.assert_array_equal(
            np.ascontiguousarray(after[:, 7:]).view(np.uint32), computed(controller, after[:, :7])
        )


def changed(change: Callable[[dict[str, Any]], object]) -> dict[str, Any]:
    mapping = copy.deepcopy(MAPPING)
    change(mapping)
    return mapping


WRONG: dict[str, tuple[Callable[[dict[str, Any]], object], str]] = {
    "unknown-sensor": (
        lambda m: m["sensors"][0].update(sensor="goal x"),
        "sensors[0]: the controller has no sensor 'goal x'; it has sensor 0, sensor 1",
    ),
    "missing-sensor": (
        lambda m: m["sensors"].pop(2), "sensors: 'sensor 2' is missing; every sensor needs an entry"
    ),
    "missing-actuator": (lambda m: m["actuators"].pop(), "actuators: 'actuator 2' is missing"),
    "twice": (
        lambda m: m["sensors"].append(m["sensors"][2]),
        "sensors[7] (sensor 2): is mapped twice",
    ),
    "no-actuators": (lambda m: m.pop("actuators"), "mapping: actuators is missing"),
    "not-a-list": (lambda m: m.update(sensors={"a": 1}), "mapping: sensors: expected a list"),
    "template": (lambda m: m["sensors"][0].update(topic=""), "sensors[0] (sensor 0): topic is empty"),
    "unknown-type": (
        lambda m: m["sensors"][2].update(type="sensor_msgs/Imu"),
        "sensors[2] (sensor 2): the type 'sensor_msgs/Imu' is not known here; expected sensor_msgs/LaserScan",
    ),
    "sensor-as-actuator": (
        lambda m: m["actuators"][2].update(type=SCAN),
        "actuators[2] (actuator 2): the type 'sensor_msgs/LaserScan' is not known here; expected",
    ),
    "unknown-field": (
        lambda m: m["actuators"][0].update(field="linear"),
        "actuators[0] (actuator 1): field 'linear' is not in geometry_msgs/Twist; expected angular.x",
    ),
    "missing-field": (
        lambda m: m["sensors"][3].pop("field"), "sensors[3] (sensor 3): field is missing; expected"
    ),
    "unknown-key": (
        lambda m: m["sensors"][2].update(factor=2),
        "sensors[2] (sensor 2): unknown key 'factor'; expected sensor, topic, type, field, scale",
    ),
    "unknown-key-above": (lambda m: m.update(frequency=2), "mapping: unknown key 'frequency'; expected rate"),
    "text-for-number": (
        lambda m: m["sensors"][2].update(scale="2"),
        "sensors[2] (sensor 2): scale: 2 found, expected a number",
    ),
    "rate": (lambda m: m.update(rate=0), "mapping: rate: 0 found, expected more than 0"),
    "no-rate": (lambda m: m.pop("rate"), "mapping: rate is missing"),
    "clip": (
        lambda m: m["sensors"][0].update(clip=[1, 1]),
        "sensors[0] (sensor 0): clip: the first number must be below the second",
    ),
    "reduce": (
        lambda m: m["sensors"][0].update(reduce="max"), "reduce: 'max' found, expected min or mean"
    ),
    "two-types": (
        lambda m: m["sensors"][2].update(topic="scan"),
        "/wrong/scan has the type sensor_msgs/LaserScan at sensors[0] (sensor 0) and sensor_msgs/Range here",
    ),
    "same-field": (
        lambda m: m["actuators"][0].update(field="linear.x"),
        "actuators[0] (actuator 1): writes the same field as actuators[1] (actuator 0)",
    ),
    "topic-name": (
        lambda m: m["sensors"][2].update(topic="so nar"), "sensors[2] (sensor 2): topic 'so nar':"
    ),
    "other-publisher": (
        lambda m: m["sensors"][2].update(topic="/wrong/laser"),
        "/wrong/laser has the type sensor_msgs/LaserScan, but the mapping says sensor_msgs/Range",
    ),
}  # fmt: skip


@pytest.mark.timeout(60)
@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_mapping_is_refused(name: str, master: Master, driver: Driver, tmp_path: Path) -> None:
    change, message = WRONG[name]
    driver("advertise", topic="/wrong/laser", kind=SCAN)
    with node(master, driver, changed(change), tmp_path, "wrong") as running:
        assert running.process.wait(20) == 2
    assert message in running.said()


@pytest.mark.timeout(60)
def test_without_a_mapping(master: Master, driver: Driver, tmp_path: Path) -> None:
    with node(master, driver, None, tmp_path, "none") as running:
        assert running.process.wait(20) == 2
    assert (
        "the parameter ~mapping is missing; controller.launch loads it from a file, mapping:=FILE"
        in running.said()
    )
