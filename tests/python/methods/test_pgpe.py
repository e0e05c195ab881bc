"""Policy gradients with parameter-based exploration: their formulas, and that they climb."""

from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from swarmwright import Experiment, evaluate
from swarmwright._engine import centered_ranks
from swarmwright.methods.pgpe import Pgpe, PgpeOptions
from tests.python.methods.functions import Points, conversation, new, sphere


def strategy(**options: Any) -> Pgpe:
    method = new("pgpe", **options)
    assert isinstance(method, Pgpe)
    return method


def away(points: Points) -> Points:
    return sphere(points - 1.5)


def test_deviations_follow_the_formula_of_the_source() -> None:
    method = strategy(population=40, noise=0.3, rate=0.5)
    deviation = np.full(10, 0.3)
    for _ in range(10):
        fitness = -away(method.ask().astype(np.float64))
        samples = deviation * method.search.state("directions").reshape(-1, 10)
        means = centered_ranks(fitness).reshape(20, 2).mean(axis=1)
        gradient = (means[:, np.newaxis] * (samples**2 - deviation**2) / deviation).mean(axis=0)
        change = np.clip(0.5 * gradient, -0.2 * deviation, 0.2 * deviation)
        deviation = deviation + change
        method.tell(fitness)
    assert method.search.state("deviation") == pytest.approx(deviation, rel=1e-9)


def test_candidates_are_pairs_around_the_center() -> None:
    method = strategy(population=20, noise=0.3)
    genomes = method.ask().astype(np.float64)
    assert genomes[::2] + genomes[1::2] == pytest.approx(np.tile(2 * method.center, (10, 1)), abs=1e-5)
    assert (genomes - method.center).std() == pytest.approx(0.9, rel=0.2)


def test_it_climbs_and_its_noise_becomes_small() -> None:
    method = strategy(generations=300)
    asked = conversation(method, away, 300)
    assert away(asked[0].astype(np.float64)).mean() > 10
    assert away(method.center[np.newaxis])[0] < 1e-3
    assert method.search.state("deviation").max() < 0.02


def test_noise_that_changes_nothing_stays_wide() -> None:
    method = strategy(generations=100)
    for _ in range(100):
        genomes = method.ask().astype(np.float64)
        method.tell(-((genomes[:, :5] - 1.0) ** 2).sum(axis=1))  # of the other five nothing depends
    assert method.search.state("deviation")[:5].max() < 0.5 * method.search.state("deviation")[5:].min()


def test_a_plateau_and_a_failed_generation_change_nothing() -> None:
    method = strategy()
    method.tell(np.zeros(len(method.ask())))
    method.tell(np.full(len(method.ask()), np.nan))
    assert method.center.tolist() == [0.0] * 10
    assert method.search.state("deviation").tolist() == [0.07] * 10


@pytest.mark.parametrize("seed", range(1, 11))
def test_it_solves_minisim_with_its_defaults(seed: int) -> None:
    experiment = Experiment.from_mapping({"simulation": "minisim", "method": {"kind": "pgpe"}, "seed": seed})
    method = experiment.new_method(experiment.representation())
    best = -np.inf
    while best < -0.1 and method.evaluations < 2000:
        fitness = evaluate(experiment, method.ask(), servers="in-process")
        best = max(best, float(fitness.max()))
        method.tell(fitness)
    assert best >= -0.1


def test_an_odd_population_is_refused() -> None:
    with pytest.raises(ValidationError, match="multiple of 2"):
        PgpeOptions(population=11)
