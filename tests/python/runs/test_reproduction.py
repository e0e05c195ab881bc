"""Elites on held-out seeds, of archives with and without repeated evaluations."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmwright import Experiment, InputError, Run, optimize, reproduce_elites, resume
from swarmwright.cli._main import run as command
from swarmwright.methods.archive import Archive
from swarmwright.methods.map_elites import MapElites
from swarmwright.methods.sampled_archive import SampledArchive
from swarmwright.runs.elites import compute_elites
from tests.python.records import same_record

MEASURES = {"steps": {"range": [0, 12], "bins": 6}, "distance": {"range": [0, 30], "bins": 5}}
BASE: dict[str, Any] = {
    "simulation": "minisim",
    "parameters": {"numAgents": 3, "numDefenders": 2, "placement": "random", "maxSteps": 12},
    "method": {"kind": "map_elites", "population": 20, "generations": 8, "measures": MEASURES},
    "ranking": {"episodes": 2},
    "servers": "local",
    "seed": 5,
}
SAMPLED = {
    **BASE,
    "method": {**BASE["method"], "reevaluate": 0.5},
    "ranking": {"episodes": 2, "seeds": "new"},
}


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    return optimize(Experiment.from_mapping(SAMPLED), out=tmp_path_factory.mktemp("sampled") / "run")


def test_elites_are_those_of_the_method(run: Run) -> None:
    method = run.experiment.new_method()
    assert isinstance(method, MapElites)
    repeated = 0
    for generation in range(run.generations):
        rows = [run.evaluation(candidate, generation) for candidate in range(20)]
        asked = method.ask()
        assert asked.tobytes() == np.stack([row.genome for row in rows]).tobytes()
        assert isinstance(method.archive, SampledArchive)
        repeated += len(method.archive.planned)
        columns = [run.metrics.index(name) for name in MEASURES]
        metrics = np.stack([row.metrics[:, columns].mean(axis=0) for row in rows])
        method.tell([row.fitness for row in rows], metrics=metrics)
    assert repeated > 20
    assert isinstance(method.archive, SampledArchive)
    elites = {20 * one.generation + one.candidate: one for one in run.elites.candidates}
    assert sorted(elites) == sorted(method.archive.numbers.tolist())
    for elite in method.archive.elites:
        found = elites[elite.number]
        assert (found.fitness, found.evaluations, found.interval) == (
            elite.fitness,
            elite.evaluations,
            elite.interval,
        )
    assert max(one.evaluations for one in elites.values()) > 2
    assert len(compute_elites(run, 47).candidates) > 1  # within a generation


def test_it_is_resumed(run: Run, tmp_path: Path) -> None:
    other = optimize(run.experiment, lambda generation: generation.generation < 3, out=tmp_path / "other")
    assert other.generations == 4
    same_record(resume(other, generations=8), run)


def test_what_is_reproduced(run: Run) -> None:
    found = reproduce_elites(run, episodes=30, servers="local")
    elites = run.elites
    fitness = np.array([one.episodes.mean() for one in found.evaluations])
    measures = np.array([[one.metrics[name].mean() for name in MEASURES] for one in found.evaluations])
    assert elites.cells is not None
    moved = elites.cells.cells_of(measures) != elites.cells.cells_of(elites.values()[:, 1:])
    assert found.moved.tolist() == moved.tolist()
    assert 0 < found.illusory.sum() < len(fitness)
    corrected = Archive(elites.cells)
    corrected.add(range(len(fitness)), fitness, measures)
    coverage, score = found.coverage(), found.qd_score(-7)
    assert coverage.value == len(corrected) / 30
    assert coverage.low <= coverage.value <= coverage.high + 1 / 30
    assert score.value == pytest.approx((corrected.fitness + 7).sum())
    assert score.low < score.value < score.high
    share = found.reproducibility
    assert share.value == 1 - found.illusory.mean()
    assert 0 < share.low < share.value < share.high < 1
    assert found.evaluations[0].seen == 0


def test_the_command(run: Run, capsys: pytest.CaptureFixture[str]) -> None:
    assert command(["runs", "elites", str(run.path), "--episodes", "5", "--servers", "local"]) == 0
    text = capsys.readouterr().out
    assert "evaluations" in text.splitlines()[1]
    assert "On held-out seeds, 5 episodes each: " in text
    assert "reproducibility" in text
    assert command(["runs", "elites", str(run.path), "--episodes", "5", "--seed", "9", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)["held_out"]
    assert found["seeds"] == [9, 10, 11, 12, 13]
    assert len(found["elites"]) == len(run.elites.candidates)
    assert command(["runs", "elites", str(run.path), "--seed", "9"]) == 2
    assert "--seed needs --episodes; add it" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("method", "ranking", "message"),
    [
        ({"reevaluate": 0.5}, {}, r"ranking\.seeds: must be new with method\.reevaluate"),
        (
            {"reevaluate": 0.5, "variation": "cma_me"},
            {"seeds": "new"},
            r"method\.reevaluate: needs archive\.kind grid or cvt, and variation line or mutation",
        ),
        ({"variation": "cma_mae"}, {}, r"method\.threshold_min: cma_mae needs it"),
        (
            {"variation": "cma_me", "emitters": 3},
            {},
            r"method\.population: 20 must be a multiple of emitters",
        ),
        ({"variation": "cma_me", "emitters": 10}, {}, r"method\.population: .*at least 3 for each"),
        ({"archive": {"kind": "cvt"}}, {}, r"method\.measures\.steps\.bins: only a grid has bins"),
        ({"archive": {"kind": "cvt", "cells": 0}}, {}, r"method\.archive.*cells.*1"),
        ({"archive": {"kind": "unstructured", "threshold": float("nan")}}, {}, r"method\.archive.*threshold"),
        ({"measures": {"steps": {"range": [3, 3]}}}, {}, r"method\.measures\.steps.*low < high"),
        ({"measures": {}}, {}, r"method\.measures: "),
    ],
)
def test_wrong_options(method: dict[str, Any], ranking: dict[str, Any], message: str) -> None:
    values = {
        **BASE,
        "method": {**BASE["method"], **method},
        "ranking": {**BASE["ranking"], **ranking},
    }
    with pytest.raises(InputError, match=message):
        Experiment.from_mapping(values)


def test_runs_without_cells_are_refused(tmp_path: Path) -> None:
    ranges = {"steps": {"range": [0, 12]}}
    options = {"measures": ranges, "archive": {"kind": "unstructured"}, "generations": 2}
    values = {**BASE, "method": {**BASE["method"], **options}}
    run = optimize(Experiment.from_mapping(values), out=tmp_path / "run")
    with pytest.raises(InputError, match="has an unstructured archive, whose elites have no cells"):
        reproduce_elites(run, episodes=2)


RANGES = {name: {"range": measure["range"]} for name, measure in MEASURES.items()}


@pytest.mark.slow
@pytest.mark.parametrize(
    "method",
    [
        {"reevaluate": 0.5},
        {"measures": RANGES, "archive": {"kind": "cvt", "cells": 40}, "variation": "cma_me", "emitters": 4},
        {"variation": "cma_mae", "emitters": 4, "threshold_min": -9.0},
        {"measures": RANGES, "archive": {"kind": "unstructured"}},
    ],
)
def test_records_are_the_same_on_servers_and_after_a_break(method: dict[str, Any], tmp_path: Path) -> None:
    seeds = {"ranking": SAMPLED["ranking"]} if "reevaluate" in method else {}
    experiment = Experiment.from_mapping({**BASE, **seeds, "method": {**BASE["method"], **method}})
    here = optimize(experiment, out=tmp_path / "here")
    same_record(optimize(experiment, servers=2, out=tmp_path / "two"), here)
    cut = optimize(experiment, lambda generation: generation.generation < 3, servers=1, out=tmp_path / "cut")
    same_record(resume(cut, generations=8), here)
