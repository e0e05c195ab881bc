"""Runs whose method is not installed here are read and evaluated; they are not resumed."""

import sys
from collections.abc import Callable
from importlib.metadata import EntryPoint
from pathlib import Path

import pytest

from swarmwright import (
    Experiment,
    InputError,
    Run,
    compare,
    evaluate,
    optimize,
    post_evaluate,
    repeat,
    resume,
)
from swarmwright.cli._main import run as swarmwright
from swarmwright.methods import METHODS
from swarmwright.methods.rankings import RANKINGS
from swarmwright.runs.store.verification import verify

CODE = '''
from typing import Literal

import numpy as np

from swarmwright.methods import Method, MethodOptions


class DrawOptions(MethodOptions):
    """Draws."""

    kind: Literal["draw"] = "draw"
    spread: float = 0.5
    """An option of its own."""


class Draw(Method):
    kind = "draw"
    options_model = DrawOptions
    keeps_members = True
    _scores = np.empty(0)

    @property
    def budget(self):
        return 4 * self.options.generations

    @property
    def population_fitness(self):
        return self._scores

    def _ask(self):
        return self.initials(range(4))

    def _tell(self, genomes, fitness):
        self._scores = fitness

    def _rescore(self, fitness):
        pass
'''
RANKING = '''
from typing import Literal

import numpy as np

from swarmwright.methods.rankings import Ranking, RankingOptions


class FirstOptions(RankingOptions):
    """The first episode."""

    kind: Literal["first"] = "first"


class First(Ranking):
    kind = "first"
    options_model = FirstOptions

    def _score(self, episodes):
        return np.array([row[0] for row in episodes])
'''
EXPERIMENT = {
    "simulation": "minisim",
    "parameters": {"maxSteps": 20},
    "method": {"kind": "draw", "generations": 2, "spread": 0.25},
    "ranking": {"seeds": "new", "reevaluate": True},
    "validate": {"episodes": 3, "candidates": 1},
    "servers": "local",
}


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Run:
    """A run of a package that has been removed since, as it was opened again."""
    (tmp_path / "drawing.py").write_text(CODE)
    monkeypatch.setattr("sys.dont_write_bytecode", True)
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(tmp_path))
        patch.setitem(
            vars(METHODS), "_entry_points", {"draw": [EntryPoint("draw", "drawing:Draw", METHODS.group)]}
        )
        patch.setattr(METHODS, "_loaded", {})
        optimize(Experiment.from_mapping(EXPERIMENT), out=tmp_path / "run")
    del sys.modules["drawing"]
    (tmp_path / "drawing.py").unlink()
    return Run.open(tmp_path / "run")


def test_what_is_recorded_is_read(run: Run, tmp_path: Path) -> None:
    assert run.experiment.to_mapping()["method"]["spread"] == 0.25
    assert run.experiment.method.generations == 2
    assert run.state == "done"
    assert run.validation is not None
    assert verify(run.path).problems == []
    run.plot(tmp_path / "run.png")
    run.export(tmp_path / "run.csv")
    assert "draw" in str(compare([run, optimize(nnga(run), out=tmp_path / "other")]))


def nnga(run: Run) -> Experiment:
    """The experiment with a method that is there."""
    return run.experiment.replace(
        method={"kind": "nnga", "population": 4, "generations": 2}, ranking={"reevaluate": False}
    )


def test_it_is_evaluated_and_shown(run: Run) -> None:
    assert repeat(run).same
    assert post_evaluate(run, episodes=3).episodes.shape == (3,)
    other = run.experiment.replace(parameters={"maxSteps": 5}, ranking={"reevaluate": False})
    assert evaluate(other, run.record.genomes[:2]).shape == (2,)
    run.replay().save(run.path.parent / "replay.html")


@pytest.mark.parametrize("command", ["runs show", "runs compare", "evaluate --episodes 3", "plot", "draw"])
def test_commands(command: str, run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(run.path.parent)
    words = command.split()
    options = [] if command.startswith(("runs", "evaluate")) else ["--out", "figure.png"]
    assert swarmwright([*words, *options, "run"]) == 0


@pytest.mark.parametrize(
    "go_on", [resume, lambda run: resume(run, generations=4), lambda run: optimize(run.experiment)]
)
def test_it_is_not_resumed(go_on: Callable[[Run], Run], run: Run) -> None:
    before = run.digest
    with pytest.raises(InputError, match=r"method\.kind: .*\bdraw\b"):
        go_on(run)
    assert Run.open(run.path).digest == before


def test_what_to_install_is_said(run: Run) -> None:
    with pytest.raises(InputError) as caught:
        resume(run)
    assert "no installed package provides the method 'draw'" in str(caught.value)
    copied = run.path / "code/1/method/drawing.py"
    assert f"its module drawing, copied to {copied}" in str(caught.value)


def test_a_new_experiment_cannot_use_it(run: Run) -> None:
    with pytest.raises(InputError, match=r"method\.kind: unknown method 'draw'"):
        Experiment.from_mapping(EXPERIMENT)
    with pytest.raises(InputError, match=r"method\.kind: unknown method 'draw'"):
        Experiment.load(run.path / "experiment.yaml")


@pytest.mark.parametrize(
    "change",
    [
        lambda one: one.replace(method={"kind": "nnag"}),
        lambda one: one.with_settings(["method.kind=nnag"]),
    ],
)
def test_another_method_is_not_taken_for_one_that_is_not_installed(
    change: Callable[[Experiment], Experiment], run: Run
) -> None:
    with pytest.raises(InputError, match=r"method\.kind.*: unknown method 'nnag'; did you mean 'nnga'"):
        change(run.experiment)
    assert run.experiment.replace(method={"kind": "draw", "generations": 5}).generations == 5


def test_a_package_that_cannot_be_imported_any_more(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    point = EntryPoint("draw", "drawing:Draw", METHODS.group)  # announced, but its file is gone
    monkeypatch.setitem(vars(METHODS), "_entry_points", {"draw": [point]})
    opened = Run.open(run.path)
    assert opened.experiment == run.experiment
    with pytest.raises(
        InputError, match=r"method 'draw' \(drawing:Draw, .*\) cannot be imported: ModuleNotFound"
    ):
        resume(opened)


def test_the_copy_of_a_ranking_that_is_missing_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "ranked.py").write_text(RANKING)
    monkeypatch.setattr("sys.dont_write_bytecode", True)
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(tmp_path))
        point = EntryPoint("first", "ranked:First", RANKINGS.group)
        patch.setitem(vars(RANKINGS), "_entry_points", {"first": [point]})
        patch.setattr(RANKINGS, "_loaded", {})
        values = {"simulation": "minisim", "ranking": {"kind": "first"}, "servers": "local"}
        experiment = Experiment.from_mapping({**values, "method": {"population": 4, "generations": 1}})
        optimize(experiment, out=tmp_path / "run")
    del sys.modules["ranked"]
    with pytest.raises(
        InputError, match=r"ranking\.kind: unknown ranking 'first'.*/1/ranking/ranked\.py is a copy"
    ):
        Run.open(tmp_path / "run")
