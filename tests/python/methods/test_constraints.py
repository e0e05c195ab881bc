"""Constraints: feasible candidates first, for every method."""

import math
from collections import deque
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from swarmwright import InputError
from swarmwright.controllers.kinds.neat import GrowingNeat, NeatOptions
from swarmwright.methods import METHODS, Method
from swarmwright.methods._pareto import ParetoMethod
from swarmwright.methods.archive import dominates
from swarmwright.methods.constraints import Limits, is_infeasible, rank_feasible_first, sum_violations
from swarmwright.methods.map_elites import MapElites
from swarmwright.methods.novelty import Novelty
from tests.python.methods.functions import new, sphere

Numbers = NDArray[np.float64]

SMALL: dict[str, dict[str, Any]] = {
    "cea2d": {"width": 5, "height": 5},
    "cma_es": {"population": 20},
    "sep_cma_es": {"population": 20},
    "openai_es": {"population": 20},
    "evostick": {},
}
RANK_BASED = [
    kind
    for kind in sorted(METHODS.built_in)
    if kind not in {"neat", "racing"} and not METHODS.get(kind).ranks_violations
]

finite = st.floats(-1e12, 1e12, allow_subnormal=False)


def method_of(kind: str, **options: Any) -> Method:
    """A small method of a kind, if it has a population."""
    known = METHODS.get(kind).options_model.model_fields
    small = SMALL.get(kind, {"population": 20} if "population" in known else {})
    small = {name: value for name, value in small.items() if name in known}
    return new(kind, **small, **options)


def measure(genomes: NDArray[np.float32]) -> tuple[Numbers, Numbers]:
    """Fitness, best at 1, 1, .., and the violation of the limit of the first gene, 0."""
    points = genomes.astype(np.float64)
    return -sphere(points - 1.0), np.maximum(points[:, 0], 0.0)


@given(
    st.lists(st.tuples(finite, st.one_of(st.just(0.0), st.floats(0, 1e30), st.just(math.inf))), min_size=2)
)
def test_scores_have_the_order_of_deb(candidates: list[tuple[float, float]]) -> None:
    fitness, violations = np.array(candidates).T
    scores = rank_feasible_first(fitness, violations)
    assert np.isfinite(scores**2).all()
    assert (is_infeasible(scores) == (violations > 0)).all()
    better = (violations[:, None] == 0) & (violations > 0)
    better |= (violations[:, None] == 0) & (violations == 0) & (fitness[:, None] > fitness)
    assert (scores[:, None] > scores)[better].all()
    worse = (violations[:, None] > 0) & (violations > violations[:, None])
    assert (scores[:, None] >= scores)[worse].all()


def test_failed_candidates_stay_failed() -> None:
    scores = rank_feasible_first(np.array([np.nan, np.nan, 1.0]), np.array([0.0, 3.0, 0.0]))
    assert np.isnan(scores[:2]).all()
    assert scores[2] == 1.0


@pytest.mark.parametrize(
    ("limits", "value", "violation"),
    [
        ({"at_most": 4}, 4.0, 0.0),
        ({"at_most": 4}, 5.0, 0.25),
        ({"at_most": -4}, -3.0, 0.25),
        ({"at_least": 2}, 1.0, 0.5),
        ({"at_most": 0}, 3.0, 3.0),
        ({"at_least": 1, "at_most": 2}, 1.5, 0.0),
        ({"at_least": 1, "at_most": 2}, 3.0, 0.5),
        ({"at_most": 1}, math.nan, math.inf),
        ({"at_most": 1e-300}, 1e300, math.inf),
    ],
)
def test_violations_are_in_units_of_the_limit(
    limits: dict[str, float], value: float, violation: float
) -> None:
    (measured,) = Limits.model_validate(limits).violations(np.array([value]))
    assert measured == violation


@given(finite, finite, st.booleans())
def test_a_violation_is_0_exactly_if_the_limit_is_met(limit: float, value: float, lower: bool) -> None:
    limits = Limits.model_validate({"at_least" if lower else "at_most": limit})
    values = np.array([value, np.nextafter(limit, np.inf), np.nextafter(limit, -np.inf), limit])
    assert ((limits.violations(values) == 0) == limits.meets(values)).all()


def test_violations_add_up() -> None:
    constraints = {"hits": Limits(at_most=0), "area": Limits(at_least=2)}
    metrics = np.array([[0.0, 2.0], [1.0, 1.0], [0.0, np.nan]])
    assert sum_violations(constraints, metrics).tolist() == [0.0, 1.5, math.inf]


@pytest.mark.parametrize("kind", RANK_BASED)
def test_only_the_order_of_scores_matters(kind: str) -> None:
    """Violations have the effect of any fitness with the same order, in all generations."""
    methods = [method_of(kind, generations=12) for _ in range(2)]
    infeasible = 0
    while not methods[0].done:
        genomes, others = (method.ask() for method in methods)
        assert genomes.tobytes() == others.tobytes()
        fitness, violations = measure(genomes)
        infeasible += int((violations > 0).sum())
        methods[0].tell(fitness, violations=violations)
        methods[1].tell(np.where(violations > 0, -1e6 * (1 + violations), fitness))
    assert 0 < infeasible < methods[0].evaluations


