"""Aggregates of episodes."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmwright.common.arrays import best_first
from swarmwright.methods.rankings.absolute import Absolute, AbsoluteOptions

NUMBERS = st.floats(allow_nan=False, allow_infinity=False, min_value=-1e300, max_value=1e300)


@pytest.mark.parametrize(
    ("aggregate", "expected"), [("mean", 2.5), ("sum", 10.0), ("median", 2.0), ("worst", -1.0)]
)
def test_aggregates(aggregate: str, expected: float) -> None:
    ranking = Absolute(AbsoluteOptions.model_validate({"episodes": 4, "aggregate": aggregate}))
    assert ranking.score(np.array([[3.0, -1.0, 7.0, 1.0]])).tolist() == [expected]


@given(st.lists(NUMBERS, min_size=1, max_size=8), st.randoms())
def test_the_order_of_episodes_does_not_matter(values: list[float], random: object) -> None:
    shuffled = list(values)
    random.shuffle(shuffled)  # type: ignore[attr-defined]
    for aggregate in ("mean", "sum", "median", "worst"):
        ranking = Absolute(AbsoluteOptions.model_validate({"episodes": len(values), "aggregate": aggregate}))
        one, other = ranking.score(np.array([values])), ranking.score(np.array([shuffled]))
        assert one.tobytes() == other.tobytes()


@pytest.mark.slow
@pytest.mark.parametrize("aggregate", ["mean", "sum", "median", "worst", "quantile", "cvar"])
@given(st.data())
def test_arrays_and_single_candidates_have_the_same_fitness(aggregate: str, data: st.DataObject) -> None:
    count = data.draw(st.integers(1, 5))
    any_number = st.floats() | st.sampled_from([0.0, -0.0, 1e308, -1e308, math.nan])
    rows = data.draw(st.lists(st.lists(any_number, min_size=count, max_size=count), min_size=1, max_size=6))
    ranking = Absolute(AbsoluteOptions.model_validate({"episodes": count, "aggregate": aggregate}))
    together = ranking.score(np.array(rows))
    for row, fitness in zip(rows, together, strict=True):
        finite = all(map(math.isfinite, row))
        alone = ranking._score([row])[0] + 0.0 if finite else math.nan
        expected = alone if math.isfinite(alone) else math.nan
        assert repr(float(expected)) == repr(float(fitness))


def test_sums_are_exact_before_they_are_rounded() -> None:
    ranking = Absolute(AbsoluteOptions(episodes=3, aggregate="sum"))
    assert ranking.score(np.array([[1e100, 1.0, -1e100]])).tolist() == [1.0]


def test_failed_episodes_fail_the_candidate_alone() -> None:
    ranking = Absolute(AbsoluteOptions(episodes=2))
    scores = ranking.score(np.array([[1, 2], [np.nan, 2], [1, np.inf], [1e308, 1e308]]))
    assert scores[0] == 1.5
    assert np.isnan(scores[1:3]).all()
    overflowing = Absolute(AbsoluteOptions(episodes=2, aggregate="sum")).score(np.array([[1e308, 1e308]]))
    assert np.isnan(overflowing[0])


def test_zero_has_one_spelling() -> None:
    scores = Absolute(AbsoluteOptions()).score(np.array([[-0.0]]))
    assert math.copysign(1, scores[0]) == 1


def test_episodes_have_consecutive_seeds() -> None:
    assert Absolute(AbsoluteOptions(episodes=3)).seeds(40) == [40, 41, 42]


@given(st.lists(st.sampled_from([1.0, -1.0, 0.0, math.nan, 1e300]), max_size=12))
def test_order_is_stable_with_the_failed_ones_last(values: list[float]) -> None:
    order = best_first(np.array(values, dtype=np.float64)).tolist()
    assert order == sorted(
        range(len(values)),
        key=lambda index: (
            math.isnan(values[index]),
            -values[index] if values[index] == values[index] else 0,
        ),
    )
