"""Differential evolution and particle swarms through `ask` and `tell` are what pymoo does alone."""

from typing import Any

import numpy as np
import pytest
from pymoo.algorithms.soo.nonconvex.de import DE
from pymoo.algorithms.soo.nonconvex.pso import PSO
from pymoo.core.problem import Problem
from pymoo.core.termination import NoTermination

from swarmwright.methods._pymoo import Pymoo
from swarmwright.testing._samples import BoundedGenes
from swarmwright.typing import Genomes
from tests.python.methods.functions import (
    FUNCTIONS,
    Function,
    conversation,
    evaluations_to,
    new,
    rastrigin,
    sphere,
)

ALGORITHMS = {"de": DE, "pso": PSO}


class Recorded(Problem):  # type: ignore[misc] # the library has no types
    """A function on the box of the method, which keeps what it was asked for, rounded."""

    def __init__(self, function: Function, *, rounding: bool) -> None:
        super().__init__(n_var=10, n_obj=1, xl=np.full(10, -15.0), xu=np.full(10, 15.0))
        self.function = function
        self.rounding = rounding
        self.asked: list[Genomes] = []

    def _evaluate(self, points: Any, out: Any, *_: Any, **__: Any) -> None:
        genomes = points.astype(np.float32)
        self.asked.append(genomes)
        out["F"] = self.function(genomes.astype(np.float64) if self.rounding else points)


def alone(
    kind: str, function: Function, seed: int, generations: int, *, rounding: bool = True, **options: Any
) -> list[Genomes]:
    first = new(kind, seed=seed).ask()
    algorithm = ALGORITHMS[kind](pop_size=len(first), sampling=first.astype(float), **options)
    problem = Recorded(function, rounding=rounding)
    algorithm.setup(problem, seed=seed, termination=NoTermination())
    for _ in range(generations):
        algorithm.next()
    return problem.asked


@pytest.mark.parametrize("function", FUNCTIONS, ids=lambda function: function.__name__)
@pytest.mark.parametrize("kind", ALGORITHMS)
@pytest.mark.parametrize("seed", [1, 2])
def test_the_genomes_are_those_of_the_library_alone(kind: str, function: Function, seed: int) -> None:
    theirs = alone(kind, function, seed, 40)
    ours = conversation(new(kind, seed=seed), function, 40)
    assert [genomes.tobytes() for genomes in ours] == [genomes.tobytes() for genomes in theirs]


@pytest.mark.parametrize(
    ("kind", "options", "theirs"),
    [
        ("de", {"base": "rand", "crossover": "exp"}, {"variant": "DE/rand/1/exp"}),
        ("de", {"base": "target-to-best", "factor": 0.8}, {"variant": "DE/target-to-best/1/bin", "F": 0.8}),
        ("de", {"rate": 0.9, "mutate": 0.0}, {"CR": 0.9, "prob_mut": 0.0}),
        ("de", {"crossover": "line"}, {"variant": "DE/best/1/line"}),
        ("de", {"crossover": "hypercube"}, {"variant": "DE/best/1/hypercube"}),
        ("pso", {"inertia": 0.6, "own": 1.0, "social": 1.5}, {"w": 0.6, "c1": 1.0, "c2": 1.5}),
        ("pso", {"adaptive": False, "perturb": False}, {"adaptive": False, "pertube_best": False}),
        ("pso", {"fastest": 0.05}, {"max_velocity_rate": 0.05}),
    ],
)
def test_options_are_those_of_the_library(kind: str, options: Any, theirs: Any) -> None:
    ours = conversation(new(kind, **options), sphere, 8)
    expected = alone(kind, sphere, 1, 8, **theirs)
    assert [genomes.tobytes() for genomes in ours] == [genomes.tobytes() for genomes in expected]
    assert ours[-1].tobytes() != conversation(new(kind), sphere, 8)[-1].tobytes()


@pytest.mark.parametrize(
    ("kind", "function", "target", "generations"),
    [("de", sphere, 1e-2, 60), ("de", rastrigin, 20.0, 60), ("pso", sphere, 1e-2, 100)],
)
def test_rounding_to_binary32_costs_nothing(
    kind: str, function: Function, target: float, generations: int
) -> None:
    """The library alone, in binary64 all through, needs as many evaluations, within a tenth."""
    ours, theirs = [], []
    for seed in range(1, 6):
        method = new(kind, seed=seed, generations=generations)
        found = evaluations_to(method, function, target)
        assert found is not None
        ours.append(found)
        asked = np.concatenate(alone(kind, function, seed, generations, rounding=False)).astype(np.float64)
        theirs.append(int(np.argmax(function(asked) <= target)) + 1)
    assert np.median(ours) == pytest.approx(np.median(theirs), rel=0.1)


@pytest.mark.parametrize("kind", ALGORITHMS)
def test_the_first_generation_is_that_of_every_method(kind: str) -> None:
    random = new("random_search", population=len(new(kind).ask()))
    assert new(kind).ask().tobytes() == random.ask().tobytes()


@pytest.mark.parametrize("kind", ALGORITHMS)
def test_the_box_is_made_of_bounds_and_of_the_initial_range(kind: str) -> None:
    method = new(kind, subject=BoundedGenes(), reach=4.0)
    assert isinstance(method, Pymoo)
    lower, upper = method.box
    assert lower.tolist() == [0.0] * 9 + [2.0, -4.5, -4.0]
    assert upper.tolist() == [1.0] * 9 + [4.5, -2.0, 4.0]


@pytest.mark.parametrize("kind", ALGORITHMS)
def test_failed_members_are_replaced_by_anything(kind: str) -> None:
    method = new(kind, population=20)
    method.ask()
    method.tell(np.full(20, np.nan))
    assert np.isnan(method.population_fitness).all()
    method.ask()
    fitness = np.full(20, np.nan)
    fitness[3:9] = -1e300
    method.tell(fitness)
    after = method.population_fitness
    assert np.isnan(after).sum() == 14
    assert (after[3:9] == -1e300).all()
    method.ask()
    method.tell(np.full(20, np.nan))  # what failed replaces nobody
    assert np.array_equal(method.population_fitness, after, equal_nan=True)
