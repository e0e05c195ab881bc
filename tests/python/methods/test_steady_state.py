"""Candidate by candidate: servers of any number and speed give the same run."""

import heapq
import random
from typing import Any

import numpy as np
import pytest

from swarmwright import Experiment, InputError
from swarmwright.common.arrays import Genome
from swarmwright.methods import METHODS
from tests.python.methods.functions import new, sphere

STEADY = sorted(kind for kind in METHODS.built_in if METHODS.get(kind).steady_state)


def run(kind: str, servers: int, speed: int, **options: Any) -> tuple[list[bytes], float]:
    """The genomes of a run on so many servers, and when it ended; `speed`: seed of how long episodes take."""
    generations = 9 if kind == "tpe" else 3  # of ten candidates
    method = new(kind, operation="steady_state", generations=generations, **options)
    times = random.Random(speed)
    busy: list[tuple[float, int, float]] = []  # when ready, index, fitness
    early: dict[int, float] = {}
    asked: list[Genome] = []
    now = 0.0
    while not method.done:
        while len(busy) < servers and method.can_ask:
            index, genome = method.ask_next()
            assert index == len(asked)
            asked.append(genome)
            fitness = -float(sphere(genome[np.newaxis].astype(np.float64))[0])
            heapq.heappush(busy, (now + times.choice([0.1, 1.0, 20.0]), index, fitness))
        now, index, fitness = heapq.heappop(busy)
        early[index] = fitness
        while method.evaluations in early and not method.done:
            method.tell_next(early.pop(method.evaluations))
    return [genome.tobytes() for genome in asked], now


@pytest.mark.parametrize("kind", STEADY)
def test_a_run_does_not_depend_on_servers(kind: str) -> None:
    genomes, alone = run(kind, servers=1, speed=1)
    ends = []
    for servers, speed in ((1, 2), (3, 3), (16, 4), (16, 5), (500, 6)):
        others, end = run(kind, servers, speed)
        assert others == genomes
        ends.append(end)
    assert min(ends[2:]) < alone / 4, "servers work at the same time"


@pytest.mark.parametrize("kind", STEADY)
def test_the_window_is_part_of_the_run(kind: str) -> None:
    narrow, wide = (run(kind, servers=4, speed=1, in_flight=size)[0] for size in (1, 40))
    if kind == "random_search":  # which learns nothing
        assert narrow == wide
    else:
        assert narrow != wide


@pytest.mark.parametrize("kind", STEADY)
def test_the_first_candidates_are_those_of_a_generation(kind: str) -> None:
    genomes, _ = run(kind, servers=1, speed=1)
    first = new(kind).ask()
    assert genomes[: len(first)] == [genome.tobytes() for genome in first]


def test_random_search_is_the_same_either_way() -> None:
    method = new("random_search", generations=3)
    asked = []
    while not method.done:
        genomes = method.ask()
        asked += [genome.tobytes() for genome in genomes]
        method.tell(np.zeros(len(genomes)))
    assert run("random_search", servers=2, speed=1)[0] == asked


def test_cea2d_gets_better() -> None:
    method = new("cea2d", operation="steady_state", generations=20, width=5, height=5)
    best = []
    while not method.done:
        _, genome = method.ask_next()
        method.tell_next(-float(sphere(genome[np.newaxis].astype(np.float64))[0]))
        best.append(np.nanmax(method.population_fitness))
    assert best == sorted(best)
    assert best[-1] > best[24] / 4


def test_out_of_turn() -> None:
    method = new("random_search", operation="steady_state", in_flight=2, population=3, generations=1)
    with pytest.raises(InputError, match="no candidate is waiting for its fitness"):
        method.tell_next(1.0)
    with pytest.raises(InputError, match="use ask_next and tell_next"):
        method.ask()
    method.ask_next()
    method.ask_next()
    assert not method.can_ask
    with pytest.raises(InputError, match=r"2 candidate\(s\) are in flight; tell the fitness of candidate 0"):
        method.ask_next()
    method.tell_next(1.0)
    method.ask_next()
    method.tell_next(1.0)
    with pytest.raises(InputError, match="no candidates remain"):
        method.ask_next()
    method.tell_next(1.0)
    assert method.done
    with pytest.raises(InputError, match="done after 1 generation"):
        method.ask_next()
    whole = new("random_search")
    with pytest.raises(InputError, match="operation is generational; use ask and tell"):
        whole.ask_next()
    with pytest.raises(InputError, match="operation is generational; use ask and tell"):
        whole.tell_next(1.0)


def test_a_method_that_cannot_says_why() -> None:
    with pytest.raises(
        InputError, match=r"method\.operation: cma_es cannot work in steady state: its distri"
    ):
        Experiment.from_mapping(
            {"simulation": "minisim", "method": {"kind": "cma_es", "operation": "steady_state"}}
        )
