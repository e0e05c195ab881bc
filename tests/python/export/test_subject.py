"""What is exported of a run: whether modules check their random number."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from swarmwright.controllers.kinds import KINDS
from swarmwright.export import EXPORTERS, Subject
from swarmwright.export.c import C
from swarmwright.export.exporting import write
from swarmwright.export.golden import generate_walk
from swarmwright.export.python import Python
from swarmwright.export.sequences import Sequences, draw_random_sequences, measure_difference
from swarmwright.export.subject import PRESETS, Robot, describe_actuator, describe_sensor, robot_in
from swarmwright.simulations import catalogue
from tests.python.export.specifications import ALL, subject

NAMES = ["modules", "modules-tree"]

RANDOM_SENSOR = KINDS["modules"].random_sensor or 0


def recorded(name: str, low: float) -> Subject:
    """With episodes in which all sensors are from `low` to 1."""
    sensors = np.random.default_rng(1).uniform(low, 1, (60, 9)).astype(np.float32)
    accepted = np.ones(60, np.bool_)
    episodes = Sequences.compute(ALL[name], np.arange(60) % 20 == 0, sensors, accepted)
    return replace(subject(ALL[name]), episodes=episodes, episode_count=3)


@pytest.mark.parametrize("name", NAMES)
def test_a_random_number_is_checked_unless_a_recorded_one_is_outside(name: str) -> None:
    assert subject(ALL[name]).checks_random
    assert recorded(name, 0).checks_random
    assert not recorded(name, -1).checks_random
    assert not subject(ALL["mealy_fsm"]).checks_random
    for made, checks in ((recorded(name, 0), True), (recorded(name, -1), False)):
        files = {**C().files(made, "robot"), **Python().files(made, "robot")}
        assert ("sensors[8] >= 0.0f" in str(files["robot.c"])) == checks
        assert ("So it does when the sensor random" in str(files["robot.h"])) == checks
        assert ("expected 0 to 1" in str(files["robot.py"])) == checks


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("form", ["c", "cpp", "python", "machine"])
def test_another_sensor_in_the_place_of_the_random_one(form: str, name: str, tmp_path: Path) -> None:
    """The engine takes modules in any simulation with nine sensors: what ran there can be exported."""
    made, exporter = recorded(name, -1), EXPORTERS.get(form)()
    assert made.episodes is not None
    write(exporter.files(made, "robot"), tmp_path)
    drawn = draw_random_sequences(made.specification, 100, checks_random=made.checks_random)
    assert (np.abs(drawn.sensors[drawn.accepted, RANDOM_SENSOR]) > 1).any()
    for sequences in (made.episodes, drawn):
        assert measure_difference(sequences, exporter.run(tmp_path, "robot", sequences)) == (0.0, 0)
    exporter.self_test(tmp_path, "robot")


def test_the_pseudo_random_steps_try_it_as_the_other_sensors() -> None:
    other, random = generate_walk(recorded("modules", -1)), generate_walk(recorded("modules", 0))
    assert other.sensor_probes[RANDOM_SENSOR] == other.sensor_probes[0]
    first, count = random.sensor_probes[RANDOM_SENSOR]
    assert (random.probes[first : first + count] >= 0).all()


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
