"""A simulation's file uses the modules beside it, whatever else in the process has their names."""

import sys
from pathlib import Path

import pytest

import swarmwright as sw

SIMULATION = """
import swarmwright as sw
from helper_of_tests import VALUE


class One(sw.Simulation):
    title, dimensions, sensors, actuators = "one", 1, 1, 1

    def reset(self, parameters, seed):
        self.value = None
        return [[0.0]]

    def step(self, actions):
        from helper_of_tests import later

        self.value = later(VALUE)
        return [[0.0]]

    def done(self):
        return self.value is not None

    def fitness(self):
        return self.value
"""
HELPER = """
VALUE = {value}


def later(value):
    return value + {more}
"""


def write(folder: Path, value: float, more: float) -> str:
    folder.mkdir()
    (folder / "one.py").write_text(SIMULATION)
    (folder / "helper_of_tests.py").write_text(HELPER.format(value=value, more=more))
    return f"{folder / 'one.py'}:One"


@pytest.mark.slow
@pytest.mark.parametrize("servers", ["local", 1])
def test_files_with_helpers_of_one_name(
    servers: str | int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    there = tmp_path / "there"
    first, second = write(tmp_path / "first", 1.0, 0.25), write(tmp_path / "second", 2.0, 0.5)
    write(there, 3.0, 0.125)
    monkeypatch.chdir(there)
    monkeypatch.syspath_prepend(str(there))
    import helper_of_tests  # type: ignore[import-not-found]

    fitness = []
    for name in (first, second, first):
        experiment = sw.Experiment.from_mapping({"simulation": name, "servers": servers})
        fitness += sw.evaluate(experiment, [[0.0] * experiment.genome_size]).tolist()
    assert fitness == [1.25, 2.5, 1.25]
    assert helper_of_tests.VALUE == 3.0
    assert sys.modules["helper_of_tests"] is helper_of_tests
