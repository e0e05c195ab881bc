"""What sensors and actuators of the arena's robots stand for."""

import re
from pathlib import Path

import pytest
import yaml

from swarmwright.export.subject import PRESETS, Robot, describe_actuator, describe_sensor, robot_in
from swarmwright.simulations import catalogue

ROBOTS = Path(__file__).parents[3] / "engine" / "worlds" / "arena" / "src" / "robots"
PRESETS_RS = ROBOTS / "model" / "presets.rs"


@pytest.mark.parametrize("file", sorted(ROBOTS.glob("*.yaml")), ids=lambda file: file.stem)
def test_presets_are_those_of_the_engine(file: Path) -> None:
    values = yaml.safe_load(file.read_text())
    known = PRESETS[file.stem]
    assert known.max_speed == values["drive"]["max_speed"]
    assert known.wheel_base == values["drive"].get("wheel_base", 0)
    for one in values["sensors"]:
        if one["kind"] in {"proximity", "light"}:
            assert len((known.angles or {})[one["kind"]]) == one["count"]


def test_the_e_puck_is_that_of_the_engine() -> None:
    text = PRESETS_RS.read_text()
    assert "Drive::Differential { wheel_base: 0.053 }" in text
    assert re.search(r"wheel_base: 0\.053 \},\s+0\.12,", text)
    angles = re.search(r"E_PUCK_ANGLES: \[f32; 8\] = \[(.*)\];", text)
    assert angles is not None
    known = PRESETS["e-puck-rm1.1"].angles
    assert known is not None
    assert list(known["light"]) == [float(one) for one in angles[1].split(",")]


def test_robots_of_parameters() -> None:
    assert robot_in({"mission": "aac"}) == PRESETS["e-puck-rm1.1"]
    assert robot_in({"mission": "aac", "robot": "foot-bot"}).wheel_base == 0.14
    drive = {"kind": "differential", "wheel_base": 0.08, "max_speed": 0.2}
    own = robot_in({"mission": "aac", "robot": {"drive": drive, "sensors": [{"kind": "light", "count": 4}]}})
    assert own == Robot(0.2, 0.08, {"light": [0.0, 90.0, 180.0, 270.0]})
    part = robot_in({"mission": "aac", "robot": {"preset": "foot-bot", "drive": {"max_speed": 0.1}}})
    assert (part.max_speed, part.wheel_base) == (0.1, 0.14)
    car = {"kind": "car", "wheel_base": 0.3, "max_speed": 2, "max_steering": 30}
    assert robot_in({"mission": "aac", "robot": {"drive": car, "sensors": []}}).wheel_base == 0
    assert robot_in({"robots": [{"robot": "foot-bot", "count": 2}]}) == Robot()


@pytest.mark.parametrize(
    ("name", "meaning"),
    [
        ("proximity 0", "0 nothing in range, 1 at the rim, 17 degrees counter-clockwise from ahead"),
        ("ground left", "0 black, 1 white"),
        ("messages heard", "the number of messages heard"),
        ("neighbours", "the number of robots in range"),
        ("attraction 135", "robots heard 135 degrees counter-clockwise from ahead"),
        ("random", ""),
        ("something else", ""),
    ],
)
def test_sensors(name: str, meaning: str) -> None:
    assert describe_sensor(name, PRESETS["e-puck-rm1.1"]) == meaning


@pytest.mark.parametrize("preset", PRESETS)
def test_all_sensors_of_the_engine_have_a_meaning(preset: str) -> None:
    names = catalogue.channels("arena", {"mission": "aac", "robot": preset})["sensor_names"]
    without = {name for name in names if not describe_sensor(name, PRESETS[preset])}
    assert without <= {"random"}


def test_actuators() -> None:
    assert describe_actuator("left wheel", PRESETS["foot-bot"]) == "1 is 0.3 m/s forwards, -1 backwards"
    assert describe_actuator("right wheel", Robot()) == "1 is the largest speed forwards, -1 backwards"
    assert describe_actuator("message 0", Robot()) == ""
