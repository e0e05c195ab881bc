"""Scores of candidates in a tournament, from the results of their matches."""

import math
from collections.abc import Callable, Mapping
from typing import Final

import numpy as np
from numpy.typing import NDArray

from swarmwright.methods.rankings._pairing import Pairs, Results, points_of

__all__ = ["SCORES", "bradley_terry", "elo", "score_matches"]

Scores = NDArray[np.float64]

ELO_FACTOR: Final = 32.0
"""How many rating points a win against an equal opponent transfers, twice."""
_SCALE: Final = 400.0 / math.log(10.0)
"""Rating points in a unit of the logarithm of the odds, as in chess: 400 are odds of ten to one."""
_PRIOR: Final = 0.2
"""Draws with an average player that every player of bradley_terry is credited with."""
_TOLERANCE: Final = 1e-9
_MOST_STEPS: Final = 10_000


def score_matches(
    kind: str, candidates: int, pairs: Pairs, results: Results, *, win: float = 1.0, draw: float = 0.5
) -> Scores:
    """Return (candidates,) scores, larger for better; NaN for candidates without a finished match.

    Matches in which the fitness of either is NaN or infinite have failed and are left out.

    Args:
        kind: a key of SCORES.
        candidates: how many; players with higher numbers are opponents without a score, such as champions.
        pairs: (matches, 2) numbers of players, in the order played.
        results: (matches, 2) fitness of both.
        win: points for a win, for the kind `points`; a loss has none.
        draw: points for a draw.
    """
    finished = np.isfinite(results).all(axis=1)
    pairs, results = pairs[finished], results[finished]
    players = max(candidates, int(pairs.max(initial=-1)) + 1)
    if kind == "points":
        scores = _add_up(pairs, points_of(results, win, draw), players)
    else:
        scores = SCORES[kind](players, pairs, results)
    if kind != "frevo_multi_swiss":
        scores[_count_matches(pairs, players) == 0] = np.nan
    return scores[:candidates]


def _add_up(pairs: Pairs, values: Results, players: int) -> Scores:
    """Return the sum of the values of each player, in the order played."""
    return np.bincount(pairs.ravel(), weights=values.ravel(), minlength=players).astype(np.float64)


def _count_matches(pairs: Pairs, players: int) -> NDArray[np.intp]:
    return np.bincount(pairs.ravel(), minlength=players)


def _average(pairs: Pairs, values: Results, players: int) -> Scores:
    """Return the mean of the values of each player, 0 for none."""
    return _add_up(pairs, values, players) / np.maximum(_count_matches(pairs, players), 1)


def points(players: int, pairs: Pairs, results: Results) -> Scores:
    """Return the sum of 1 for each win and 0.5 for each draw."""
    return _add_up(pairs, points_of(results), players)


def win_rate(players: int, pairs: Pairs, results: Results) -> Scores:
    """Return the points per match, from 0 to 1.

    Other than points, it does not depend on byes and failed matches.
    """
    return _average(pairs, points_of(results), players)


def fitness(players: int, pairs: Pairs, results: Results) -> Scores:
    """Return the mean of the own fitness."""
    return _average(pairs, results, players)


def elo(players: int, pairs: Pairs, results: Results, factor: float = ELO_FACTOR) -> Scores:
    """Return Elo's ratings after all matches, in the order played, from 0 for everybody.

    The better player of two whose ratings differ by 400 is expected to get ten of eleven points. The order of
    matches changes the result, unless nobody plays in two of them: `bradley_terry` does not depend on it.

    Source: Elo, "The rating of chessplayers, past and present", 1978.
    """
    ratings = [0.0] * players
    first_points = points_of(results)[:, 0].tolist()
    for (first, second), actual in zip(pairs.tolist(), first_points, strict=True):
        expected = 1.0 / (1.0 + 10.0 ** ((ratings[second] - ratings[first]) / 400.0))
        change = factor * (actual - expected)
        ratings[first] += change
        ratings[second] -= change
    return np.array(ratings, dtype=np.float64)


def bradley_terry(players: int, pairs: Pairs, results: Results, prior: float = _PRIOR) -> Scores:
    """Return ratings of greatest likelihood, in the units of Elo's, with 0 for an average player.

    The chance of a player with strength s against another with strength t is s / (s + t); a draw counts as
    half a win of each. Every player is credited with `prior` draws against a player of strength 1, without
    which those who won all of their matches would have no finite rating.

    Source: Hunter, "MM algorithms for generalized Bradley-Terry models", The Annals of Statistics 32(1),
    2004, doi:10.1214/aos/1079120141.
    """
    wins = _add_up(pairs, points_of(results), players) + prior / 2.0
    strengths = np.ones(players)
    for _ in range(_MOST_STEPS):
        both = 1.0 / strengths[pairs].sum(axis=1)
        updated = wins / (_add_up(pairs, np.column_stack([both, both]), players) + prior / (strengths + 1.0))
        change = np.max(np.abs(updated - strengths) / updated, initial=0.0)
        strengths = updated
        if change < _TOLERANCE:
            break
    return _SCALE * np.log(strengths)


def order(players: int, pairs: Pairs, results: Results) -> Scores:
    """Return how many players each is better than, directly or by way of others.

    A player is at least as good as another if it won or drew against it, or is at least as good as a third
    that is at least as good as the other; better, if not the other way round, too. So players in a cycle have
    the same score. After a merge sort without draws, this is the order of the sort.
    """
    first_points = points_of(results)[:, 0]
    reach = np.eye(players, dtype=bool)
    reach[tuple(pairs[first_points >= 0.5].T)] = True
    reach[tuple(pairs[first_points <= 0.5, ::-1].T)] = True
    while True:
        further = (reach.astype(np.float32) @ reach.astype(np.float32)) > 0.5
        if (further == reach).all():
            return np.asarray((reach & ~reach.T).sum(axis=1), dtype=np.float64)
        reach = further


def frevo_multi_swiss(players: int, pairs: Pairs, results: Results) -> Scores:
    """Return the scores of FREVO's MultiSwiss: the mean of 2 for a win and 1 for a loss; 1.5 without a match.

    FREVO knows no draws: who is named first wins them.
    """
    first_wins = results[:, 0] >= results[:, 1]
    scores = _average(pairs, np.where(np.column_stack([first_wins, ~first_wins]), 2.0, 1.0), players)
    scores[_count_matches(pairs, players) == 0] = 1.5
    return scores


SCORES: Mapping[str, Callable[[int, Pairs, Results], Scores]] = {
    "points": points,
    "win_rate": win_rate,
    "fitness": fitness,
    "elo": elo,
    "bradley_terry": bradley_terry,
    "order": order,
    "frevo_multi_swiss": frevo_multi_swiss,
}
"""All scores, by the `score` of a tournament."""
