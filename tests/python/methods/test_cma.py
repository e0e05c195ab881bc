"""CMA-ES through `ask` and `tell` is what the library does alone; restarts; what it refuses."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import cma
import numpy as np
import pytest

from swarmwright.methods import METHODS
from swarmwright.methods._cma import Cma, Regimes
from swarmwright.typing import Genomes
from tests.python.methods.functions import (
    FUNCTIONS,
    Function,
    conversation,
    evaluations_to,
    new,
    rastrigin,
    rosenbrock,
    sphere,
    ten_genes,
)

KINDS = {"cma_es": False, "sep_cma_es": True}
REACH = 3.0


@contextmanager
def numpy_left_as_it_was() -> Iterator[None]:
    before = np.random.get_state()  # noqa: NPY002 - the library uses it
    try:
        yield
    finally:
        np.random.set_state(before)  # noqa: NPY002


def library(seed: int, **options: Any) -> Any:
    settings = {"seed": seed, "CMA_stds": np.full(10, REACH), "verbose": -9, "verb_log": 0, **options}
    return cma.CMAEvolutionStrategy(np.zeros(10), 0.5, settings)


def alone(search: Any, function: Function, generations: int, *, rounding: bool = True) -> list[Genomes]:
    asked: list[Genomes] = []
    while not search.stop() and len(asked) < generations:
        points = search.ask()
        genomes = np.stack(points).astype(np.float32)
        asked.append(genomes)
        values = function(genomes.astype(np.float64) if rounding else np.stack(points))
        search.tell(points, values.tolist())
    return asked


@pytest.mark.parametrize("function", FUNCTIONS, ids=lambda function: function.__name__)
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_genomes_are_those_of_the_library_alone(kind: str, function: Function, seed: int) -> None:
    with numpy_left_as_it_was():
        theirs = alone(library(seed, CMA_diagonal=KINDS[kind]), function, 150)
    ours = conversation(new(kind, seed=seed), function, len(theirs))
    assert len(theirs) > 60
    assert [genomes.tobytes() for genomes in ours] == [genomes.tobytes() for genomes in theirs]


def test_populations_and_steps_are_the_librarys() -> None:
    with numpy_left_as_it_was():
        theirs = alone(library(5, popsize=24), rosenbrock, 40)
    ours = conversation(new("cma_es", seed=5, population=24), rosenbrock, 40)
    assert [genomes.tobytes() for genomes in ours] == [genomes.tobytes() for genomes in theirs]
    assert len(new("cma_es").ask()) == 4 + int(3 * np.log(10))
    # A step twice as large over half the range is the same.
    half = new("cma_es", seed=5, population=24, step=1.0, subject=ten_genes(REACH / 2))
    again = conversation(half, rosenbrock, 40)
    assert np.allclose(again[0], ours[0], rtol=1e-6)


@pytest.mark.parametrize(("function", "target"), [(sphere, 1e-9), (rosenbrock, 1e-6)])
def test_rounding_to_binary32_costs_nothing(function: Function, target: float) -> None:
    """The library alone, in binary64 all through, needs as many evaluations, within a tenth."""
    ours, theirs = [], []
    for seed in range(1, 8):
        found = evaluations_to(new("cma_es", seed=seed, generations=2000), function, target)
        assert found is not None
        ours.append(found)
        with numpy_left_as_it_was():
            search, evaluations, reached = library(seed), 0, False
            while not reached:
                points = search.ask()
                values = function(np.stack(points))
                reached = bool((values <= target).any())
                evaluations += int(np.argmax(values <= target)) + 1 if reached else len(points)
                search.tell(points, values.tolist())
        theirs.append(evaluations)
    assert np.median(ours) == pytest.approx(np.median(theirs), rel=0.1)


@pytest.mark.parametrize("restart", ["ipop", "bipop"])
def test_restarts_leave_the_dent_in_which_one_start_ends(restart: str) -> None:
    def least(seed: int, restart: str) -> float:
        method = new("cma_es", seed=seed, generations=1000, restart=restart)
        asked = np.concatenate(conversation(method, rastrigin, 1_000_000))
        return float(rastrigin(asked.astype(np.float64)).min())

    seeds = range(1, 3)
    assert sum(least(seed, restart) for seed in seeds) < 0.6 * sum(least(seed, "none") for seed in seeds)


@pytest.mark.parametrize("restart", ["none", "ipop", "bipop"])
def test_the_whole_budget_is_used(restart: str) -> None:
    method = new("cma_es", generations=600, restart=restart)
    assert isinstance(method, Cma)
    sizes = [len(genomes) for genomes in conversation(method, sphere, 1_000_000)]
    assert method.done
    assert method.evaluations == sum(sizes)
    assert method.budget <= method.evaluations < method.budget + sizes[-1]
    if restart == "none":
        assert set(sizes) == {10}
        assert len(sizes) == 600
    else:
        assert method.starts > 2
        assert {10, 20} <= set(sizes)


def test_a_plateau_is_left_by_a_new_start() -> None:
    method = new("cma_es", generations=50)
    assert isinstance(method, Cma)
    while not method.done:
        method.tell(np.zeros(len(method.ask())))
    assert method.starts > 2


def test_bipop_gives_small_and_large_populations_the_same() -> None:
    regimes = Regimes("bipop", 10)
    regimes.spent(1000)
    spent = {True: 1000, False: 0}
    for turn in range(12):
        population, share = regimes.begin(0.5, 0.5, left=10**9)
        large = share == 1.0
        assert large == (spent[True] >= spent[False])
        evaluations = 100 * population
        regimes.spent(evaluations)
        spent[not large] += evaluations
        assert population >= 10, turn
    # A small start ends when it has had half of what large ones had.
    while regimes.begin(0.5, 0.5, left=10**9)[1] == 1.0:
        regimes.spent(10)
    assert not regimes.over
    regimes.spent(10**6)
    assert regimes.over


def test_no_population_is_larger_than_what_is_left_of_the_budget() -> None:
    regimes = Regimes("ipop", 10)
    assert regimes.begin(0, 0, left=1000) == (20, 1.0)
    assert regimes.begin(0, 0, left=33) == (33, 1.0)
    assert regimes.begin(0, 0, left=4) == (10, 1.0)


def test_a_seed_may_be_larger_than_the_library_takes() -> None:
    large = [new("cma_es", seed=seed).ask().tobytes() for seed in (7, 7 + 2**32, 7 + 2**33, 2**63 - 1)]
    assert len(set(large)) == 4


def test_a_generation_that_failed_teaches_nothing() -> None:
    method = new("cma_es", seed=4)
    first = method.ask()
    method.tell(np.full(10, np.nan))
    second = method.ask()
    assert first.tobytes() != second.tobytes()
    # The same distribution, drawn from again: what the library gives when it is asked twice.
    with numpy_left_as_it_was():
        search = library(4)
        search.ask()
        theirs = np.stack(search.ask()).astype(np.float32)
    assert second.tobytes() == theirs.tobytes()


def test_failed_candidates_count_as_the_worst() -> None:
    judged, failed = new("cma_es", seed=4), new("cma_es", seed=4)
    for _ in range(20):
        genomes, same = judged.ask(), failed.ask()
        assert genomes.tobytes() == same.tobytes()
        fitness = -sphere(genomes.astype(np.float64))
        worst = int(np.argmin(fitness))
        judged.tell(fitness)
        fitness[worst] = np.nan
        failed.tell(fitness)


def test_a_matrix_for_which_there_is_no_room_is_refused() -> None:
    layered = ten_genes()
    large = type(layered)(layered.options_model(hidden=[1000]), sensors=9, actuators=1)  # type: ignore[call-arg]
    reason = METHODS.get("cma_es").unsuitable(large)
    assert reason is not None
    assert "11001 genes" in reason
    assert "sep_cma_es" in reason
    assert METHODS.get("sep_cma_es").unsuitable(large) is None
