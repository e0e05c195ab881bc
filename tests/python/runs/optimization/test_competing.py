"""Runs of competitions: their record, on any servers, and after an interruption."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import swarmwright
from swarmwright import InputError, Run
from swarmwright.runs.matches import play, slices_of

MINISIM: dict[str, Any] = {
    "simulation": "minisim",
    "parameters": {
        "numAgents": 2,
        "numDefenders": 2,
        "placement": "random",
        "defenderSteering": "controller",
    },
    "controller": {"hidden": [2]},
    "method": {"population": 5, "generations": 4},
    "validate": False,
}
POPULATIONS = {
    **MINISIM,
    "populations": {"agents": {}, "defenders": {"method": {"kind": "snes", "population": 4}}},
    "ranking": {"pairing": "hall_of_fame", "rounds": 2, "episodes": 2},
}
TOURNAMENT = {**MINISIM, "ranking": {"kind": "tournament", "pairing": "swiss", "episodes": 2}}
COMPETITIONS = pytest.mark.parametrize("experiment", [POPULATIONS, TOURNAMENT], ids=["populations", "swiss"])


def record(run: Run, folder: Path) -> bytes:
    file = folder / f"{run.path.name}.csv"
    run.export(file)
    return file.read_bytes()


@pytest.mark.slow
@COMPETITIONS
@pytest.mark.parametrize(
    "where", [{"servers": 2}, {"servers": 3, "mode": "stepwise"}], ids=["two", "stepwise"]
)
def test_the_record_is_the_same_on_servers(
    experiment: dict[str, Any], where: dict[str, Any], tmp_path: Path
) -> None:
    alone = swarmwright.optimize(experiment, servers="in-process", out=tmp_path / "alone")
    served = swarmwright.optimize({**experiment, **where}, out=tmp_path / "served")
    assert record(served, tmp_path) == record(alone, tmp_path)


@COMPETITIONS
def test_a_resumed_run_has_the_same_record(experiment: dict[str, Any], tmp_path: Path) -> None:
    whole = swarmwright.optimize(experiment, servers="in-process", out=tmp_path / "whole")
    swarmwright.optimize(
        experiment, lambda report: report.generation < 1, servers="in-process", out=tmp_path / "cut"
    )
    resumed = swarmwright.resume(tmp_path / "cut", servers="in-process")
    assert record(resumed, tmp_path) == record(whole, tmp_path)


def test_a_finished_run_goes_on_to_more_generations(tmp_path: Path) -> None:
    short = {**POPULATIONS, "method": {"population": 5, "generations": 2}}
    swarmwright.optimize(short, servers="in-process", out=tmp_path / "extended")
    extended = swarmwright.resume(tmp_path / "extended", generations=4, servers="in-process")
    whole = swarmwright.optimize(POPULATIONS, servers="in-process", out=tmp_path / "whole")
    assert record(extended, tmp_path) == record(whole, tmp_path)


@COMPETITIONS
def test_the_last_match_of_a_generation_is_that_of_the_champions(
    experiment: dict[str, Any], tmp_path: Path
) -> None:
    run = swarmwright.optimize(experiment, servers="in-process", out=tmp_path / "run")
    slices = slices_of(run.experiment)
    best = {side: run.champions(side) for side in slices}
    assert [champion.generation for champion in best["agents"]] == [0, 1, 2, 3]
    assert run.best.generation == 3
    last = np.concatenate([champions[-1].genome for champions in best.values()])
    fitness = play(run.experiment, last[np.newaxis], [0, 1], servers="in-process")
    assert fitness.shape == (1, 2, 2)
    assert fitness[0, :, 0].mean() == run.best.fitness
    assert (fitness[..., 1] == -fitness[..., 0]).all()


def test_budgets_count_matches(tmp_path: Path) -> None:
    limited = {**TOURNAMENT, "method": {"population": 5, "evaluations": 40}}
    run = swarmwright.optimize(limited, servers="in-process", out=tmp_path / "run")
    assert 0 < run.evaluations <= 40


def test_only_competitions_have_champions(tmp_path: Path) -> None:
    run = swarmwright.optimize(MINISIM | {"parameters": {}}, servers="in-process", out=tmp_path / "run")
    with pytest.raises(InputError, match="no competition"):
        run.champions("agents")


def test_unknown_sides_and_wrong_genomes_are_a_message(tmp_path: Path) -> None:
    run = swarmwright.optimize(TOURNAMENT, servers="in-process", out=tmp_path / "run")
    with pytest.raises(InputError, match="'left' is none of agents, defenders"):
        run.champions("left")
    with pytest.raises(InputError, match=r"genomes: shape is \(1, 3\); expected \(matches, 26\)"):
        play(run.experiment, np.zeros((1, 3)), [0], servers="in-process")
