"""Races, by a ranking and by a method."""

from typing import Any

import numpy as np
import pytest

from swarmwright import Experiment, InputError, Run, optimize
from swarmwright.methods.rankings.race import Race
from swarmwright.runs.races import entrants, has_races, races

BASE: dict[str, Any] = {
    "simulation": "minisim",
    "parameters": {"numAgents": 2, "placement": "random", "maxSteps": 8},
    "controller": {"hidden": [2]},
    "servers": "in-process",
    "validate": False,
    "seed": 3,
}


@pytest.fixture(scope="module")
def by_ranking(tmp_path_factory: pytest.TempPathFactory) -> Run:
    values = {
        **BASE,
        "ranking": {"kind": "race", "episodes": 8, "first_test": 3},
        "method": {"kind": "random_search", "population": 15, "generations": 4},
    }
    return optimize(Experiment.from_mapping(values), out=tmp_path_factory.mktemp("races") / "ranking")


@pytest.fixture(scope="module")
def by_method(tmp_path_factory: pytest.TempPathFactory) -> Run:
    values = {**BASE, "method": {"kind": "racing", "evaluations": 400, "survivors": 3, "races": 3}}
    return optimize(Experiment.from_mapping(values), out=tmp_path_factory.mktemp("races") / "method")


def test_episodes_of_a_generation(by_ranking: Run) -> None:
    shown = races(by_ranking)
    assert (shown.unit, shown.count, shown.steps.tolist()) == ("episodes", 4, [1, 2, 3, 4, 5, 6, 7, 8])
    assert shown.candidates.tolist() == [15] * 4
    assert (shown.remaining[:, 0] == 15).all()
    assert shown.remaining[:, -1].sum() < 4 * 15
    ranking = by_ranking.experiment.new_ranking()
    assert isinstance(ranking, Race)
    for generation, row in enumerate(shown.remaining):
        rows = by_ranking.record.generation == generation
        lengths = ranking.count_episodes(by_ranking.record.episodes[rows])
        assert row.tolist() == [(lengths >= step).sum() for step in range(1, 9)]
        entered = entrants(by_ranking, generation)
        assert sorted(entrant.steps for entrant in entered) == sorted(lengths.tolist())
        assert {entrant.state for entrant in entered} <= {"remained", "dropped"}
        for entrant in entered:
            assert by_ranking.evaluation(entrant.candidate, generation).fitness == entrant.fitness


def test_races_over_instances_are_those_of_the_method(by_method: Run) -> None:
    experiment, record = by_method.experiment, by_method.record
    method, numbers = experiment.new_method(), []
    for generation in range(by_method.generations):
        genomes = method.ask()
        rows = record.generation == generation
        assert (record.genomes[rows] == genomes).all()
        numbers.append(method.race)  # type: ignore[attr-defined] # of racing
        method.tell(experiment.new_ranking().score(record.episodes[rows]))
    shown = races(by_method)
    assert shown.unit == "instances"
    assert shown.count == len(set(numbers))
    lengths = np.isfinite(shown.remaining).sum(axis=1)
    assert lengths.tolist() == [numbers.count(number) for number in sorted(set(numbers))]
    first = entrants(by_method, 0)
    assert len(first) == shown.candidates[0]
    assert {"remained", "dropped"} == {entrant.state for entrant in first}
    assert sum(entrant.steps for entrant in first) == np.nansum(shown.remaining[0])


@pytest.mark.parametrize("number", [-1, 99])
def test_a_race_that_does_not_exist(by_ranking: Run, by_method: Run, number: int) -> None:
    for run in (by_ranking, by_method):
        with pytest.raises(InputError, match="race: "):
            entrants(run, number)


def test_other_runs_have_no_races(finished: Run, by_method: Run) -> None:
    assert not has_races(finished)
    assert has_races(by_method)
    with pytest.raises(InputError, match="has no races"):
        races(finished)
    with pytest.raises(InputError, match="most: must be"):
        races(by_method, most=0)
