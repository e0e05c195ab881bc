"""The tabs of fronts and archives show the elites of `Run.elites`."""

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from starlette.applications import Starlette

from swarmwright import Experiment, InputError, Run, optimize, resume
from swarmwright.analysis.indicators import measure
from swarmwright.runs.elites import EliteCollector, compute_elites
from swarmwright.ui.views._elites import EliteHistory, Reading, State
from tests.python.ui.client import call

BASE: dict[str, Any] = {
    "simulation": "minisim",
    "parameters": {"numAgents": 2, "placement": "random", "maxSteps": 10},
    "ranking": {"episodes": 2},
    "servers": "in-process",
    "fitness": "arrived - caught",
    "validate": False,
}
MEASURES = {"steps": {"range": [0, 10], "bins": 5}, "distance": {"range": [0, 30], "bins": 6}}
METHODS: dict[str, dict[str, Any]] = {
    "front": {"kind": "nsga2", "objectives": {"steps": "minimize", "distance": "minimize"}},
    "archive": {"kind": "map_elites", "measures": MEASURES},
}
RANGES = {name: {"range": measure["range"]} for name, measure in MEASURES.items()}
POINTS = {"front": "front_points", "archive": "archive_cells"}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("runs")
    for name, method in METHODS.items():
        values = {**BASE, "method": {**method, "population": 12, "generations": 5}}
        optimize(Experiment.from_mapping(values), out=folder / name)
    return folder


@pytest.mark.parametrize("tab", METHODS)
def test_elites_and_indicators_are_those_of_the_library(
    folder: Path, open_app: Callable[[Path], Starlette], tab: str
) -> None:
    run, app = Run(folder / tab), open_app(folder)
    assert [name for name in call(app, "/api/tabs", run=tab).values["tabs"] if name in METHODS] == [tab]
    states = call(app, f"/api/{tab}", run=tab).values
    assert states["generations"] == [0, 1, 2, 3, 4]
    assert set(states["goals"]) == {"steps", "distance"}
    for name, by in (("hypervolume", "hypervolume"), ("QD score", "qd_score"), ("coverage", "coverage")):
        if name in states["indicators"]:
            _, (value,) = measure(by, [run])  # type: ignore[arg-type]
            assert states["indicators"][name][-1] == pytest.approx(value)
    for generation, count in zip(states["generations"], states["counts"], strict=True):
        points = call(app, f"/api/{POINTS[tab]}", run=tab, generation=generation).values
        expected = compute_elites(run, run.history[generation].evaluations).candidates
        assert count == len(expected)
        assert [*zip(points["born"], points["candidate"], points["columns"]["fitness"], strict=True)] == [
            (elite.generation, elite.candidate, elite.fitness) for elite in expected
        ]
        if tab == "archive":
            assert all(0 <= cell < 5 for cell in points["bins"]["steps"])


@pytest.mark.parametrize("archive", [{"kind": "cvt", "cells": 9}, {"kind": "unstructured"}])
def test_archives_without_bins(
    tmp_path: Path, open_app: Callable[[Path], Starlette], archive: dict[str, Any]
) -> None:
    method = {"kind": "map_elites", "measures": RANGES, "archive": archive, "population": 12}
    run = optimize(
        Experiment.from_mapping({**BASE, "method": {**method, "generations": 2}}), out=tmp_path / "run"
    )
    app = open_app(tmp_path)
    states = call(app, "/api/archive", run="run").values
    assert {axis["bins"] for axis in states["axes"].values()} == {40}
    points = call(app, "/api/archive_cells", run="run", generation=1).values
    assert len(points["born"]) == len(run.elites.candidates) == states["counts"][-1]
    if archive["kind"] == "cvt":
        assert set(states["raster"]["cells"]) == set(range(9))
        assert len(states["raster"]["cells"]) == states["raster"]["size"] ** 2
        assert len(set(points["cells"])) == len(points["cells"])
        assert "coverage" in states["indicators"]
    else:
        assert states["raster"] is None
        assert list(states["indicators"]) == ["QD score"]


