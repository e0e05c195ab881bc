"""Runs of a sweep that are there already: which go on, and which are left alone."""

import sys
from pathlib import Path
from typing import Any

import pytest

import swarmwright
from swarmwright import Run, sweep
from swarmwright.analysis.sweep import Listener, Sweep, Task, conduct, list_tasks
from swarmwright.runs.store.lock import Lock

BASE: dict[str, Any] = {
    "simulation": "minisim", "servers": "local", "parameters": {"maxSteps": 5},
    "method": {"kind": "nnga", "population": 6, "generations": 3},
}  # fmt: skip
WORLD = """\
import swarmwright


class Line(swarmwright.Simulation):
    sensors = actuators = 1

    def reset(self, parameters, seed):
        return [[1.0]]

    def step(self, actuators):
        return [[1.0]]

    def done(self):
        return True

    def fitness(self):
        return 1.0
"""


@pytest.fixture
def world(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """The name of a class in a package of the working folder."""
    package = f"package_of_{tmp_path.name}"
    (tmp_path / package).mkdir()
    (tmp_path / package / "__init__.py").write_text("")
    (tmp_path / package / "world.py").write_text(WORLD)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    return f"{package}.world:Line"


@pytest.mark.slow
@pytest.mark.parametrize("form", ["module", "class"])
def test_a_simulation_that_is_named_by_its_module_goes_on(tmp_path: Path, world: str, form: str) -> None:
    module, _, name = world.partition(":")
    if form == "class":
        __import__(module)
    simulation = world if form == "module" else getattr(sys.modules[module], name)
    source = {"experiment": {**BASE, "parameters": {}, "simulation": simulation}, "seeds": 1}
    first = sweep(source, out=tmp_path / "out", jobs=1)
    assert (len(first.runs), first.failures) == (1, ())
    again = sweep({**source, "seeds": 2}, out=tmp_path / "out", jobs=1)
    assert [run.experiment.seed for run in again.runs] == [1, 2]
    assert [len(run.sessions) for run in again.runs] == [1, 1]


def test_a_folder_belongs_to_the_variant_whose_runs_are_there(tmp_path: Path) -> None:
    formulas = [f"arrived - 0.1 * distance - {weight} * steps" for weight in (0.1, 0.2, 0.3)]
    source = {"experiment": BASE, "grid": {"fitness": formulas}, "seeds": 1}
    out = tmp_path / "out"
    new = list_tasks(Sweep.from_mapping(source, out=out))
    for task in new:
        swarmwright.optimize(task.experiment, out=task.folder)
    again = list_tasks(Sweep.from_mapping({**source, "seeds": [2, 1]}, out=out))
    assert [task.folder for task in again[3:]] == [task.folder for task in new]
    assert all(task.open_run() for task in again[3:])
    # A variant that comes to be the first leaves the name to the one whose runs are there.
    before = [{"fitness": [f"{formulas[0]} + 1"]}, source["grid"]]
    todo = list_tasks(Sweep.from_mapping({**source, "grid": before}, out=out))
    assert [task.folder for task in todo[1:]] == [task.folder for task in new]
    assert todo[0].open_run() is None


def test_a_folder_without_a_run_does_not_stop_the_others(tmp_path: Path) -> None:
    other = tmp_path / "out" / "minisim_nnga-1"
    other.mkdir(parents=True)
    (other / "experiment.yaml").write_text("simulation: minisim\n")
    result = sweep({"experiment": BASE, "seeds": 2}, out=tmp_path / "out", jobs=1)
    assert [run.path.name for run in result.runs] == ["minisim_nnga-2"]
    (failure,) = result.failures
    assert failure.message == (
        f"{other}: is not a run folder: run.sqlite is missing; delete the folder {other} to "
        "repeat only this run in the same sweep"
    )


@pytest.mark.slow
@pytest.mark.parametrize("jobs", [1, 2])
def test_a_run_of_another_process_is_left_to_it(tmp_path: Path, jobs: int) -> None:
    source = {"experiment": BASE, "seeds": 3}
    first = sweep({**source, "seeds": 1}, out=tmp_path / "out", jobs=1).runs[0]
    first.path.rename(tmp_path / "first")
    first.path.mkdir()
    lock = Lock(first.path)
    try:
        result = sweep(source, out=tmp_path / "out", jobs=jobs)
    finally:
        lock.close()
    assert [run.experiment.seed for run in result.runs] == [2, 3]
    assert (result.failures, result.busy) == ((), (first.path,))
    assert "1 left to other processes" in repr(result)


def test_a_run_that_another_process_finishes_meanwhile_counts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    source = {"experiment": BASE, "seeds": 2}
    out = tmp_path / "out"
    first = list_tasks(Sweep.from_mapping(source, out=out))[0]
    first.folder.mkdir(parents=True)
    lock = Lock(first.folder)
    optimize = swarmwright.optimize

    def finishing(*arguments: Any, **options: Any) -> Run:
        lock.close()
        optimize(first.experiment, out=first.folder, servers="local")
        return optimize(*arguments, **options)

    monkeypatch.setattr("swarmwright.analysis.sweep.run.optimize", finishing)
    result = sweep(source, out=out, jobs=1)
    assert [run.experiment.seed for run in result.runs] == [1, 2]
    assert (result.failures, result.busy) == ((), ())


@pytest.mark.slow
@pytest.mark.parametrize("jobs", [1, 2])
def test_a_run_that_another_process_did_before_its_turn_is_said_to_be_its(tmp_path: Path, jobs: int) -> None:
    said: list[tuple[str, int]] = []

    class Told(Listener):
        def on_plan(self, runs: int, jobs: int) -> None:  # noqa: ARG002 - of the base class
            optimize(todo[1].experiment, out=todo[1].folder, servers="local")

        def on_begin(self, task: Task) -> None:
            said.append(("begun", task.seed))

        def on_end(self, task: Task, run: Run) -> None:  # noqa: ARG002 - of the base class
            said.append(("ended", task.seed))

        def on_finished_elsewhere(self, task: Task, run: Run) -> None:
            assert run.path == task.folder
            said.append(("elsewhere", task.seed))

    optimize = swarmwright.optimize
    loaded = Sweep.from_mapping({"experiment": BASE, "seeds": 3}, out=tmp_path / "out")
    todo = list_tasks(loaded)
    outcome = conduct(loaded, todo, Told(), jobs=jobs)
    assert [run.experiment.seed for run in outcome.finished] == [1, 2, 3]
    assert sorted(said) == [("begun", 1), ("begun", 3), ("elsewhere", 2), ("ended", 1), ("ended", 3)]


def test_a_figure_that_a_full_disk_left_empty_is_drawn_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    source = {"experiment": BASE, "seeds": 2}
    first, second = sweep(source, out=tmp_path / "out", jobs=1).runs
    (first.path / "fitness.png").touch()
    (second.path / "fitness.png").write_bytes(b"a figure")
    drawn: list[Path] = []
    monkeypatch.setattr("swarmwright.runs.picture.draw_later", drawn.append)
    sweep(source, out=tmp_path / "out", jobs=1)
    assert drawn == [first.path]
