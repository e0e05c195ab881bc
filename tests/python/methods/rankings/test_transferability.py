"""The ranking `transferability`: what is predicted of whom, who is evaluated in both simulations."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from pydantic import ValidationError

from swarmwright.methods._cma import Cma
from swarmwright.methods.rankings.slow_simulation import Ranked
from swarmwright.methods.rankings.transferability import Transferability, TransferabilityOptions
from swarmwright.testing import check_ranking
from tests.python.methods.functions import new, sphere

Values = NDArray[np.float64]


def ranking(**options: object) -> Transferability:
    return Transferability(
        TransferabilityOptions.model_validate({"slow": "gazebo", "threshold": 0.5, **options})
    )


def column(*values: float) -> Values:
    return np.array(values)[:, np.newaxis]


def chosen(
    one: Transferability, fast: Values, slow: Values, metrics: Values
) -> tuple[list[list[int]], Ranked]:
    """Who is evaluated in the slow simulation, round by round, and what comes of it."""
    rounds = one.rounds(fast, metrics)
    found = []
    try:
        who = next(rounds)
        while True:
            found.append(who.tolist())
            who = rounds.send(slow[who])
    except StopIteration as end:
        ranked: Ranked = end.value
        return found, ranked


def test_it_conforms() -> None:
    check_ranking("transferability")


def test_the_law_by_hand() -> None:
    """The first generation: the best, and the one that is farthest from it; the others are predicted."""
    one = ranking(transfers=2, threshold=1.0, weight=2.0)
    fast, slow = column(4, 3, 2, 1), column(1, 9, 9, 0.5)
    metrics = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 5.0], [4.0, 10.0]])[:, np.newaxis, :]
    who, ranked = chosen(one, fast, slow, metrics)
    assert who == [[0, 3]]
    known = [4 - 2 * (3 - 1), 1 - 2 * 0]
    # The ranges are 4 and 10: squared distances from the first and the last.
    near = {1: (1 / 16, 9 / 16 + 1), 2: (1 / 4, 1 + 1 / 4)}
    fitness = ranked.fitness.tolist()
    assert [fitness[0], fitness[3]] == known
    for index, (first, last) in near.items():
        disparity = (3 / first + 0.5 / last) / (1 / first + 1 / last)
        expected = fast[index, 0] - 2 * max(0.0, disparity - 1)
        assert fitness[index] == pytest.approx(min(expected, np.nextafter(max(known), -np.inf)))


def test_a_candidate_with_a_known_behaviour_has_its_disparity() -> None:
    one = ranking(transfers=1, threshold=0.0)
    one.rank(column(9), column(4), column(1)[:, :, np.newaxis])
    one.rank(column(9), column(8), column(2)[:, :, np.newaxis])
    metrics = column(1, 2, 3)[:, :, np.newaxis]
    _, ranked = chosen(one, column(3, 2, 9), column(0, 0, 8.5), metrics)
    assert ranked.fitness.tolist() == [3 - 5, 2 - 1, 8.5]


@pytest.mark.parametrize("apart", [0.0, 5e-324, 1e-160, 1e-120])
def test_of_those_almost_at_the_place_of_a_known_one_its_disparity_is_predicted(apart: float) -> None:
    one = ranking(transfers=1, threshold=0.0)
    fast, metrics = column(3, 2, 1), np.array([0.0, apart, 1.0])[:, np.newaxis, np.newaxis]
    who, ranked = chosen(one, fast, column(1, 9, 9), metrics)
    assert who == [[0]]
    assert ranked.fitness[0] - 3 == ranked.fitness[1] - 2 == -2


def test_only_some_generations_are_evaluated_in_both() -> None:
    one = ranking(transfers=1, every=3)
    fast, slow, metrics = column(1, 2, 3), column(0, 0, 0), column(0, 1, 2)[:, :, np.newaxis]
    counts = []
    for _ in range(7):
        who, ranked = chosen(one, fast, slow, metrics)
        counts.append(sum(map(len, who)))
        one.learn(ranked.learned)
    assert counts == [1, 0, 0, 1, 0, 0, 1]


def test_evolution_goes_on_between_two_transfers() -> None:
    """The slow simulation is as the fast one, so that rare transfers cost nothing."""
    one, method = ranking(every=10), new("cma_es", generations=200)
    assert isinstance(method, Cma)
    least = math.inf
    for _ in range(130):
        values = sphere(method.ask().astype(np.float64))
        least = min(least, float(values.min()))
        fast = -values[:, np.newaxis]
        method.tell(one.rank(fast, fast, np.empty((len(fast), 1, 0))))
    assert method.starts == 1
    assert least < 1e-6


def test_where_all_fail_in_the_slow_simulation_others_are_evaluated() -> None:
    one = ranking(transfers=2)
    fast, metrics = column(4, 3, 2, 1, math.nan), np.zeros((5, 1, 0))
    who, ranked = chosen(one, fast, column(math.nan, 3, math.inf, math.nan, 1), metrics)
    assert who == [[0, 3], [1, 2]]
    assert np.isnan(ranked.fitness[[0, 2, 3, 4]]).all()
    assert ranked.fitness[1] == 3
    who, ranked = chosen(one, fast, np.full((5, 1), math.nan), metrics)
    assert who == [[0, 3], [1, 2]]
    assert np.isnan(ranked.fitness).all()
    who, ranked = chosen(one, np.full((2, 1), math.nan), column(1, 2), metrics[:2])
    assert who == []
    assert np.isnan(ranked.fitness).all()


@pytest.mark.slow
@given(
    st.data(), st.integers(1, 8), st.integers(1, 2), st.integers(0, 2), st.integers(1, 3), st.integers(1, 3)
)
def test_the_best_of_a_run_was_evaluated_in_both(
    data: st.DataObject, count: int, episodes: int, size: int, transfers: int, every: int
) -> None:
    one, again = (ranking(transfers=transfers, every=every, episodes=episodes) for _ in range(2))
    values = st.one_of(st.floats(-1e6, 1e6), st.just(math.nan))
    finite = st.floats(-1e3, 1e3)
    best, was_measured = -math.inf, False
    for _ in range(5):
        fast, slow = (
            np.array(data.draw(st.lists(values, min_size=count * episodes, max_size=count * episodes)))
            .reshape(count, episodes)
            for _ in range(2)
        )  # fmt: skip
        total = count * episodes * size
        metrics = np.array(data.draw(st.lists(finite, min_size=total, max_size=total)), dtype=np.float64)
        metrics = metrics.reshape(count, episodes, size)
        who, ranked = chosen(one, fast, slow, metrics)
        one.learn(ranked.learned)
        measured = sorted(index for part in who for index in part)
        assert len(measured) == len(set(measured))
        stored = np.full_like(slow, np.nan)
        stored[measured] = slow[measured]
        assert again.rank(fast, stored, metrics).tobytes() == ranked.fitness.tobytes()
        assert np.isnan(ranked.fitness[~np.isfinite(fast).all(axis=1)]).all()
        if not np.isfinite(ranked.fitness).any():
            continue
        leader = int(np.nanargmax(ranked.fitness))
        if ranked.fitness[leader] > best:
            best, was_measured = float(ranked.fitness[leader]), leader in measured
    assert best == -math.inf or was_measured or not len(ranked.learned.disparities)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"threshold": -1}, "greater than or equal to 0"),
        ({"weight": 0}, "greater than 0"),
        ({"every": 0}, "greater than or equal to 1"),
        ({"transfers": 0}, "greater than or equal to 1"),
        ({"descriptor": "steps"}, "valid list"),
    ],
)
def test_mistakes(options: dict[str, object], said: str) -> None:
    with pytest.raises(ValidationError, match=said):
        ranking(**options)
    with pytest.raises(ValidationError, match="threshold"):
        TransferabilityOptions.model_validate({"slow": "gazebo"})
