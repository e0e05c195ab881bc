"""Sweeps by the record beside their runs: repeated in another folder, and completed in their own."""

import json
import shutil
from pathlib import Path
from typing import Any

import pytest

import swarmwright
from swarmwright import InputError, Run
from swarmwright.analysis.sweep import Sweep, tasks

BASE = {
    "simulation": "minisim",
    "parameters": {"maxSteps": 3, "placement": "random"},
    "method": {"kind": "nnga", "population": 4, "generations": 2},
    "servers": "local",
}
GRID = [{"method.population": [4, 6]}, {"method.kind": ["cma_es"], "method.evaluations": [9]}]
SIMULATION = """\
from swarmwright import Simulation


class Line(Simulation):
    title = "line"
    sensors = 1
    actuators = 1

    def reset(self, parameters, seed):
        self.at, self.left = float(seed % 5), 3
        return [[self.at]]

    def step(self, actions):
        self.at += float(actions[0, 0])
        self.left -= 1
        return [[self.at]]

    def done(self):
        return self.left == 0

    def fitness(self):
        return -abs(self.at)
"""


def digests(folder: Path) -> dict[str, str]:
    return {run.parent.name: Run.open(run.parent).digest for run in sorted(folder.glob("*/run.sqlite"))}


@pytest.fixture(scope="module")
def original(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of a sweep."""
    folder = tmp_path_factory.mktemp("original") / "results"
    swarmwright.sweep({"experiment": BASE, "grid": GRID, "seeds": [3, 8]}, out=folder, jobs=1)
    return folder


@pytest.fixture
def results(original: Path, tmp_path: Path) -> Path:
    """Return a copy of it in another folder."""
    return shutil.copytree(original, tmp_path / "results")


def test_a_sweep_is_repeated_by_its_record(results: Path, tmp_path: Path) -> None:
    again = swarmwright.sweep(results / "sweep.json", out=tmp_path / "again", jobs=1)
    assert len(again.runs) == 6
    assert digests(again.path) == digests(results)
    assert (again.path / "sweep.json").read_bytes() == (results / "sweep.json").read_bytes()


def test_without_its_runs_the_record_is_enough(results: Path, tmp_path: Path) -> None:
    before = digests(results)
    for run in before:
        shutil.rmtree(results / run)
    assert digests(swarmwright.sweep(results / "sweep.json", out=tmp_path / "again", jobs=1).path) == before


def test_runs_that_are_missing_are_run_beside_the_record(results: Path) -> None:
    before, record = digests(results), (results / "sweep.json").read_bytes()
    shutil.rmtree(results / "population_6-8")
    (results / "population_4-3" / "run.sqlite").write_bytes(b"damaged")
    found = swarmwright.sweep(results / "sweep.json", jobs=1)
    assert (found.path, [one.seed for one in found.failures]) == (results, [3])
    shutil.rmtree(results / "population_4-3")
    assert not swarmwright.sweep(results / "sweep.json", jobs=1).failures
    assert digests(results) == before
    assert (results / "sweep.json").read_bytes() == record


def test_code_of_the_runs_is_used_once_it_is_trusted(
    program: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "line.py").write_text(SIMULATION)
    base = {**BASE, "simulation": "line.py:Line", "parameters": {}}
    (tmp_path / "base.json").write_text(json.dumps(base))
    sweep = {"experiment": "base.json", "grid": {"method.population": [4, 6]}, "seeds": 1, "out": "results"}
    (tmp_path / "sweep.yaml").write_text(json.dumps(sweep))
    made = program("sweep", "sweep.yaml", "--jobs", "1")
    assert made.returncode == 0, made.stderr
    (tmp_path / "results").rename(tmp_path / "moved")
    (tmp_path / "line.py").unlink()
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "another"))
    refused = program("sweep", "moved/sweep.json", "--out", "again")
    assert refused.returncode == 2
    assert "is not of a run that was made here by this user" in refused.stderr
    repeated = program("sweep", "moved/sweep.json", "--out", "again", "--trust", "--jobs", "1")
    assert repeated.returncode == 0, repeated.stderr
    first, second = (one.experiment.simulation for one in Sweep.load(tmp_path / "again/sweep.json").variants)
    assert first == second  # equal copies are one simulation, with the same servers
    same = program("runs", "diff", "moved", "again")
    assert (same.returncode, same.stdout) == (
        0,
        "The records of 2 of 2 runs are the same, byte for byte.\n",
    )
    shutil.rmtree(tmp_path / "again" / "population_4-1")
    differing = program("runs", "diff", "moved", "again", "--json")
    assert differing.returncode == 1
    assert [json.loads(line) for line in differing.stdout.splitlines()] == [
        {"run": "population_4-1", "same": False, "difference": "again/population_4-1: missing"},
        {"run": "population_6-1", "same": True, "difference": None},
    ]


def test_settings_apply_to_all_variants(results: Path, tmp_path: Path) -> None:
    file = results / "sweep.json"
    sweep = Sweep.load(file, out=tmp_path / "again", settings=["parameters.maxSteps=4"])
    assert {one.experiment.parameters["maxSteps"] for one in sweep.variants} == {4}
    assert sweep.settings == ("parameters.maxSteps=4",)
    with pytest.raises(
        InputError, match=r"the variants of this sweep differ in method\.population; leave it"
    ):
        Sweep.load(file, settings=["method.population=5"])
    with pytest.raises(
        InputError, match=r"--set seed=5: each run has a seed of the sweep; see the key 'seeds'"
    ):
        Sweep.load(file, settings=["seed=5"])
    with pytest.raises(InputError, match=r"run of another experiment: parameters\.maxSteps is 4 in"):
        tasks(Sweep.load(file, settings=["parameters.maxSteps=4"]))[0].found()


def test_another_run_in_the_place_of_one_is_refused(results: Path) -> None:
    shutil.rmtree(results / "population_4-3")
    (results / "population_6-3").rename(results / "population_4-3")
    with pytest.raises(
        InputError, match=r"population 4: .*population_4-3: holds a run of another experiment"
    ):
        Sweep.load(results / "sweep.json")


@pytest.mark.parametrize(
    "change",
    [
        {"variants": []},
        {"variants": [{"label": "a", "experiment": {}, "runs": []}]},
        {"variants": [{"label": "a", "experiment": {}, "runs": ["a-3", "b-8"]}]},
        {"variants": [{"label": "a", "experiment": {}, "runs": ["a-3", "../a-8"]}]},
        {"variants": [{"label": "a", "experiment": 3, "runs": ["a-3", "a-8"]}]},
        {"variants": 3},
        {"seeds": None},
        {"seeds": ["x"]},
        {"experiment": []},
    ],
)
def test_what_is_no_record_is_refused(results: Path, change: dict[str, Any]) -> None:
    file = results / "sweep.json"
    file.write_text(json.dumps({**json.loads(file.read_text()), **change}))
    with pytest.raises(InputError, match=r"sweep\.json: is not the record of a sweep"):
        Sweep.load(file)
