"""A candidate of a run in episodes that it was not chosen by."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmwright import Controller, Experiment, InputError, Run, evaluate, optimize, post_evaluate
from swarmwright.common.statistics import estimate
from swarmwright.runs.post_evaluation import choose_unseen_seeds

NOISY: dict[str, Any] = {
    "simulation": "minisim",
    "parameters": {"numAgents": 3, "numDefenders": 3, "placement": "random", "speedDefenders": 0.5},
    "method": {"kind": "cma_es", "population": 20, "generations": 15, "step": 0.5},
    "ranking": {"episodes": 2, "seeds": "new"},
    "servers": "local",
}


def run_of(tmp_path: Path, **changes: Any) -> Run:
    folder = tmp_path / f"run-{len(list(tmp_path.iterdir()))}"
    return optimize(Experiment.from_mapping(NOISY).replace(**changes), out=folder)


def again(run: Run, seeds: list[int], parameters: dict[str, Any] | None = None) -> list[float]:
    """The fitness of the run's best in an episode of each seed, by another way."""
    changed = run.experiment.replace(ranking={"seeds": "same", "episodes": 1}, parameters=parameters or {})
    genome = run.evaluation().genome[np.newaxis]
    return [float(evaluate(changed.replace(parameters={"seed": seed}), genome)[0]) for seed in seeds]


def test_any_candidate_is_evaluated_in_other_episodes(tmp_path: Path) -> None:
    run = run_of(tmp_path, validate=False)
    found = post_evaluate(run, episodes=20, seed=5)
    assert found.seeds == list(range(5, 25))
    assert found.seen == 20, "the run used 0 to 29"
    assert found.episodes.tolist() == again(run, found.seeds)
    values = found.to_mapping()
    assert values["mean"] == pytest.approx(found.episodes.mean())
    assert values["standard_error"] == pytest.approx(found.episodes.std(ddof=1) / np.sqrt(20))
    assert (values["min"], values["max"]) == (found.episodes.min(), found.episodes.max())
    assert values["median"] == pytest.approx(np.median(found.episodes))
    other = post_evaluate(run, 3, 0, episodes=1)
    assert (other.number, other.recorded) == (3, run.evaluation(3, 0).fitness)
    assert other.mean.standard_error is None
    harder = run.experiment.with_settings(["parameters.speedDefenders=0.8"])
    assert post_evaluate(run, episodes=20, seed=5, experiment=harder).mean.mean < found.mean.mean
    with pytest.raises(InputError, match="seed: must be from 0"):
        post_evaluate(run, seed=-1)


@pytest.mark.slow
def test_a_controller_from_elsewhere_has_the_statistics_of_a_candidate(tmp_path: Path) -> None:
    run = run_of(tmp_path, validate=False)
    expected = post_evaluate(run, episodes=12, metrics=["steps"])
    file = tmp_path / "mine.json"
    Controller.load(run.path).save(file)
    loaded = Controller.load(file)
    for source, controller in (
        (run.experiment, loaded),
        (run.path / "experiment.yaml", file),
        (run.experiment.to_mapping(), file),
        (run, run.path),
    ):
        found = post_evaluate(source, controller=controller, episodes=12, metrics=["steps"], servers="local")
        assert (found.seeds, found.episodes.tolist()) == (expected.seeds, expected.episodes.tolist())
        assert (found.mean, found.fitness) == (expected.mean, expected.fitness)
        assert found.metrics["steps"].tolist() == expected.metrics["steps"].tolist()
        assert found.to_mapping().items() < expected.to_mapping().items()
    harder = run.experiment.with_settings(["parameters.speedDefenders=0.8"])
    assert post_evaluate(run, controller=file, episodes=12, experiment=harder).mean.mean < found.mean.mean
    assert post_evaluate(run, controller=file, episodes=2, seed=7).seeds == [7, 8]
    with pytest.raises(InputError, match="cannot be combined with a candidate"):
        post_evaluate(run, 3, controller=file)  # type: ignore[call-overload]
    with pytest.raises(InputError, match=r"an experiment has no candidates; specify controller=\.\."):
        post_evaluate(run.experiment)  # type: ignore[call-overload]
    with pytest.raises(InputError, match="has 4 sensors and 1 actuators; emergency_exit has"):
        post_evaluate(Experiment.from_mapping({"simulation": "emergency_exit"}), controller=file)


def test_it_knows_which_seeds_the_validation_used(tmp_path: Path) -> None:
    run = run_of(tmp_path, validate={"episodes": 20})
    assert run.validation is not None
    by_default = post_evaluate(run, episodes=30)
    assert set(by_default.seeds) > set(run.validation.seeds)
    assert (by_default.seen, by_default.validated) == (0, 20)
    assert post_evaluate(run, episodes=5, seed=by_default.seeds[-1] + 1).validated == 0
    assert post_evaluate(run_of(tmp_path, validate=False), episodes=20).validated == 0


@pytest.mark.parametrize(
    ("ranking", "expected"),
    [
        ({"episodes": 4, "aggregate": "mean"}, lambda rows: rows.mean()),
        ({"episodes": 4, "aggregate": "sum"}, lambda rows: rows.sum(axis=1).mean()),
        ({"episodes": 4, "aggregate": "worst"}, lambda rows: rows.min(axis=1).mean()),
        ({"episodes": 4, "aggregate": "median"}, lambda rows: np.median(rows, axis=1).mean()),
    ],
)
def test_the_fitness_is_that_of_the_ranking(ranking: dict[str, Any], expected: Any) -> None:
    made = Experiment.from_mapping({"simulation": "minisim", "ranking": ranking}).new_ranking()
    values = np.random.default_rng(1).normal(size=40)
    found = estimate(made.samples(values.tolist()).tolist())
    assert found.mean == pytest.approx(expected(values.reshape(10, 4)))


def test_the_interval_is_students() -> None:
    found = estimate([1.0, 2.0, 4.0, 5.0])
    # 3 degrees of freedom: t = 3.182446; standard error 0.912871.
    assert (found.mean, found.standard_error) == pytest.approx((3.0, 0.9128709))
    assert (found.low, found.high) == pytest.approx((3 - 2.9051627, 3 + 2.9051627))
    assert estimate([2.0]).low is None


def test_unseen_seeds_are_none_of_the_run() -> None:
    assert choose_unseen_seeds(3, {1_000_000_004, 7}, 3) == [1_000_000_003, 1_000_000_005, 1_000_000_006]
    assert max(choose_unseen_seeds(2**63 - 1, set(), 4)) < 2**63