def test_a_run_of_novelty_has_the_tab_of_archives(
    tmp_path: Path, open_app: Callable[[Path], Starlette]
) -> None:
    method = {"kind": "novelty", "measures": MEASURES, "population": 12, "generations": 3}
    run = optimize(Experiment.from_mapping({**BASE, "method": method}), out=tmp_path / "new")
    app = open_app(tmp_path)
    assert "archive" in call(app, "/api/tabs", run="new").values["tabs"]
    assert call(app, "/api/archive", run="new").values["counts"][-1] == len(run.elites.candidates)
    points = call(app, "/api/archive_cells", run="new", generation=2).values
    assert len(points["bins"]["steps"]) == len(run.elites.candidates)


@pytest.mark.parametrize(
    ("request_name", "query", "message"),
    [
        ("front", {"run": "archive"}, "is a run of map_elites; this is for runs of nsga2"),
        ("archive_cells", {"run": "front", "generation": 1}, "this is for runs of map_elites"),
        ("front_points", {"run": "front", "generation": "last"}, "generation: must be a whole number"),
        ("archive", {"run": "nothing"}, "there is no such run"),
    ],
)
def test_wrong_requests_are_told_why(
    folder: Path,
    open_app: Callable[[Path], Starlette],
    request_name: str,
    query: dict[str, Any],
    message: str,
) -> None:
    answer = call(open_app(folder), f"/api/{request_name}", **query)
    assert answer.status == 422
    assert message in answer.values["error"]


def values_of(states: list[State] | None) -> list[Any]:
    assert states is not None
    return [(state.generation, state.elites.candidates, state.indicators) for state in states]


@pytest.mark.parametrize("tab", METHODS)
def test_a_run_that_goes_on_is_read_on(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, tab: str
) -> None:
    monkeypatch.setattr("swarmwright.ui.views._elites.MOST_GENERATIONS", 5)
    shutil.copytree(folder / tab, tmp_path / tab)
    reading = Reading()
    assert [state.generation for state in reading.read(Run(tmp_path / tab)) or []] == [0, 2, 4]
    added: list[int] = []
    add = EliteCollector.add

    def note(self: EliteCollector, first: int, *arguments: Any) -> None:
        added.append(first)
        add(self, first, *arguments)

    monkeypatch.setattr(EliteCollector, "add", note)
    run = resume(tmp_path / tab, generations=8)
    states = reading.read(run)
    assert added == [60, 60 + 12 * 2]
    assert reading.read(run) is states
    assert [state.generation for state in states or []] == [0, 2, 4, 6, 7]
    monkeypatch.undo()
    monkeypatch.setattr("swarmwright.ui.views._elites.MOST_GENERATIONS", 5)
    assert values_of(states)[-1] == values_of(Reading().read(run))[-1]


def test_what_failed_is_tried_again(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run, reading = Run(folder / "front"), Reading()
    with monkeypatch.context() as patches:
        patches.setattr(EliteCollector, "follow", lambda *_: 1 / 0)
        with pytest.raises(InputError, match="its elites cannot be read: division by zero"):
            reading.read(run)
    assert len(reading.read(run) or []) == 5


def test_few_runs_are_kept_and_read_at_once(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("swarmwright.ui.views._elites.MOST_RUNS", 1)
    history = EliteHistory()
    first = history.reading(Run(folder / "front"))
    assert history.reading(Run(folder / "front")) is first
    history.reading(Run(folder / "archive"))
    assert not first.is_current
    with pytest.raises(InputError, match="other runs were opened meanwhile"):
        first.read(Run(folder / "front"))


def test_elites_that_are_evaluated_again_have_the_latest_means(
    tmp_path: Path, open_app: Callable[[Path], Starlette]
) -> None:
    method = {**METHODS["archive"], "population": 12, "generations": 8, "reevaluate": 0.5}
    values = {**BASE, "method": method, "ranking": {"episodes": 1, "seeds": "new"}}
    run = optimize(Experiment.from_mapping(values), out=tmp_path / "noisy")
    app = open_app(tmp_path)
    before: dict[tuple[int, int], float] = {}
    changed = 0
    for generation in range(8):
        points = call(app, "/api/archive_cells", run="noisy", generation=generation).values
        columns = points["columns"]
        expected = compute_elites(run, run.history[generation].evaluations).candidates
        assert columns["fitness"] == [elite.fitness for elite in expected]
        assert columns.get("evaluations", [1] * len(expected)) == [elite.evaluations for elite in expected]
        fitness = dict(
            zip(zip(points["born"], points["candidate"], strict=True), columns["fitness"], strict=True)
        )
        changed += sum(before.get(key, value) != value for key, value in fitness.items())
        before = fitness
    assert changed > 0
