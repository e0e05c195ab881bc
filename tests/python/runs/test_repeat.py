"""An evaluation once more: what counts as the same."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmwright import Experiment, optimize, repeat

CLASSES = """
from swarmwright import Simulation


class Own(Simulation):
    title, sensors, actuators = "own", 1, 1

    def reset(self, parameters, seed):
        self.steps, self.seed = 0, seed
        return [[0.1]]

    def step(self, actions):
        self.steps += 1
        if actions[0][0] > 0.3 and self.seed:
            raise ValueError(f"motor of <World object at 0x{id(self):x}>")
        return [[0.1]]

    def done(self):
        return self.steps > 2

    def fitness(self):
        return -0.0


class Positive(Own):
    def fitness(self):
        return 0.0


class Missing(Own):
    def reset(self, parameters, seed):
        raise RuntimeError("a library is missing")
"""
WELL, FAILED = 2, 1
"""Candidates."""


@pytest.fixture
def run(tmp_path: Path) -> Any:
    (tmp_path / "own.py").write_text(CLASSES)
    found = optimize(
        Experiment.from_mapping(
            {
                "simulation": f"{tmp_path}/own.py:Own",
                "controller": {"kind": "layered", "hidden": []},
                "method": {"kind": "random_search", "population": 6, "generations": 1},
                "ranking": {"episodes": 2},
                "servers": "in-process",
            }
        ),
        out=tmp_path / "run",
    )
    failed = np.isnan(found.record.episodes)
    assert failed[FAILED].tolist() == [False, True]
    assert not failed[WELL].any()
    return found


def test_other_bits_of_equal_numbers_are_not_the_same(run: Any, tmp_path: Path) -> None:
    assert repeat(run, WELL, 0).same
    found = repeat(run, WELL, 0, simulation=f"{tmp_path}/own.py:Positive")
    assert found.recorded.tolist() == found.repeated.tolist() == [0.0, 0.0]
    assert not found.same


@pytest.mark.slow
@pytest.mark.parametrize("servers", ["in-process", 1])
def test_what_failed_is_the_same_if_it_fails_for_the_same_reason(
    run: Any, tmp_path: Path, servers: Any
) -> None:
    again = repeat(run, FAILED, 0, servers=servers)
    assert (again.same, again.failed_again) == (True, 1)
    assert again.recorded_errors[0].startswith("Own.step: ValueError: motor of <World object at 0x")
    assert again.errors[0].startswith("Own.step: ValueError: motor of <World object at 0x")
    other = repeat(run, FAILED, 0, servers=servers, simulation=f"{tmp_path}/own.py:Missing")
    assert not other.same
    assert "a library is missing" in other.errors[0]


@pytest.mark.slow
def test_another_reason_is_told(run: Any, program: Any, tmp_path: Path) -> None:
    same = program("evaluate", run.path, "--candidate", f"0:{FAILED}")
    assert same.returncode == 0, same.stderr
    assert "  episode 1: recorded failed, now failed\n" in same.stdout
    assert "The fitness is the same, to the bit; the same episodes failed for the same reason." in same.stdout
    other = program(
        "evaluate", run.path, "--candidate", f"0:{FAILED}", "--simulation", f"{tmp_path}/own.py:Missing"
    )
    assert other.returncode == 1
    assert "is NOT the same" in other.stdout
    assert "Failed as recorded: Own.step: ValueError" in other.stdout or "recorded -0.0" in other.stdout
