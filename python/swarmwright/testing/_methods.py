"""Checks of methods."""

import numpy as np

from swarmwright.methods import METHODS, Method
from swarmwright.representations._base import Genomes
from swarmwright.testing._common import check_options, representation

_GENERATIONS = 6


def check_method(kind: str) -> None:
    """Check a registered method with its default options, but few generations, on the networks built in."""
    check_options(METHODS, kind)
    for name in ("layered", "fully_meshed"):
        asked = _conversation(_new(kind, name, 1))
        again = _conversation(_new(kind, name, 1))
        assert len(asked) == _GENERATIONS, f"{len(asked)} generations instead of {_GENERATIONS}"
        assert _bytes(asked) == _bytes(again), "the same seed and fitness must give the same genomes"
        assert _bytes(asked) != _bytes(_conversation(_new(kind, name, 2))), "another seed must give others"
    _check_budget(kind)
    _check_failures(kind)
    _check_target(kind)


def _new(kind: str, name: str = "layered", seed: int = 1, target: float | None = None) -> Method:
    component = METHODS.get(kind)
    options = component.options_model(generations=_GENERATIONS, target=target)
    return component(options, representation(name), seed=seed)


def _bytes(asked: list[Genomes]) -> list[bytes]:
    return [genomes.tobytes() for genomes in asked]


def _sphere(genomes: Genomes) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Return minus the squared length of each genome: negative, best at 0, the same on every machine."""
    fitness: np.ndarray[tuple[int], np.dtype[np.float64]] = -np.add.accumulate(
        genomes.astype(np.float64) ** 2, axis=1
    )[:, -1]
    return fitness


def _conversation(method: Method) -> list[Genomes]:
    asked: list[Genomes] = []
    while not method.done:
        genomes = method.ask()
        assert genomes.dtype == np.float32, f"ask returns {genomes.dtype}, not float32"
        assert genomes.ndim == 2, f"ask returns the shape {genomes.shape}"
        assert genomes.shape[1] == method.representation.genome_size, f"ask returns the shape {genomes.shape}"
        assert len(genomes) >= 1, "ask returns nothing to evaluate"
        assert np.isfinite(genomes).all(), "ask returns numbers that are not finite"
        asked.append(genomes.copy())
        # What the caller does to the array must not matter.
        fitness = _sphere(genomes)
        genomes[:] = np.nan
        method.tell(fitness)
        population = method.population_fitness
        assert len(population) >= 1
        assert np.isfinite(population).all()
    return asked


def _check_budget(kind: str) -> None:
    method = _new(kind)
    budget = method.budget
    asked = _conversation(method)
    assert sum(map(len, asked)) == method.evaluations == budget, "budget is not what was evaluated"


def _check_failures(kind: str) -> None:
    """Candidates that fail must neither stop a method nor lead it."""
    method = _new(kind)
    while not method.done:
        genomes = method.ask()
        fitness = _sphere(genomes)
        fitness[::2] = np.nan
        fitness[1:2] = -np.inf
        method.tell(fitness)
        assert not np.isinf(method.population_fitness).any(), "an infinite fitness is a failed one"
    alone = _new(kind)
    alone.tell(np.full(len(alone.ask()), np.nan))
    assert len(alone.ask()) >= 1, "a generation that failed as a whole must not stop the method"


def _check_target(kind: str) -> None:
    method = _new(kind, target=-1e9)
    method.tell(_sphere(method.ask()))
    assert method.done, "a target that is reached must end the method"
