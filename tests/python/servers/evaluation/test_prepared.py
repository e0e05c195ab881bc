"""Genomes that the engine evaluates alone: the same as otherwise, whatever is changed in between."""

from typing import Any

import numpy as np
import pytest

from swarmwright import Experiment, InputError, _engine, evaluate
from swarmwright.servers.evaluation.base import Controllers
from swarmwright.servers.evaluation.evaluate import prepare_evaluation
from swarmwright.servers.evaluation.opening import open_backend

ROWS = np.random.default_rng(5).uniform(-2, 2, (300, 49)).astype(np.float32)


def minisim(**changes: Any) -> Experiment:
    values = {"simulation": "minisim", "parameters": {"placement": "random"}, "servers": "in-process"}
    return Experiment.from_mapping({**values, **changes})


def step_by_step(experiment: Experiment, rows: np.ndarray[Any, np.dtype[np.float32]]) -> Any:
    """Evaluate, rank: what `evaluate` does where Python has a part in it."""
    ranking = experiment.new_ranking()
    with open_backend(experiment) as backend:
        controllers = Controllers.from_genomes(experiment.representation(), rows)
        results = backend.evaluate(controllers, ranking.seeds(experiment.first_seed), lambda *_: None)
    return ranking.score(results.fitness)


@pytest.mark.parametrize("aggregate", ["mean", "sum", "median", "worst", "quantile", "cvar"])
@pytest.mark.parametrize("episodes", [1, 4])
def test_fitness_is_that_of_the_ranking(aggregate: str, episodes: int) -> None:
    experiment = minisim(ranking={"episodes": episodes, "aggregate": aggregate, "level": 0.3})
    assert prepare_evaluation(experiment) is not None
    expected = step_by_step(experiment, ROWS)
    assert evaluate(experiment, ROWS).tobytes() == expected.tobytes()
    assert evaluate(experiment, ROWS.astype(np.float64)).tobytes() == expected.tobytes()
    assert evaluate(experiment, np.asfortranarray(ROWS)).tobytes() == expected.tobytes()
    assert evaluate(experiment, ROWS[::-2]).tobytes() == expected[::-2].tobytes()
    assert evaluate(experiment, ROWS[:0]).shape == (0,)


def test_rankings_and_genes_that_python_has_a_part_in_are_left_to_it() -> None:
    assert prepare_evaluation(minisim(fitness="-distance")) is None
    assert prepare_evaluation(minisim(controller={"kind": "mealy_fsm"})) is None


def test_experiments_that_differ_are_prepared_on_their_own() -> None:
    experiment = minisim()
    before = evaluate(experiment, ROWS)
    shorter = experiment.replace(parameters={"maxSteps": 3})
    short = evaluate(shorter, ROWS)
    assert short.tolist() != before.tolist()
    assert short.tobytes() == step_by_step(shorter, ROWS).tobytes()
    seeded = shorter.replace(parameters={"seed": 7})
    assert evaluate(seeded, ROWS).tobytes() == step_by_step(seeded, ROWS).tobytes()
    again = seeded.replace(parameters={"maxSteps": None, "seed": None})
    assert evaluate(again, ROWS).tobytes() == before.tobytes()
    assert prepare_evaluation(again) is prepare_evaluation(experiment)  # equal experiments share evaluators
    with pytest.raises(InputError, match="have 49 genes; this experiment's controllers have 61"):
        evaluate(experiment.replace(controller={"hidden": [8, 2]}), ROWS)


def test_many_experiments_are_not_confused() -> None:
    experiments = [minisim(parameters={"maxSteps": steps}) for steps in range(1, 40)]
    expected = [step_by_step(experiment, ROWS[:9]).tobytes() for experiment in experiments]
    for _ in range(2):
        assert [evaluate(experiment, ROWS[:9]).tobytes() for experiment in experiments] == expected


@pytest.mark.parametrize("place", [(0, 0), (150, 48), (299, 7)])
@pytest.mark.parametrize("episodes", [1, 3])
def test_genes_that_are_not_finite_are_named(place: tuple[int, int], episodes: int) -> None:
    rows = ROWS.copy()
    rows[place] = np.inf
    rows[299, 48] = np.nan
    experiment = minisim(ranking={"episodes": episodes})
    with pytest.raises(InputError, match=f"^genomes: row {place[0]} has a gene that is not finite"):
        evaluate(experiment, rows)
    with open_backend(experiment) as backend:
        evaluator = backend.evaluator(dict(experiment.representation().architecture()))
    assert evaluator is not None
    with pytest.raises(
        _engine.InputError, match=rf"^genomes\[{place[0]}\]\[{place[1]}\] is NaN or infinite$"
    ):
        evaluator.evaluate(rows, [0])


def test_progress_is_reported() -> None:
    calls: list[tuple[int, int, str]] = []
    evaluate(minisim(), ROWS, on_progress=lambda *call: calls.append(call))
    assert calls[-1] == (300, 300, "")


def test_what_a_callback_raises_is_raised() -> None:
    def stop(*_: object) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        evaluate(minisim(), ROWS, on_progress=stop)
