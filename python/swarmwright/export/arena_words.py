"""Descriptions of the sensors and actuators of the arena's robots, by name."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from swarmwright.common.ranges import shortest_decimal
from swarmwright.experiment.robots import DEFAULT, robot_of

_E_PUCK = (17.0, 50.0, 90.0, 150.0, 210.0, 270.0, 310.0, 343.0)


@dataclass(frozen=True)
class Robot:
    """Properties of a robot of the arena."""

    max_speed: float = 0.0
    """Largest speed of a wheel, or in any direction, in m/s; 0 if unknown."""
    wheel_base: float = 0.0
    """Distance between the wheels of a differential drive in metres; 0 for other drives."""
    angles: Mapping[str, Sequence[float]] | None = None
    """Angles of proximity and light sensors: degrees counter-clockwise from ahead."""


def _spread_angles(count: int) -> list[float]:
    return [360 * index / count for index in range(count)]


PRESETS = {
    DEFAULT: Robot(0.12, 0.053, {"proximity": _E_PUCK, "light": _E_PUCK}),
    "e-puck-rm1.2": Robot(0.12, 0.053),
    "foot-bot": Robot(0.3, 0.14, {"proximity": _spread_angles(24), "light": _spread_angles(24)}),
    "kilobot": Robot(0.01, 0.0255, {"light": _spread_angles(1)}),
    "turtlebot3": Robot(0.22, 0.16, {"proximity": _spread_angles(36)}),
    "point": Robot(0.2),
}
"""Presets as in engine/worlds/arena/src/robots/model/presets.rs and engine/worlds/arena/src/robots."""
_SENSORS = {
    r"ground( \w+)?": "0 black, 1 white",
    r"messages heard": "the number of messages heard",
    r"messages heard squashed": "1 - 2/(1 + e^n) for n messages heard",
    r"neighbours": "the number of robots in range",
    r"center [xy]": "of the mean position of robots in range, 1 is the range; x is ahead, y left",
    r"heading [xy]": "of the mean of the headings of robots in range, each 1 long; x is ahead, y left",
    r"nearest [xy]": "of the position of the nearest robot in range, 1 is the range; x is ahead, y left",
    r"proximity [xy]": "of a vector towards what is near, at most 1 long; x is ahead, y left",
    r"light [xy]": "of the direction of light, 1 long, or 0 where it is dark; x is ahead, y left",
    r"attraction [xy]": "of the sum of vectors to robots heard, 1/(1 + distance in cm) long, x ahead, y left",
    r"compass [xy]": "of the direction of the arena's x axis; x is ahead, y left",
    r"(left|right) wheel encoder": "what this wheel aimed at in the step before",
    r"message \d+": "the mean of the numbers that robots in range send",
}
"""Descriptions of sensors by a pattern of their full name."""
_RAYS = {"proximity": "0 nothing in range, 1 at the rim", "light": "0 dark, 1 bright"}
"""Descriptions of sensors with an angle, by kind."""


def robot_in(parameters: Mapping[str, Any]) -> Robot:
    """Return the properties of the arena's robot for given parameters; empty for several kinds."""
    robot = robot_of(parameters)
    if not isinstance(robot, Mapping):
        return PRESETS.get(str(robot), Robot())
    preset = PRESETS.get(str(robot.get("preset")), Robot())
    drive, sensors = robot.get("drive", {}), robot.get("sensors")
    drive = drive if isinstance(drive, Mapping) else {}
    angles = preset.angles
    if isinstance(sensors, Mapping) or robot.get("preset") is not None:
        angles = None if sensors else angles  # some of them may differ
    elif isinstance(sensors, Sequence):
        angles = {
            str(sensor.get("kind")): sensor.get("angles") or _spread_angles(int(sensor.get("count", 0)))
            for sensor in sensors
            if isinstance(sensor, Mapping)
        }
    differential = drive.get("kind", "differential") == "differential"
    return Robot(
        float(drive.get("max_speed", preset.max_speed)),
        float(drive.get("wheel_base", preset.wheel_base)) if differential else 0.0,
        angles,
    )


def describe_sensor(name: str, robot: Robot) -> str:
    """Describe a sensor; empty if unknown."""
    kind, _, index = name.partition(" ")
    if kind in _RAYS and index.isdecimal():
        angles = (robot.angles or {}).get(kind, ())
        if int(index) >= len(angles):
            return _RAYS[kind]
        angle = angles[int(index)]
        where = f"{shortest_decimal(angle)} degrees counter-clockwise from ahead" if angle else "ahead"
        return f"{_RAYS[kind]}, {where}"
    part = re.fullmatch(r"attraction (\d+)", name)
    if part:
        return f"robots heard {part[1]} degrees counter-clockwise from ahead"
    return next((words for pattern, words in _SENSORS.items() if re.fullmatch(pattern, name)), "")


def describe_actuator(name: str, robot: Robot) -> str:
    """Describe the values 1 and -1 of an actuator; empty if unknown."""
    speed = f"{shortest_decimal(robot.max_speed)} m/s" if robot.max_speed else "the largest speed"
    if name in {"left wheel", "right wheel"}:
        return f"1 is {speed} forwards, -1 backwards"
    if name == "ahead":
        return f"1 is {speed} ahead, -1 back"
    return {
        "left": f"1 is {speed} to the left, -1 to the right",
        "turn": "above 0 counter-clockwise",
    }.get(name, "")
