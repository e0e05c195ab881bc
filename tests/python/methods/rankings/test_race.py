"""The ranking `race`: who is dropped, and what the fitness of the dropped is."""

import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from swarmwright.methods.rankings.race import Race, RaceOptions, _step_below, survivors
from swarmwright.testing import check_ranking


def race(episodes: int, **options: object) -> Race:
    return Race(RaceOptions.model_validate({"episodes": episodes, **options}))


def by_hand(episodes: NDArray[np.float64], ranking: Race) -> list[int]:
    """How many episodes each candidate goes through."""
    count, options = episodes.shape[1], ranking.options
    length = [count] * len(episodes)
    alive = list(range(len(episodes)))
    for done in range(1, count + 1):
        for one in [one for one in alive if not np.isfinite(episodes[one, done - 1])]:
            alive.remove(one)
            length[one] = done
        tested = done >= options.first_test and (done - options.first_test) % options.each_test == 0
        if tested and done < count and len(alive) > 1:
            kept = survivors(episodes[alive, :done].T, options.test, options.level)
            for one, stays in zip(list(alive), kept.tolist(), strict=True):
                if not stays:
                    alive.remove(one)
                    length[one] = done
    return length


def test_it_is_a_ranking() -> None:
    check_ranking("race")


@given(st.integers(0, 10**6), st.integers(1, 12), st.integers(1, 20), st.booleans())
@settings(max_examples=80)
def test_what_every_race_gives(seed: int, count: int, episodes: int, fails: bool) -> None:
    rng = np.random.default_rng(seed)
    ranking = race(episodes, each_test=int(rng.integers(1, 4)), test=str(rng.choice(["friedman", "t_holm"])))
    seeds = rng.normal(size=episodes) * 3
    values = rng.normal(size=(count, 1)) * 3 + seeds + rng.normal(size=(count, episodes))
    if fails:
        values[rng.random(values.shape) < 0.05] = np.nan
    lengths = by_hand(values, ranking)
    asked = np.zeros((count, episodes), dtype=np.int64)
    rounds = ranking.rounds(count)
    try:
        who, which = next(rounds)
        while True:
            asked[who, which] += 1
            who, which = rounds.send(values[who, which])
    except StopIteration as end:
        fitness = end.value
    # A round in which an episode failed is finished all the same.
    for one, length in enumerate(lengths):
        failed = ~np.isfinite(values[one, :length]).all()
        assert asked[one].max() == 1
        went = int(asked[one].sum())
        assert (asked[one, :went] == 1).all()
        assert went == length or (failed and went >= length)
        assert np.isnan(fitness[one]) == failed
    # What is not gone through does not count, and what is stored is enough to make the same again.
    kept = np.where(asked == 1, values, np.nan)
    assert ranking.score(values).tobytes() == fitness.tobytes()
    assert ranking.score(kept).tobytes() == fitness.tobytes()
    whole = [one for one in range(count) if lengths[one] == episodes and np.isfinite(values[one]).all()]
    for one in whole:
        assert fitness[one] == pytest.approx(values[one].mean())
    worked = [one for one in range(count) if np.isfinite(fitness[one])]
    for one in worked:
        for other in worked:
            if lengths[one] < lengths[other]:
                assert fitness[one] < fitness[other], "who is dropped earlier ranks below"


def test_easy_seeds_do_not_count() -> None:
    """All are better on the first five seeds; those that are dropped then must not look good by that."""
    values = np.zeros((4, 10))
    values += np.array([[0], [-1], [-2], [-3]])
    values[:, :5] += 100
    fitness = race(10).score(values)
    assert fitness[0] == pytest.approx(50)
    assert fitness[3] == pytest.approx(47)
    assert (np.diff(fitness) < 0).all()


def test_if_all_that_are_left_fail_the_others_are_ranked_as_they_are() -> None:
    rng = np.random.default_rng(2)
    values = np.array([[0.0], [-10.0], [-20.0], [-30.0]]) + rng.normal(size=(4, 12))
    values[0, 11] = np.nan
    fitness = race(12).score(values)
    assert np.isnan(fitness[0])
    assert np.isfinite(fitness[1:]).all()
    assert (np.diff(fitness[1:]) < 0).all()
    values[:] = np.nan
    assert np.isnan(race(12).score(values)).all()


def test_with_few_episodes_it_is_the_mean() -> None:
    values = np.random.default_rng(1).normal(size=(7, 5))
    assert race(5).score(values) == pytest.approx(values.mean(axis=1))
    assert race(1).score(values[:, :1]).tolist() == values[:, 0].tolist()
    assert race(3).samples([1.0, 2.0, 4.0, 8.0]).tolist() == [1, 2, 4, 8]


def test_values_of_any_size() -> None:
    huge = np.array([[1e308] * 12, [1.7e308] * 12, [-1e308] * 12, [5.0] * 12])
    fitness = race(12).score(huge)
    assert not np.isinf(fitness).any()


def test_who_was_dropped_has_not_the_fitness_of_one_that_was_not() -> None:
    """One that was kept fails to solve the last episode, so that it is worse than the corrected others."""
    ranking = race(6)
    kept = np.array([[3.0, 2, 3, 2, 3, 3], [2.0, 3, 2, 3, 2, -90]])
    for scale in (1.0, 1e-320, 1e300):
        values = np.concatenate([kept, np.repeat([[0.0], [-1.0]], 6, axis=1)]) * scale
        assert ranking.count_episodes(values).tolist() == [6, 6, 5, 5]
        fitness = ranking.score(values)
        assert fitness[0] > fitness[1] > fitness[2:].max()
    assert _step_below(0.0) == -5e-324
    assert _step_below(-sys.float_info.max) == -sys.float_info.max
    assert _step_below(np.inf) == np.inf
    assert _step_below(-np.inf) == -np.inf


@pytest.mark.parametrize("test", ["friedman", "t", "t_holm", "t_bonferroni"])
@pytest.mark.parametrize("count", [1, 2, 6])
def test_huge_fitness_is_no_failure(test: str, count: int) -> None:
    ranking = race(8, test=test, first_test=3)
    huge = np.random.default_rng(3).uniform(1.6e308, sys.float_info.max, (count, 8))
    for values in (huge, -huge, huge * np.where(np.arange(8) % 2, 1, -1)):
        assert np.isfinite(ranking.score(values)).all()
        assert np.isfinite(ranking.score(values * 2.0**-10)).all()
    apart = np.vstack([huge, -huge])
    fitness = ranking.score(apart)
    assert np.isfinite(fitness).all()
    assert fitness[:count].min() > fitness[count:].max()
    assert (
        ranking.count_episodes(apart)[count:].tolist()
        == ranking.count_episodes(apart * 2.0**-700)[count:].tolist()
    )
    failing = np.where(np.arange(8) == 1, np.nan, huge)
    assert np.isnan(ranking.score(failing)).all()
