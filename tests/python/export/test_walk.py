"""Pseudo-random steps of self-tests: what they visit, and that they notice a wrong number."""

import re
import subprocess
from pathlib import Path

import numpy as np
import pytest

from swarmwright.export.c import C
from swarmwright.export.exporting import write
from swarmwright.export.golden import compute_checksum, generate_walk
from tests.python.export.specifications import ALL, subject


@pytest.mark.parametrize("name", ["mealy_fsm", "layered-tanh-0", "fully_meshed-relu-9", "modules"])
def test_the_same_steps_for_the_same_controller(name: str) -> None:
    walk, again = generate_walk(subject(ALL[name])), generate_walk(subject(ALL[name]))
    assert (walk.steps, walk.checksum, walk.words) == (again.steps, again.checksum, again.words)
    assert walk.steps >= (100 if name != "fully_meshed-relu-9" else 1)
    assert len(walk.sensor_probes) == ALL[name]["sensors"]


def test_all_rows_of_a_state_machine_are_visited() -> None:
    assert "18 of the 18 rows and 3 of the 3 states" in generate_walk(subject(ALL["mealy_fsm"])).words


def test_states_that_cannot_be_reached_are_said() -> None:
    assert "4 of the 5 rows and 4 of the 5 states" in generate_walk(subject(ALL["mealy_fsm-blind"])).words


def test_a_sign_that_changes_twice_changes_the_checksum() -> None:
    actuators = np.array([[1.0], [0.5], [1.0]], np.float32)
    other = np.array([[-1.0], [0.5], [-1.0]], np.float32)
    assert compute_checksum(actuators) != compute_checksum(other)


@pytest.mark.slow
@pytest.mark.parametrize(("table_name", "count"), [("outputs", 36), ("next", 18)])
def test_the_self_test_notices_each_wrong_number_of_a_state_machine(
    table_name: str, count: int, tmp_path: Path
) -> None:
    """Whatever episodes visit: each entry of the tables is read in a pseudo-random step."""
    write(C().files(subject(ALL["mealy_fsm"]), "robot"), tmp_path)
    test = tmp_path / "robot_test.c"
    # Without recorded steps, which visit some rows: by the pseudo-random ones alone.
    test.write_text(test.read_text().replace("step != SELF_TEST_STEPS;", "step != 0;"))
    source = (tmp_path / "robot.c").read_text()
    begin = source.index(f"robot_{table_name}[")
    table = slice(source.index("{", begin), source.index("};", begin))
    numbers = [one.span() for one in re.finditer(r"-?[0-9][0-9.e-]*f?", source[table])]
    assert len(numbers) == count
    for number, (first, last) in enumerate(numbers):
        other = "0.123f" if table_name == "outputs" else str((int(source[table][first:last]) + 1) % 3)
        changed = f"{source[table][:first]}{other}{source[table][last:]}"
        (tmp_path / "robot.c").write_text(source[: table.start] + changed + source[table.stop :])
        words = ["gcc", "-O0", "-w", "robot.c", "robot_test.c", "-o", "self_test"]
        subprocess.run(words, cwd=tmp_path, check=True, capture_output=True)
        done = subprocess.run(["./self_test"], cwd=tmp_path, capture_output=True, text=True, check=False)
        assert done.returncode == 1, number
        assert "pseudo-random steps" in done.stdout
