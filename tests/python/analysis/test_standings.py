"""Points and ratings of a league: those of single games, and intervals over seeds."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swarmwright.analysis.standings import (
    Games,
    games_of_matches,
    games_on_side,
    rate,
    standings,
)
from swarmwright.methods.rankings.match_scores import score_matches


def league(players: int, seeds: int, seed: int, failing: float = 0.2) -> np.ndarray:
    """Return fitness of small whole numbers, so that there are draws; some matches fail."""
    random = np.random.default_rng(seed)
    fitness = random.integers(0, 3, (players, players, seeds, 2)).astype(np.float64)
    fitness[random.uniform(size=fitness.shape[:3]) < failing] = np.nan
    fitness[np.arange(players), np.arange(players)] = np.nan
    return fitness


sizes = st.tuples(st.integers(2, 5), st.integers(1, 4), st.integers(0, 10**6))


@settings(max_examples=30)
@given(sizes)
def test_points_and_ratings_are_those_of_single_games(size: tuple[int, int, int]) -> None:
    fitness = league(*size)
    players = size[0]
    legs = [(i, j) for i in range(players) for j in range(players) for _ in range(size[1]) if i != j]
    pairs = np.array(legs, dtype=np.intp)
    results = np.concatenate([fitness[i, j] for i in range(players) for j in range(players) if i != j])
    found = standings(games_of_matches(fitness))
    shares = score_matches("win_rate", players, pairs, results)
    ratings = score_matches("bradley_terry", players, pairs, results)
    np.testing.assert_allclose([standing.points for standing in found], shares, rtol=1e-12)
    np.testing.assert_allclose([standing.rating for standing in found], ratings, atol=1e-3)


@settings(max_examples=30)
@given(sizes, st.sampled_from([0, 1]))
def test_players_of_a_side_are_compared_with_the_same_opponent_and_seed(
    size: tuple[int, int, int], side: int
) -> None:
    fitness = league(*size)
    players, seeds, _ = size
    own = fitness[..., side] if side == 0 else fitness[..., side].swapaxes(0, 1)
    wins = np.zeros((players, players))
    for first in range(players):
        for second in range(players):
            for opponent in range(players):
                for seed in range(seeds):
                    wins[first, second] += own[first, opponent, seed] > own[second, opponent, seed]
    games = games_on_side(fitness, side)
    assert (games.wins.sum(axis=0) == wins).all()
    assert (games.draws == games.draws.swapaxes(1, 2)).all()
    assert all(np.diag(draws).sum() == 0 for draws in games.draws)


def test_who_won_all_games_is_first_and_has_a_finite_rating() -> None:
    fitness = np.full((3, 3, 4, 2), np.nan)
    for first in range(3):
        for second in range(3):
            if first != second:
                fitness[first, second] = [-first, -second]
    found = standings(games_of_matches(fitness))
    assert [(each.wins, each.draws, each.losses) for each in found] == [(16, 0, 0), (8, 0, 8), (0, 0, 16)]
    assert [each.points for each in found] == [1.0, 0.5, 0.0]
    assert found[0].rating > found[1].rating == pytest.approx(0, abs=1e-6)
    assert np.isfinite(found[0].rating)
    assert {each.rating_interval for each in found} == {None}  # the seeds make no difference


def test_without_games_there_is_no_rating() -> None:
    fitness = league(3, 2, 0, failing=0.0)
    fitness[2], fitness[:, 2] = np.nan, np.nan
    *_, last = standings(games_of_matches(fitness))
    assert (last.wins, last.draws, last.losses) == (0, 0, 0)
    assert np.isnan([last.points, last.rating]).all()
    assert last.rating_interval is None


def test_intervals_cover_the_rating_on_other_seeds() -> None:
    random = np.random.default_rng(3)
    strength = np.array([0.0, 0.5, 1.0])
    chance = 1 / (1 + np.exp(strength[np.newaxis] - strength[:, np.newaxis]))

    def played(seeds: int) -> Games:
        fitness = np.full((3, 3, seeds, 2), np.nan)
        for first in range(3):
            for second in range(3):
                if first != second:
                    won = random.uniform(size=seeds) < chance[first, second]
                    fitness[first, second] = np.stack([won, ~won], axis=1)
        return games_of_matches(fitness)

    truth = rate(played(20_000).points.sum(axis=0))
    covered = 0
    for _ in range(40):
        for standing, rating in zip(standings(played(40)), truth, strict=True):
            assert standing.rating_interval is not None
            low, high = standing.rating_interval
            covered += low <= rating <= high
    assert 0.85 < covered / 120 <= 1.0


def test_ratings_near_the_result_lead_to_it() -> None:
    points = np.random.default_rng(0).integers(0, 5, (6, 6)).astype(np.float64)
    np.fill_diagonal(points, 0)
    ratings = rate(points)
    for start in (ratings, ratings + 50.0, np.zeros(6)):
        np.testing.assert_allclose(rate(points, start), ratings, atol=1e-5)
