"""EvoStick's algorithm, against its description in NumPy."""

import numpy as np
import pytest
from numpy.typing import NDArray

from swarmwright.common.random_numbers import Stream
from swarmwright.controllers import Representation
from swarmwright.methods import Method
from swarmwright.testing import check_method
from swarmwright.testing._common import representation
from tests.python.methods.functions import evaluations_to, new, sphere

Genes = NDArray[np.float64]


def network(sensors: int = 24, actuators: int = 2) -> Representation:
    return representation("evostick", sensors=sensors, actuators=actuators)


def mutant(best: NDArray[np.float32], generation: int, index: int, step: float, reach: float) -> Genes:
    """A mutant as it is described; genes lie around 0."""
    stream = Stream(1, "evostick.candidate", generation, index)
    parent = np.array(best[stream.integer(len(best))], np.float64)
    severe = stream.unit(1)[0] < 0.5
    genes: Genes = parent.copy()
    for gene in range(len(genes)):
        moved, anew = (0.7, 0.2) if severe else (1.0, 0.0)
        if not severe and len(genes) >= 10 and gene > 0.8 * len(genes):
            moved, anew = 0.5, 0.2
        chance = stream.unit(1)[0]
        change = float(stream.uniform(np.array([step]))[0])
        if chance < moved:
            genes[gene] += change
        elif chance < moved + anew:
            genes[gene] = change
    genes.clip(-reach, reach, out=genes)
    return genes


@pytest.mark.slow
def test_it_is_a_method() -> None:
    check_method("evostick")


@pytest.mark.parametrize(("sensors", "actuators"), [(24, 2), (3, 1)])
def test_generations_are_those_described_to_the_last_bit(sensors: int, actuators: int) -> None:
    subject = network(sensors, actuators)
    method = new("evostick", subject=subject, generations=4)
    population = method.ask()
    assert population.shape == (100, subject.genome_size)
    assert np.abs(population).max() > 4.5
    for generation in range(1, 4):
        fitness = np.random.default_rng(generation).integers(0, 30, 100).astype(np.float64)
        fitness[::7] = np.nan
        method.tell(fitness)
        # The first of equals is better, and a failed one worse than all others.
        order = np.argsort(-np.where(np.isnan(fitness), -np.inf, fitness), kind="stable")
        best = population[order[:20]]
        mutants = [mutant(best, generation, index, 1.0, 5.0) for index in range(20, 100)]
        expected = np.concatenate([best, np.array(mutants, np.float32)])
        population = method.ask()
        assert population.tobytes() == expected.tobytes()


def test_those_that_stay_are_evaluated_again_and_may_lose() -> None:
    method = new("evostick", subject=network(), population=10, elites=3)
    first = method.ask()
    method.tell(np.arange(10.0))
    second = method.ask()
    assert second[:3].tobytes() == first[[9, 8, 7]].tobytes()
    # On new seeds the former best is the worst.
    method.tell(np.arange(10.0))
    assert first[9].tobytes() not in {genome.tobytes() for genome in method.ask()}


def test_more_elites_than_members_are_all_of_them() -> None:
    method = new("evostick", subject=network(), population=4)
    first = method.ask()
    method.tell(np.arange(4.0))
    assert method.ask().tobytes() == first[::-1].tobytes()


def test_it_makes_progress() -> None:
    found = [evaluations_to(new("evostick", seed=seed, generations=400), sphere, 0.5) for seed in (1, 2, 3)]
    assert None not in found
    assert all(evaluations <= 20_000 for evaluations in found if evaluations is not None)


def test_generations_of_one_kind_of_genes_do_not_depend_on_each_other() -> None:
    """A large generation is made by several threads, each candidate by its own numbers."""

    def second(population: int) -> Method:
        method = new("evostick", subject=network(200, 4), population=population, elites=5)
        method.ask()
        method.tell(np.concatenate([np.arange(5.0, 0, -1), np.zeros(population - 5)]))
        return method

    few, many = (second(population).ask() for population in (30, 300))
    assert many[:30].tobytes() == few.tobytes()
