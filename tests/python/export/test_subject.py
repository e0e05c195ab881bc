"""What is exported of a run: whether modules check their random number."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from swarmwright.controllers.kinds import KINDS
from swarmwright.export import EXPORTERS, Subject
from swarmwright.export.c import C
from swarmwright.export.exporting import write
from swarmwright.export.golden import generate_walk
from swarmwright.export.python import Python
from swarmwright.export.sequences import Sequences, draw_random_sequences, measure_difference
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
