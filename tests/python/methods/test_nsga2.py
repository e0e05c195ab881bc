"""NSGA-II: that it finds fronts, keeps the best trade-offs, and copes with failures."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from pymoo.indicators.hv import Hypervolume

from swarmwright import InputError
from swarmwright.controllers import REPRESENTATIONS
from swarmwright.methods.archive import ranks
from swarmwright.methods.nsga2 import Nsga2
from tests.python.methods.functions import new, sphere

OBJECTIVES = {"other": "minimize"}


def both(points: NDArray[np.float32]) -> NDArray[np.float64]:
    """Schaffer's problem in ten dimensions: squared distances from two points, both to be small."""
    genes = points.astype(np.float64)
    return np.column_stack([sphere(genes), sphere(genes - 1.0)])


def volume(costs: NDArray[np.float64]) -> float:
    return float(Hypervolume(ref_point=np.array([20.0, 20.0]))(costs[ranks(-costs) == 0]))


def evolved(seed: int, generations: int = 60) -> Nsga2:
    method = new("nsga2", seed=seed, population=40, generations=generations, objectives=OBJECTIVES)
    assert isinstance(method, Nsga2)
    while not method.done:
        costs = both(method.ask())
        method.tell(-costs[:, 0], metrics=costs[:, 1:])
    return method


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_it_comes_near_the_front_and_covers_it(seed: int) -> None:
    """The front is the line between both points: squared distances 10 t^2 and 10 (1 - t)^2."""
    share = np.linspace(0, 1, 200)
    ideal = volume(10 * np.column_stack([share**2, (1 - share) ** 2]))
    members = evolved(seed)._members
    costs = both(members)
    assert volume(costs) > 0.9 * ideal
    assert costs[:, 0].min() < 1.5
    assert costs[:, 1].min() < 1.5
    rest = new("random_search", seed=seed, population=40 * 60)
    assert volume(both(rest.ask())) < 0.7 * volume(costs)


def test_no_child_that_was_better_is_lost() -> None:
    method = new("nsga2", population=10, generations=30, objectives=OBJECTIVES)
    assert isinstance(method, Nsga2)
    told = np.empty((0, 2))
    while not method.done:
        costs = both(method.ask())
        told = np.concatenate([told, costs])
        method.tell(-costs[:, 0], metrics=costs[:, 1:])
        ends = both(method._members)
        assert ends[:, 0].min() == told[:, 0].min()
        assert ends[:, 1].min() == told[:, 1].min()
        assert len(method._members) == 10


def test_no_child_equals_a_member_or_another_child() -> None:
    layered = REPRESENTATIONS.get("layered")
    few = layered(layered.options_model(hidden=[]), sensors=4, actuators=1)  # type: ignore[call-arg]
    method = new("nsga2", subject=few, population=50, generations=15, objectives=OBJECTIVES)
    assert isinstance(method, Nsga2)
    while not method.done:
        members = method._members
        children = method.ask()
        every = np.concatenate([members, children])
        assert len(np.unique(every, axis=0)) == len(every)
        costs = both(children)
        method.tell(-costs[:, 0], metrics=costs[:, 1:])


def test_children_without_mutations_can_be_copies() -> None:
    still: dict[str, Any] = {"variation": "representation", "probability": 0, "crossover": 0}
    method = new("nsga2", population=6, generations=3, objectives=OBJECTIVES, **still)
    first = {one.tobytes() for one in method.ask()}
    method.tell(np.arange(6.0), metrics=np.zeros((6, 1)))
    assert {one.tobytes() for one in method.ask()} <= first


def test_candidates_that_failed_stay_only_while_there_is_nothing_better() -> None:
    method = new("nsga2", population=6, objectives={"a": "maximize", "b": "minimize"})
    method.ask()
    metrics = np.zeros((6, 2))
    metrics[1, 0] = np.nan
    method.tell(np.array([np.nan, 1.0, 2.0, 3.0, np.nan, np.nan]), metrics=metrics)
    assert np.isfinite(method.population_fitness).sum() == 3
    method.ask()
    method.tell(np.arange(6.0), metrics=np.zeros((6, 2)))
    assert np.isfinite(method.population_fitness).all()


def test_every_candidate_may_fail() -> None:
    method = new("nsga2", population=4, objectives=OBJECTIVES)
    for _ in range(3):
        method.ask()
        method.tell(np.full(4, np.nan), metrics=np.full((4, 1), np.nan))


def test_goals_turn_signs() -> None:
    options = new("nsga2", objectives={"a": "maximize", "b": "minimize"}).options
    assert options.needed_metrics == ("a", "b")
    values = options.values(np.array([1.0]), np.array([[2.0, 3.0]]))  # type: ignore[attr-defined] # of Nsga2Options
    assert values.tolist() == [[1.0, 2.0, -3.0]]


@pytest.mark.parametrize("metrics", [None, np.zeros((4, 2)), np.zeros(4)])
def test_telling_it_needs_metrics_of_the_right_shape(metrics: Any) -> None:
    method = new("nsga2", population=4, objectives=OBJECTIVES)
    method.ask()
    with pytest.raises(InputError, match="metrics"):
        method.tell(np.zeros(4), metrics=metrics)
