"""Cuckoo search: flights, discoveries, and what nests keep."""

import math
from typing import Any

import numpy as np
import pytest

from swarmwright import InputError
from swarmwright.controllers import REPRESENTATIONS
from swarmwright.methods.cuckoo_search import _SIGMA, CuckooSearch, _cube_root
from tests.python.methods.functions import new, sphere


def cuckoos(**options: Any) -> CuckooSearch:
    method = new("cuckoo_search", **options)
    assert isinstance(method, CuckooSearch)
    return method


def told(method: CuckooSearch) -> Any:
    genomes = method.ask()
    method.tell(-sphere(genomes.astype(np.float64)))
    return genomes


def test_defaults() -> None:
    options = cuckoos().options
    assert (options.population, options.generations, options.discovery) == (50, 200, 0.25)


def test_all_but_the_best_fly_and_few_are_discovered() -> None:
    method = cuckoos(population=400)
    told(method)
    assert len(told(method)) == 399
    assert len(told(method)) == pytest.approx(100, abs=35)
    assert len(cuckoos(population=5).ask()) == 5
    never = cuckoos(population=5, discovery=0.0)
    assert [len(told(never)) for _ in range(4)] == [5, 4, 1, 4]


def test_flights_are_relative_to_the_best_nest() -> None:
    method = cuckoos(population=2000, step=1.0)
    nests = told(method).astype(np.float64)
    best = int(np.argmin(sphere(nests)))
    moved = method.ask().astype(np.float64)
    others = np.delete(nests, best, axis=0)
    jumps = (moved - others) / (others - nests[best])
    # A Lévy-stable number times a normal one: half of the jumps are short, and some are very long.
    assert 0.3 < np.median(np.abs(jumps)) < 0.7
    assert np.abs(jumps).max() > 20
    assert abs(np.mean(jumps > 0) - 0.5) < 0.02
    tail = [np.mean(np.abs(jumps) > limit) for limit in (4.0, 16.0)]
    assert tail[0] / tail[1] == pytest.approx(4**1.5, rel=0.3)  # the exponent of the flights


def test_discovered_nests_move_by_differences() -> None:
    method = cuckoos(population=30, discovery=1.0)
    told(method)
    told(method)
    nests = method.survivors().astype(np.float64)
    moved = method.ask().astype(np.float64) - nests
    differences = (nests[:, np.newaxis] - nests).reshape(-1, 10)
    lengths = np.sqrt(sphere(differences))
    for step in moved[sphere(moved) > 1e-9]:
        cosines = differences @ step / (lengths * math.sqrt((step**2).sum()) + 1e-300)
        best = int(np.argmax(cosines))
        assert cosines[best] > 1 - 1e-9
        assert math.sqrt((step**2).sum()) <= lengths[best] * 1.001


def test_a_nest_changes_only_to_what_is_not_worse() -> None:
    method = cuckoos(population=4, discovery=1.0)
    method.ask()
    method.tell([1.0, 2.0, np.nan, 3.0])
    before = method.survivors()
    flown = method.ask()  # of nests 0, 1 and 2
    method.tell([1.0, 1.5, -7.0])
    assert method.population_fitness.tolist() == [1.0, 2.0, -7.0, 3.0]
    expected = [flown[0], before[1], flown[2], before[3]]
    assert method.survivors().tobytes() == np.array(expected).tobytes()
    method.ask()
    method.tell([np.nan] * 4, survivors=[4.0, 5.0, 6.0, np.nan])
    assert method.population_fitness.tolist()[:3] == [4.0, 5.0, 6.0]


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_it_gets_better(seed: int) -> None:
    method = cuckoos(seed=seed, generations=200)
    best = []
    while not method.done:
        told(method)
        best.append(method.population_fitness.max())
    assert best == sorted(best)
    assert best[-1] > best[0] / 50


def test_choices_are_refused() -> None:
    machine = REPRESENTATIONS.get("mealy_fsm")
    subject = machine(machine.options_model(), sensors=2, actuators=1)
    with pytest.raises(InputError, match="cuckoo_search cannot evolve mealy_fsm"):
        new("cuckoo_search", subject=subject)


def test_numbers_of_flights() -> None:
    numbers = np.concatenate([np.logspace(-300, 300, 5001), [0.0, 8.0, 27.0]])
    assert _cube_root(numbers)[:-3] == pytest.approx(np.cbrt(numbers[:-3]), rel=1e-15)
    assert _cube_root(numbers)[-2:].tolist() == [2.0, 3.0]
    assert np.isfinite(1 / _cube_root(numbers)).all()
    beta = 1.5
    above = math.gamma(1 + beta) * math.sin(math.pi * beta / 2)
    below = math.gamma((1 + beta) / 2) * beta * 2 ** ((beta - 1) / 2)
    assert pytest.approx((above / below) ** (1 / beta), rel=1e-15) == _SIGMA