@pytest.mark.parametrize("kind", [kind for kind in RANK_BASED if METHODS.get(kind).steady_state])
def test_only_the_order_of_scores_matters_in_steady_state(kind: str) -> None:
    methods = [method_of(kind, generations=6, operation="steady_state", in_flight=3) for _ in range(2)]
    pending: deque[NDArray[np.float32]] = deque()
    while not methods[0].done:
        while methods[0].can_ask:
            genomes = [method.ask_next()[1] for method in methods]
            assert genomes[0].tobytes() == genomes[1].tobytes()
            pending.append(genomes[0])
        (fitness,), (violation,) = measure(pending.popleft()[np.newaxis])
        methods[0].tell_next(fitness, violation=violation)
        methods[1].tell_next(-1e6 * (1 + violation) if violation else fitness)


@pytest.mark.parametrize("kind", ["nnga", "de", "pso", "cma_es", "snes", "xnes", "cea2d"])
def test_it_comes_near_a_constrained_optimum(kind: str) -> None:
    """The least sphere around 1, 1, .. with a first gene of at most 0 has the value 1."""
    method = method_of(kind, generations=200)
    best = -math.inf
    while not method.done:
        fitness, violations = measure(method.ask())
        best = max(best, float(fitness[violations == 0].max(initial=-math.inf)))
        method.tell(fitness, violations=violations)
    assert -1.5 < best <= -1.0


def test_species_of_neat_share_the_fitness_of_feasible_members() -> None:
    growing = GrowingNeat(NeatOptions(), sensors=2, actuators=1)
    methods = [new("neat", subject=growing, population=40, generations=8, threshold=0.5) for _ in range(2)]
    while not methods[0].done:
        genomes, others = (method.ask() for method in methods)
        assert genomes.tobytes() == others.tobytes()
        fitness = -np.abs(np.nan_to_num(genomes.astype(np.float64), posinf=0, neginf=0)).sum(axis=1) - 100
        numbers = np.arange(len(fitness))
        infeasible = numbers % 3 == 0
        # Both have the same order, but not the same sums over species.
        methods[0].tell(fitness, violations=np.where(infeasible, 1.0 + numbers, 0.0))
        methods[1].tell(fitness, violations=np.where(infeasible, 1.5**numbers, 0.0))


def test_a_target_is_reached_by_feasible_candidates_alone() -> None:
    method = method_of("snes", generations=5, target=-5.0)
    count = len(method.ask())
    method.tell(np.zeros(count), violations=np.full(count, 0.1))
    assert not method.done
    method.ask()
    violations = np.full(count, 0.1)
    violations[-1] = 0.0
    method.tell(np.zeros(count), violations=violations)
    assert method.done


@pytest.mark.parametrize(
    ("violations", "words"),
    [([0.0], "shape"), ([-1.0] * 20, "must not be negative"), ([math.nan] * 20, "or NaN")],
)
def test_wrong_violations_are_refused(violations: list[float], words: str) -> None:
    method = method_of("snes")
    method.ask()
    with pytest.raises(InputError, match=words):
        method.tell(np.zeros(20), violations=violations)


@pytest.mark.parametrize("kind", ["nsga2", "nsga3"])
def test_fronts_have_constrained_domination(kind: str) -> None:
    method = new(kind, population=20, generations=40, objectives={"other": "minimize"})
    assert isinstance(method, ParetoMethod)
    feasible: list[Numbers] = []
    while not method.done:
        points = method.ask().astype(np.float64)
        costs = np.column_stack([sphere(points), sphere(points - 1.0)])
        violations = np.maximum(0.8 - points[:, 0], 0.0)
        method.tell(-costs[:, 0], metrics=costs[:, 1:], violations=violations)
        feasible.append(costs[violations == 0])
        values = method._values
        infeasible = is_infeasible(values[:, 0])
        told = np.concatenate(feasible)
        assert (~infeasible).sum() == min(20, len(np.unique(told, axis=0)))
        assert dominates(values)[np.ix_(~infeasible, infeasible)].all()
        assert np.isnan(method.population_fitness[infeasible]).all()
    first = method._members[:, 0]
    assert (first >= 0.8).all()
    assert sphere(method._members.astype(np.float64)).min() < 3


def test_infeasible_candidates_are_no_elites() -> None:
    method = new("map_elites", population=30, generations=10, measures={"x": {"range": [-3, 3], "bins": 10}})
    assert isinstance(method, MapElites)
    number = 0
    feasible = set()
    while not method.done:
        points = method.ask().astype(np.float64)
        violations = np.maximum(points[:, 1], 0.0)
        feasible |= {number + int(row) for row in np.flatnonzero(violations == 0)}
        number += len(points)
        method.tell(-sphere(points), metrics=points[:, :1], violations=violations)
        assert {*method.archive.numbers.tolist()} <= feasible
    assert len(method.archive) > 3


def test_novelty_prefers_feasible_candidates() -> None:
    method = new("novelty", population=20, generations=30, measures={"x": {"range": [-3, 3]}})
    assert isinstance(method, Novelty)
    while not method.done:
        points = method.ask().astype(np.float64)
        method.tell(-sphere(points), metrics=points[:, :1], violations=np.maximum(points[:, 1], 0.0))
    elite = method.survivors()[: method.options.shares().elite]
    assert len(elite) > 2
    assert (elite[:, 1] <= 0).all()
