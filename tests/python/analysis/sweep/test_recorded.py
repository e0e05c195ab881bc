"""Sweeps by the record beside their runs: repeated in another folder, and completed in their own."""

import json
import re
import shutil
from pathlib import Path
from typing import Any

import pytest

import swarmwright
from swarmwright import InputError, Run
from swarmwright.analysis.sweep import Sweep, list_tasks

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


BASE_OF_LINE = {**BASE, "simulation": "line.py:Line", "parameters": {}}


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


@pytest.mark.slow
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


@pytest.mark.slow
def test_code_of_the_runs_is_used_once_it_is_trusted(
    program: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "line.py").write_text(SIMULATION)
    (tmp_path / "base.json").write_text(json.dumps(BASE_OF_LINE))
    sweep = {"experiment": "base.json", "grid": {"method.population": [4, 6]}, "seeds": 1, "out": "results"}
    (tmp_path / "sweep.yaml").write_text(json.dumps(sweep))
    made = program("sweep", "sweep.yaml", "--jobs", "1")
    assert made.returncode == 0, made.stderr
    (tmp_path / "results").rename(tmp_path / "moved")
    (tmp_path / "line.py").unlink()
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "another"))
    refused = program("sweep", "moved/sweep.json", "--out", "again")
    assert refused.returncode == 2
    assert "does not belong to a run that you made on this machine" in refused.stderr
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
    with pytest.raises(InputError, match=r"the variants of this sweep differ in method\.population; omit"):
        Sweep.load(file, settings=["method.population=5"])
    with pytest.raises(
        InputError, match=r"--set seed=5: the sweep sets the seed of each run; use the key 'seeds'"
    ):
        Sweep.load(file, settings=["seed=5"])
    with pytest.raises(InputError, match=r"run of another experiment: parameters\.maxSteps is 4 in"):
        list_tasks(Sweep.load(file, settings=["parameters.maxSteps=4"]))[0].open_run()


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
        {"seeds": "38"},
        {"seeds": [3.5, 8]},
        {"seeds": [3, 3]},
        {"settings": "servers=local"},
        {"settings": [3]},
        {"experiment": []},
    ],
)
def test_what_is_no_record_is_refused(results: Path, change: dict[str, Any]) -> None:
    file = results / "sweep.json"
    file.write_text(json.dumps({**json.loads(file.read_text()), **change}))
    with pytest.raises(
        InputError, match=r"sweep\.json: is not a valid record of a sweep .* start the sweep with its"
    ):
        Sweep.load(file)


def test_a_sweep_file_with_an_unknown_key_is_no_record(tmp_path: Path) -> None:
    file = tmp_path / "sweep.yaml"
    for values in ({"variants": {"method.population": [6]}}, {"variants": [6], "out": "results"}):
        file.write_text(json.dumps({"experiment": "base.yaml", **values}))
        with pytest.raises(InputError, match=r"variants: unknown key"):
            Sweep.load(file)


def test_a_variant_that_is_there_twice_is_named(results: Path) -> None:
    file = results / "sweep.json"
    record = json.loads(file.read_text())
    twice = {**record["variants"][0], "label": "again", "runs": ["a-3", "a-8"]}
    file.write_text(json.dumps({**record, "variants": [*record["variants"], twice]}))
    with pytest.raises(InputError, match=r"sweep\.json: two variants are the same .*: population 4, again$"):
        Sweep.load(file)


@pytest.fixture
def line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the folder of a sweep whose simulation is a class in a file, beside it."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "line.py").write_text(SIMULATION)
    sweep = {"experiment": BASE_OF_LINE, "grid": {"method.population": [4, 6]}, "seeds": 2}
    return swarmwright.sweep(sweep, out=tmp_path / "results", jobs=1).path


