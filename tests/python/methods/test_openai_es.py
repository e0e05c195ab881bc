"""OpenAI's evolution strategy: pairs, and that it climbs."""

from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from swarmwright import Experiment, evaluate
from swarmwright.methods.openai_es import OpenaiEs, OpenaiEsOptions
from swarmwright.testing._methods import BoundedGenes
from tests.python.methods.functions import Points, conversation, new, rosenbrock, sphere, ten_genes


def strategy(**options: Any) -> OpenaiEs:
    method = new("openai_es", **options)
    assert isinstance(method, OpenaiEs)
    return method


def _solves_minisim(seed: int, generations: int) -> bool:
    experiment = Experiment.from_mapping(
        {"simulation": "minisim", "method": {"kind": "openai_es"}, "seed": seed}
    )
    method = experiment.new_method(experiment.representation())
    for _ in range(generations):
        fitness = evaluate(experiment, method.ask(), servers="local")
        if fitness.max() > -0.1:
            return True
        method.tell(fitness)
    return False


def test_it_solves_minisim_with_its_defaults() -> None:
    """In nine of ten runs within 20 generations, in all within 100."""
    assert sum(_solves_minisim(seed, 20) for seed in range(1, 101)) >= 90
    assert all(_solves_minisim(seed, 100) for seed in range(1, 101))


def test_candidates_are_pairs_around_the_center() -> None:
    method = strategy(population=20, noise=0.3)
    genomes = method.ask().astype(np.float64)
    assert genomes[::2] + genomes[1::2] == pytest.approx(np.tile(2 * method.center, (10, 1)), abs=1e-5)
    # 0.3 of half the initial range of +-3.
    assert (genomes - method.center).std() == pytest.approx(0.9, rel=0.2)


def test_the_first_step_of_adam_is_as_long_as_its_step_size() -> None:
    # Adam's first step is the sign of the gradient times the step size, whatever the gradient's length.
    method = strategy(step=0.05, decay=0.0, population=4000)
    before = method.center
    genomes = method.ask().astype(np.float64)
    method.tell(genomes.sum(axis=1))
    moved = method.center - before
    assert np.abs(moved) == pytest.approx(np.full(10, 0.05 * 3.0), rel=1e-4)
    assert (moved > 0).all()


def test_it_starts_in_the_middle_of_the_range() -> None:
    # A random network's nodes are at their limits, where a small step changes nothing.
    assert strategy(seed=1).center.tolist() == strategy(seed=2).center.tolist() == [0.0] * 10


def test_it_climbs() -> None:
    def away(points: Points) -> Points:
        return sphere(points - 1.5)

    method = strategy(generations=200, noise=0.05, step=0.05)
    asked = conversation(method, away, 200)
    assert away(asked[0].astype(np.float64)).mean() > 10
    assert away(method.center[np.newaxis])[0] < 0.05
    curved = strategy(generations=200, noise=0.02, step=0.02)
    conversation(curved, rosenbrock, 200)
    assert rosenbrock(curved.center[np.newaxis])[0] < 20


def test_a_plateau_pushes_nowhere_but_decay_pulls_to_the_middle() -> None:
    still, pulled = strategy(decay=0.0), strategy(decay=0.5)
    for method in (still, pulled):
        for _ in range(10):  # away from the middle
            method.tell(method.ask().sum(axis=1))
        for _ in range(120):  # until Adam's momentum is used up
            method.tell(np.zeros(len(method.ask())))
        if method is still:
            start = method.center
            assert np.abs(method.search.state("momentum")).max() < 1e-6
            for _ in range(20):
                method.tell(np.zeros(len(method.ask())))
            assert method.center == pytest.approx(start, rel=1e-4)
    assert (np.abs(pulled.center) < np.abs(still.center)).all()


def test_a_generation_that_failed_moves_nothing() -> None:
    method = strategy(decay=0.5)
    before = method.center
    method.tell(np.full(len(method.ask()), np.nan))
    assert np.array_equal(method.center, before)


def test_genes_are_cut_to_their_bounds() -> None:
    method = new("openai_es", subject=BoundedGenes(), step=1.0, population=100)
    assert isinstance(method, OpenaiEs)
    for _ in range(10):
        method.tell(method.ask().sum(axis=1))
    assert method.center[:9].tolist() == [1.0] * 9
    assert method.ask()[:, :9].max() == 1.0


def test_an_odd_population_is_refused() -> None:
    with pytest.raises(ValidationError, match="multiple of 2"):
        OpenaiEsOptions(population=11)


def test_large_genomes_need_no_more_than_their_room() -> None:
    subject = type(ten_genes())(ten_genes().options_model(hidden=[200, 200]), sensors=9, actuators=1)  # type: ignore[call-arg]
    method = new("openai_es", subject=subject, population=4)
    before = method.ask()
    method.tell(np.array([1.0, 2.0, 3.0, 4.0]))
    assert before.shape == method.ask().shape == (4, subject.genome_size)
