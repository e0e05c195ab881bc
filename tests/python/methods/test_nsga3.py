"""NSGA-III: its directions, the scale of its objectives, and the fronts that it finds."""

from typing import Any

import numpy as np
import pytest
from pymoo.indicators.hv import Hypervolume
from pymoo.util.ref_dirs import get_reference_directions

from benchmarks.against_pymoo import Case
from swarmwright import InputError
from swarmwright.methods.archive import ranks
from swarmwright.methods.nsga3 import Nsga3, Nsga3Options, count_directions, solve
from tests.python.methods.functions import new

OBJECTIVES = {"b": "minimize", "c": "maximize"}


@pytest.mark.parametrize(("objectives", "partitions"), [(2, 7), (3, 12), (5, 4)])
def test_the_directions_are_those_of_das_and_dennis(objectives: int, partitions: int) -> None:
    names = {f"f{number}": "minimize" for number in range(1, objectives)}
    options = Nsga3Options(objectives=names, partitions=partitions, population=4000)  # type: ignore[arg-type]
    expected = get_reference_directions("das-dennis", objectives, n_partitions=partitions)
    assert {tuple(row) for row in options.directions.tolist()} == {tuple(row) for row in expected.tolist()}
    assert len(options.directions) == count_directions(objectives, partitions)


def test_as_many_directions_as_members_by_default() -> None:
    options = Nsga3Options(objectives={"b": "minimize", "c": "minimize"}, population=92)
    assert len(options.directions) == 91
    assert Nsga3Options().directions.tolist() == [[1.0]]
    with pytest.raises(InputError, match=r"method\.partitions: 13 makes 105 reference directions .* \(92\)"):
        new("nsga3", objectives=OBJECTIVES, population=92, partitions=13)


def test_equations() -> None:
    drawn = np.random.default_rng(1)
    for size in (1, 2, 5, 9):
        matrix, right = drawn.normal(size=(size, size)), drawn.normal(size=size)
        found = solve(matrix, right)
        assert found is not None
        assert found == pytest.approx(np.linalg.solve(matrix, right))
    assert solve(np.array([[0.0, 2.0], [4.0, 0.0]]), np.ones(2)) == pytest.approx([0.25, 0.5])
    assert solve(np.array([[1.0, 2.0], [2.0, 4.0]]), np.ones(2)) is None
    assert solve(np.zeros((2, 2)), np.ones(2)) is None


def volume(costs: Any) -> float:
    return float(Hypervolume(ref_point=np.full(3, 20.0))(costs[ranks(-costs) == 0]))


def costs_of(points: Any) -> Any:
    """Squared distances from three points, the last 100 times as large."""
    values = points.astype(np.float64)
    centers = np.zeros((3, 10))
    centers[1, :5], centers[2, 5:] = 1.0, 1.0
    return np.stack([((values - center) ** 2).sum(axis=1) for center in centers], axis=1) * [1, 1, 100]


@pytest.mark.parametrize("seed", [1, 2])
def test_members_are_spread_over_a_front_whatever_its_scale(seed: int) -> None:
    method = new("nsga3", seed=seed, population=40, generations=100, objectives=OBJECTIVES)
    assert isinstance(method, Nsga3)
    while not method.done:
        costs = costs_of(method.ask())
        method.tell(-costs[:, 0], metrics=np.stack([costs[:, 1], -costs[:, 2]], axis=1))
    costs = costs_of(method._members) / [1, 1, 100]
    rest = costs_of(new("random_search", seed=seed, population=4000).ask()) / [1, 1, 100]
    assert volume(costs) > 1.2 * volume(rest)
    assert (costs.min(axis=0) < 0.8).all()
    assert (costs.max(axis=0) > 3).all()


def test_failures_stay_only_while_there_is_nothing_better() -> None:
    method = new("nsga3", population=6, objectives=OBJECTIVES)
    method.ask()
    method.tell(np.full(6, np.nan), metrics=np.zeros((6, 2)))
    method.ask()
    metrics = np.zeros((6, 2))
    metrics[1, 0] = np.nan
    method.tell(np.array([np.nan, 1.0, 2.0, 3.0, np.nan, np.nan]), metrics=metrics)
    assert np.isfinite(method.population_fitness).sum() in (2, 3)  # of one the metric is missing
    method.ask()
    method.tell(np.arange(6.0), metrics=np.zeros((6, 2)))
    assert np.isfinite(method.population_fitness).all()


@pytest.mark.slow
@pytest.mark.parametrize(
    "case",
    [
        Case("nsga2", "zdt1", 2, 40, 100),
        Case("nsga2", "zdt3"),
        Case("nsga3", "dtlz2", 3, 92, 100, 12),
    ],
)
def test_hypervolumes_are_those_of_pymoo(case: Case) -> None:
    """Within 1 %, in the mean over five seeds."""
    ours, theirs = (np.mean([run(seed) for seed in range(1, 6)]) for run in (case.ours, case.theirs))
    assert ours > 0.99 * theirs