@pytest.mark.slow
@pytest.mark.parametrize("edited", [True, False])
def test_variants_without_a_run_have_the_code_of_the_others(
    line: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, *, edited: bool
) -> None:
    before, record = digests(line), (line / "sweep.json").read_bytes()
    for seed in (1, 2):
        shutil.rmtree(line / f"population_6-{seed}")
    if edited:
        (tmp_path / "line.py").write_text(SIMULATION.replace("-abs", "-100 * abs"))
    else:
        (tmp_path / "line.py").unlink()
    for folder in ("population_6-1", "population_4-2"):  # what is left is used again
        completed = swarmwright.sweep(line / "sweep.json", jobs=1)
        assert not completed.failures
        assert digests(line) == before
        assert (line / "sweep.json").read_bytes() == record
        shutil.rmtree(line / folder)
        (tmp_path / "elsewhere").mkdir(exist_ok=True)
        monkeypatch.chdir(tmp_path / "elsewhere")


@pytest.mark.slow
def test_code_that_a_record_names_is_not_executed_unless_it_is_trusted(
    line: Path, tmp_path: Path, program: Any
) -> None:
    shutil.rmtree(line / "population_4-1")
    shutil.rmtree(line / "population_4-2")
    for folder in line.glob("population_6-*"):
        shutil.rmtree(folder)
    evil = f"open({str(tmp_path / 'executed')!r}, 'w')\n{SIMULATION}"
    (tmp_path / "line.py").write_text(evil)
    refused = program("sweep", "results/sweep.json")
    assert refused.returncode == 2
    assert re.search(r"line\.py \(SHA-256 \w{16}\.\.\) is code named by a run folder", refused.stderr)
    assert not (tmp_path / "executed").exists()
    allowed = program("sweep", "results/sweep.json", "--trust", "--jobs", "1")
    assert allowed.returncode == 0, allowed.stderr
    assert (tmp_path / "executed").exists()


@pytest.mark.slow
def test_runs_of_different_code_are_not_repeated_as_one_sweep(line: Path, tmp_path: Path) -> None:
    shutil.rmtree(line / "population_6-1")
    shutil.rmtree(line / "population_6-2")
    (tmp_path / "line.py").write_text(SIMULATION.replace("-abs", "-100 * abs"))
    base = {**BASE_OF_LINE, "simulation": f"{tmp_path}/line.py:Line"}
    sweep = {"experiment": base, "grid": {"method.population": [6]}, "seeds": 2}
    other = swarmwright.sweep(sweep, out=tmp_path / "other", jobs=1).path
    shutil.copytree(other / "population_6-1", line / "population_6-1")
    with pytest.raises(InputError, match=r"6-1: the code of line\.py:Line differs from that of .*_4-1"):
        Sweep.load(line / "sweep.json")


@pytest.mark.slow
@pytest.mark.parametrize("jobs", [1, 2])
def test_simulations_of_one_title_are_computed_by_their_own_code(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, jobs: int
) -> None:
    monkeypatch.chdir(tmp_path)
    for folder, code in (("a", SIMULATION), ("b", SIMULATION.replace("-abs", "-1000 - abs"))):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "line.py").write_text(code)
    grid = {"simulation": [f"{tmp_path}/{folder}/line.py:Line" for folder in "ab"]}
    base = {**BASE_OF_LINE, "simulation": f"{tmp_path}/a/line.py:Line"}
    made = swarmwright.sweep({"experiment": base, "grid": grid, "seeds": 2}, out="results", jobs=jobs)
    for again in (made, swarmwright.sweep("results/sweep.json", out="again", jobs=jobs)):
        fitness = [{bool((one.fitness < -500).any()) for one in run._store.rows()} for run in again.runs]
        assert fitness == [{False}, {True}] * 2


def test_simulations_of_one_title_cannot_share_a_broker(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for folder in "ab":
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "line.py").write_text(SIMULATION)
    grid = {"simulation": [f"{folder}/line.py:Line" for folder in "ab"]}
    base = {**BASE_OF_LINE, "simulation": "a/line.py:Line"}
    sweep = {"experiment": {**base, "servers": "auto"}, "grid": grid, "seeds": 1}
    with pytest.raises(InputError, match=r"have the same title 'line' on the broker"):
        swarmwright.sweep(sweep, out="results", broker="mqtt://127.0.0.1:1", jobs=1)
