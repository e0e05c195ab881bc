"""The survey of simulators: what it measures is there, and repeats where the page says so."""

import importlib.util
import re
from pathlib import Path

import numpy as np
import pytest

from benchmarks import simulators
from benchmarks.simulators import SUBJECTS, Subject
from tests.enki import ENKI

MODULES = {"MuJoCo": "mujoco", "PyBullet": "pybullet", "SUMO": "libsumo", "IR-SIM": "irsim"}
PAGE = Path(__file__).parents[2] / "docs" / "explanation" / "simulators.md"


def is_installed(subject: Subject) -> bool:
    module = MODULES.get(subject.name)
    return ENKI.is_file() if module is None else importlib.util.find_spec(module) is not None


@pytest.mark.parametrize("subject", SUBJECTS, ids=lambda subject: subject.name)
@pytest.mark.timeout(180)
def test_robots_step_and_repeat_as_the_page_says(
    subject: Subject, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not is_installed(subject):
        pytest.skip(f"{subject.name} is not installed; make test-simulators")
    monkeypatch.setattr(simulators, "SECONDS", 0.02)
    simulation, parameters = subject.make(10, tmp_path)
    assert np.asarray(simulation.reset(parameters, 1)).shape == (10, simulation.sensors)
    assert simulators.rate(simulation, parameters, 10) > 10
    row = next(line for line in PAGE.read_text("utf-8").splitlines() if f"[{subject.name}]" in line)
    same = re.split(r" *\| *", row)[5]
    if same.startswith("yes"):
        assert simulators.repeats(subject)


def test_the_arena_is_measured() -> None:
    assert simulators.arena(10) > 100_000
