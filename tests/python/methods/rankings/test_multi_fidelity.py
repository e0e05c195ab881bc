"""The ranking `multi_fidelity`: who is evaluated in the slow simulation, and the fitness of the others."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from pydantic import ValidationError

from swarmwright.methods.rankings.multi_fidelity import MultiFidelity, MultiFidelityOptions
from swarmwright.methods.rankings.slow_simulation import Ranked
from swarmwright.testing import check_ranking

Values = NDArray[np.float64]


def ranking(**options: object) -> MultiFidelity:
    return MultiFidelity(MultiFidelityOptions.model_validate({"slow": "gazebo", **options}))


def chosen(one: MultiFidelity, fast: Values, slow: Values) -> tuple[list[list[int]], Values]:
    """Who is evaluated in the slow simulation, round by round, and the fitness that comes of it."""
    rounds = one.rounds(fast, np.empty((*fast.shape, 0)))
    found = []
    try:
        who = next(rounds)
        while True:
            found.append(who.tolist())
            who = rounds.send(slow[who])
    except StopIteration as end:
        ranked: Ranked = end.value
        return found, ranked.fitness


def test_it_conforms() -> None:
    check_ranking("multi_fidelity")


def test_the_law_by_hand() -> None:
    one = ranking(share=0.4)
    fast = np.array([[1.0, 3.0], [6.0, 8.0], [4.0, 4.0], [9.0, 9.0], [math.nan, 9.0]])
    slow = np.array([[0.0, 0.0], [5.0, 5.0], [9.0, 9.0], [3.0, 4.0], [9.0, 9.0]])
    who, fitness = chosen(one, fast, slow)
    assert who == [[1, 3]]
    correction = ((5 - 7) + (3.5 - 9)) / 2
    assert fitness[:4].tolist() == [2 + correction, 5.0, 4 + correction, 3.5]
    assert math.isnan(fitness[4])


def test_those_that_were_not_evaluated_there_stay_below_the_best_that_was() -> None:
    one = ranking(share=0.01)
    one.learn([-6.0])
    fast = np.array([[6.0], [5.0], [5.0], [4.9], [0.0]])
    _, fitness = chosen(one, fast, np.array([[-3.0], [0.0], [0.0], [0.0], [0.0]]))
    assert fitness[0] == -3.0
    assert fitness[4] == 0.0 + (-6.0 - 9.0) / 2
    assert fitness[0] > fitness[1] == fitness[2] > fitness[3] > -3.0 - 1e-8


def test_where_all_fail_there_the_next_best_are_evaluated() -> None:
    one = ranking(share=0.5)
    fast = np.array([[4.0], [3.0], [2.0], [1.0]])
    who, fitness = chosen(one, fast, np.array([[math.nan], [math.inf], [math.nan], [7.0]]))
    assert who == [[0, 1], [2, 3]]
    assert np.isnan(fitness[:3]).all()
    assert fitness[3] == 7.0
    who, fitness = chosen(one, fast, np.full((4, 1), math.nan))
    assert who == [[0, 1], [2, 3]]
    assert np.isnan(fitness).all()
    who, fitness = chosen(one, np.full((2, 1), math.nan), np.zeros((2, 1)))
    assert who == []
    assert np.isnan(fitness).all()


@pytest.mark.parametrize(("memory", "expected"), [(1, 3.0), (2, 2.0), (10, 1.0)])
def test_earlier_generations_correct_as_well(memory: int, expected: float) -> None:
    """Each has one candidate of both; it loses -1, 1 and 3, in this order."""
    one = ranking(share=0.5, memory=memory)
    for gain in (-1.0, 1.0):
        one.rank(np.array([[9.0], [0.0]]), np.array([[9.0 + gain], [np.nan]]), np.empty((2, 1, 0)))
    fitness = one.rank(np.array([[9.0], [0.0]]), np.array([[12.0], [np.nan]]), np.empty((2, 1, 0)))
    assert fitness.tolist() == [12.0, expected]


@pytest.mark.parametrize("seeds", ["same", "new"])
def test_with_new_seeds_only_the_own_generation_corrects(seeds: str) -> None:
    """The difference between the two simulations is that of the seeds."""
    one, none = ranking(share=0.2, seeds=seeds), np.empty((4, 1, 0))
    fast = np.array([[4.0], [3.0], [2.0], [1.0]])
    for difference in (2.0, -2.0, 2.0, -2.0):
        slow = np.array([[4.0 + difference], [np.nan], [np.nan], [np.nan]])
        fitness = one.rank(fast, slow, none)
        if seeds == "new":
            assert fitness.tolist() == (fast[:, 0] + difference).tolist()
    assert (fitness[1] == 3.0 - 2.0) == (seeds == "new")
    assert one.options.memory is None


@pytest.mark.slow
@given(st.data(), st.integers(1, 12), st.integers(1, 3), st.floats(0.01, 1))
def test_the_best_was_always_evaluated_there(
    data: st.DataObject, count: int, episodes: int, share: float
) -> None:
    one = ranking(share=share, episodes=episodes)
    values = st.one_of(st.floats(-1e6, 1e6), st.just(math.nan))
    for _ in range(3):
        fast, slow = (
            np.array(
                data.draw(st.lists(values, min_size=count * episodes, max_size=count * episodes))
            ).reshape(count, episodes)
            for _ in range(2)
        )
        who, fitness = chosen(one, fast, slow)
        measured = sorted(index for part in who for index in part)
        stored = np.full_like(slow, np.nan)
        stored[measured] = slow[measured]
        again = one.rank(fast, stored, np.empty((count, episodes, 0)))
        assert again.tobytes() == fitness.tobytes(), "of what is stored comes the same"
        working = np.isfinite(fast).all(axis=1)
        assert set(measured) <= set(np.flatnonzero(working).tolist())
        assert np.isnan(fitness[~working]).all()
        if np.isfinite(fitness).any():
            best = int(np.nanargmax(fitness))
            assert best in measured
            assert fitness[best] == pytest.approx(slow[best].mean(), abs=1e-6)
        first = min(one.count_transfers(count), int(working.sum()))
        assert len(measured) >= first
        if who:
            assert len(who[0]) == first
            left = np.setdiff1d(np.flatnonzero(working), who[0])
            if len(left):
                assert fast[left].mean(axis=1).max() <= fast[who[0]].mean(axis=1).min() + 1e-6


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"share": 0}, "greater than 0"),
        ({"share": 1.5}, "less than or equal to 1"),
        ({"memory": 0}, "greater than or equal to 1"),
        ({"slow": 3}, "must be a simulation, a file or a mapping of differing keys"),
        ({"slow": ""}, "must be a simulation, a file or a mapping of differing keys"),
        ({"reevaluate": True}, "from two simulations"),
    ],
)
def test_mistakes(options: dict[str, object], said: str) -> None:
    with pytest.raises(ValidationError, match=said):
        ranking(**options)
