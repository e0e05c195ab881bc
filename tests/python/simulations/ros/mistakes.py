"""Mappings with a mistake, and what is said about it: the same in ROS 1, in C++ for ROS 2 and in Python."""

import copy
import math
from collections.abc import Callable
from typing import Any

SENSORS = [f"sensor {index}" for index in range(7)]
ACTUATORS = [f"actuator {index}" for index in range(3)]
SCAN, RANGE, ODOMETRY = "sensor_msgs/LaserScan", "sensor_msgs/Range", "nav_msgs/Odometry"
TWIST, FLOAT = "geometry_msgs/Twist", "std_msgs/Float32"
MAPPING: dict[str, Any] = {
    "rate": 50,
    "timeout": 1.5,
    "sensors": [
        {"sensor": "sensor 0", "topic": "scan", "type": SCAN, "sector": [-30, 30], "clip": [0, 2.5]},
        {"sensor": "sensor 1", "topic": "scan", "type": SCAN, "sector": [150, 210], "reduce": "mean",
         "scale": "3e-1", "offset": -1, "infinite": 5},  # text in YAML 1.1
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


def changed(change: Callable[[dict[str, Any]], object]) -> dict[str, Any]:
    """The mapping with a change."""
    mapping = copy.deepcopy(MAPPING)
    change(mapping)
    return mapping


IN_THE_FILE: dict[str, tuple[Callable[[dict[str, Any]], object], str]] = {
    "unknown-sensor": (
        lambda m: m["sensors"][0].update(sensor="goal x"),
        ("sensors[0]: the controller has no sensor 'goal x'; it has sensor 0, sensor 1, sensor 2, sensor 3, "
        "sensor 4, sensor 5 or sensor 6"),
    ),
    "missing-sensor": (
        lambda m: m["sensors"].pop(2), "sensors: 'sensor 2' is missing; every sensor needs an entry"
    ),
    "missing-actuator": (
        lambda m: m["actuators"].pop(), "actuators: 'actuator 2' is missing; every actuator needs an entry"
    ),
    "twice": (lambda m: m["sensors"].append(m["sensors"][2]), "sensors[7] (sensor 2): is mapped twice"),
    "no-actuators": (lambda m: m.pop("actuators"), "mapping: actuators is missing"),
    "not-a-list": (
        lambda m: m.update(sensors={"a": 1}), "mapping: sensors: expected a list, each entry begun by '- '"
    ),
    "not-a-block": (lambda m: m["sensors"].insert(0, 3), "sensors[0]: expected keys and values"),
    "template": (lambda m: m["sensors"][0].update(topic=""), "sensors[0] (sensor 0): topic is empty"),
    "no-topic": (lambda m: m["sensors"][0].pop("topic"), "sensors[0] (sensor 0): topic is missing"),
    "no-name": (lambda m: m["sensors"][0].pop("sensor"), "sensors[0]: sensor is missing"),
    "number-for-text": (
        lambda m: m["sensors"][0].update(topic=5), "sensors[0] (sensor 0): topic: 5 found, expected text"
    ),
    "nothing-for-text": (
        lambda m: m["sensors"][0].update(topic=None),
        "sensors[0] (sensor 0): topic: nothing found, expected text",
    ),
    "unknown-key": (
        lambda m: m["sensors"][2].update(factor=2),
        ("sensors[2] (sensor 2): unknown key 'factor'; expected sensor, source, topic, type, field, scale, "
        "offset, clip, timeout or infinite"),
    ),
    "unknown-key-above": (
        lambda m: m.update(frequency=2),
        "mapping: unknown key 'frequency'; expected rate, timeout, reset_after_silence, sensors or actuators",
    ),
    "sector-of-a-sonar": (
        lambda m: m["sensors"][2].update(sector=[0, 1]),
        ("sensors[2] (sensor 2): unknown key 'sector'; expected sensor, source, topic, type, field, scale, "
        "offset, clip, timeout or infinite"),
    ),
    "text-for-number": (
        lambda m: m["sensors"][2].update(scale="2"),
        "sensors[2] (sensor 2): scale: '2' is text, expected a number",
    ),
    "source": (
        lambda m: m["sensors"].__setitem__(2, {"sensor": "sensor 2", "source": "noise"}),
        "sensors[2] (sensor 2): source: 'noise' found, expected random or constant",
    ),
    "random-with-topic": (
        lambda m: m["sensors"][2].update(source="random"),
        "sensors[2] (sensor 2): unknown key 'field'; expected sensor, source or seed",
    ),
    "constant-without-a-value": (
        lambda m: m["sensors"].__setitem__(2, {"sensor": "sensor 2", "source": "constant"}),
        "sensors[2] (sensor 2): value is missing",
    ),
    "constant-beyond-binary32": (
        lambda m: m["sensors"].__setitem__(2, {"sensor": "sensor 2", "source": "constant", "value": -1e39}),
        "sensors[2] (sensor 2): value: -1e+39 found, expected at most 3.4e38",
    ),
    "constant-with-scale": (
        lambda m: m["sensors"].__setitem__(
            2, {"sensor": "sensor 2", "source": "constant", "value": 1, "scale": 2}
        ),
        "sensors[2] (sensor 2): unknown key 'scale'; expected sensor, source or value",
    ),
    "sector-across-the-back": (
        lambda m: m["sensors"][0].update(sector=[350, 10.5]),
        ("sensors[0] (sensor 0): sector: the first number must be below the second; write [-10, 10.5] or "
        "[350, 370.5]"),
    ),
    "seed": (
        lambda m: m["sensors"].__setitem__(2, {"sensor": "sensor 2", "source": "random", "seed": 0.5}),
        "sensors[2] (sensor 2): seed: 0.5 found, expected a whole number from 0 to 2^53 - 1",
    ),
    "no-weights": (
        lambda m: m["actuators"][2].update(actuators=3),
        "actuators[2]: actuators: 3 found, expected weights by name, such as {left: 0.5, right: 0.5}",
    ),
    "weight-of-nothing": (
        lambda m: m["actuators"][2].update(actuators={"wheel": 1}),
        ("actuators[2]: the controller has no actuator 'wheel'; it has actuator 0, actuator 1 or "
        "actuator 2"),
    ),
    "weight": (
        lambda m: m["actuators"][2].update(actuators={"actuator 2": "half"}),
        "actuators[2]: actuators.actuator 2: 'half' is text, expected a number",
    ),
    "sum-and-one": (
        lambda m: m["actuators"][2].update(actuators={"actuator 2": 1, "actuator 0": 1}),
        ("actuators[2] (actuator 0, actuator 2): unknown key 'actuator'; expected actuators, topic, type, "
        "field, scale, offset or limits"),
    ),
    "true-for-number": (
        lambda m: m["sensors"][2].update(scale=True),
        "sensors[2] (sensor 2): scale: true found, expected a number",
    ),
    "list-for-number": (
        lambda m: m["actuators"][2].update(offset=[1, {"b": 2.5, "a": False}]),
        "actuators[2] (actuator 2): offset: [1, {a: false, b: 2.5}] found, expected a number",
    ),
    "infinity": (
        lambda m: m["sensors"][2].update(scale=float("inf")),
        "sensors[2] (sensor 2): scale: inf found, expected a number",
    ),
    "rate": (lambda m: m.update(rate=0), "mapping: rate: 0 found, expected more than 0"),
    "negative": (lambda m: m.update(timeout=-2.5), "mapping: timeout: -2.5 found, expected more than 0"),
    "no-rate": (lambda m: m.pop("rate"), "mapping: rate is missing"),
    "flag": (
        lambda m: m.update(reset_after_silence="always"),
        "mapping: reset_after_silence: 'always' found, expected true or false",
    ),
    "clip": (
        lambda m: m["sensors"][0].update(clip=[1, 1]),
        "sensors[0] (sensor 0): clip: the first number must be below the second",
    ),
    "three-numbers": (
        lambda m: m["actuators"][1].update(limits=[1, 2, 3]),
        "actuators[1] (actuator 0): limits: expected two numbers [low, high]",
    ),
    "text-in-interval": (
        lambda m: m["actuators"][1].update(limits=["low", 2]),
        "actuators[1] (actuator 0): limits: 'low' is text, expected a number",
    ),
    "reduce": (
        lambda m: m["sensors"][0].update(reduce="max"),
        "sensors[0] (sensor 0): reduce: 'max' found, expected min or mean",
    ),
}  # fmt: skip
"""Found when the file is read."""

IN_THE_TOPICS: dict[str, tuple[Callable[[dict[str, Any]], object], str]] = {
    "unknown-type": (
        lambda m: m["sensors"][2].update(type="sensor_msgs/Imu"),
        ("sensors[2] (sensor 2): the type 'sensor_msgs/Imu' is unknown; expected "
        "sensor_msgs/LaserScan, sensor_msgs/Range, nav_msgs/Odometry, geometry_msgs/Twist, "
        "geometry_msgs/TwistStamped, geometry_msgs/PoseStamped, geometry_msgs/PoseWithCovarianceStamped, "
        "std_msgs/Float32 or std_msgs/Float64"),
    ),
    "sensor-as-actuator": (
        lambda m: m["actuators"][2].update(type=SCAN),
        ("actuators[2] (actuator 2): the type 'sensor_msgs/LaserScan' is unknown; expected "
        "geometry_msgs/Twist, geometry_msgs/TwistStamped, std_msgs/Float32 or std_msgs/Float64"),
    ),
    "unknown-field": (
        lambda m: m["actuators"][0].update(field="linear"),
        ("actuators[0] (actuator 1): field 'linear' is not in geometry_msgs/Twist; expected angular.x, "
        "angular.y, angular.z, linear.x, linear.y or linear.z"),
    ),
    "missing-field": (
        lambda m: m["sensors"][3].pop("field"),
        "sensors[3] (sensor 3): field is missing; expected pose.pose.position.x, ",
    ),
    "two-types": (
        lambda m: m["sensors"][2].update(topic="scan"),
        ("sensors[2] (sensor 2): /wrong/scan has the type sensor_msgs/LaserScan at sensors[0] (sensor 0) and "
        "sensor_msgs/Range here; a topic has one type"),
    ),
    "same-field": (
        lambda m: m["actuators"][0].update(field="linear.x"),
        "actuators[0] (actuator 1): writes the same field as actuators[1] (actuator 0)",
    ),
    "topic-name": (
        lambda m: m["sensors"][2].update(topic="so nar"), "sensors[2] (sensor 2): topic 'so nar': "
    ),
}  # fmt: skip
"""Found when topics are subscribed to and advertised, in the namespace `/wrong`; how what is said begins."""
