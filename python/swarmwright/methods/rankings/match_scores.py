"""Scores of candidates in a tournament, from the results of their matches."""

import math
from collections.abc import Callable, Mapping
from typing import Final

import numpy as np
from numpy.typing import NDArray

from swarmwright.methods.rankings._pairing import Pairs, Results, points_of

__all__ = ["SCORES", "bradley_terry", "elo", "fit_strengths", "score_matches"]

Scores = NDArray[np.float64]

ELO_FACTOR: Final = 32.0
"""How many rating points a win against an equal opponent transfers, twice."""
_SCALE: Final = 400.0 / math.log(10.0)
"""Rating points in a unit of the logarithm of the odds, as in chess: 400 are odds of ten to one."""
_PRIOR: Final = 0.2
"""Draws with an average player that every player of bradley_terry is credited with."""
_TOLERANCE: Final = 1e-9
"""Step, in logarithms of strengths, after which the maximum is reached."""
_MOST_STEPS: Final = 200
_DECIMALS: Final = 6
"""Ratings are rounded, so that they are the same on every machine, and the same for the same results."""


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

    The better of two whose ratings differ by 400 is expected to get ten of eleven points. The order of
    matches changes the result, unless nobody plays in two of them: `bradley_terry` does not depend on it.

    Source: Elo, "The rating of chessplayers, past and present", 1978.
    """
    ratings = [0.0] * players
    first_points = points_of(results)[:, 0].tolist()
    for (first, second), actual in zip(pairs.tolist(), first_points, strict=True):
        change = factor * (actual - _win_chance((ratings[first] - ratings[second]) / _SCALE))
        ratings[first] += change
        ratings[second] -= change
    return np.round(ratings, _DECIMALS)


def bradley_terry(players: int, pairs: Pairs, results: Results, prior: float = _PRIOR) -> Scores:
    """Return ratings of greatest likelihood, in the units of Elo's, with 0 for an average player.

    The chance of a player with strength s against another with strength t is s / (s + t); a draw counts as
    half a win of each. Every player is credited with `prior` draws against a player of strength 1, without
    which those who won all of their matches would have no finite rating.

    Source: Hunter, "MM algorithms for generalized Bradley-Terry models", The Annals of Statistics 32(1),
    2004, doi:10.1214/aos/1079120141. The maximum is that of the source; it is reached by Newton's method,
    since MM takes thousands of steps where the better of two nearly always wins.
    """
    return fit_strengths(players, pairs, points_of(results)[:, 0], np.ones(len(pairs)), prior)


def fit_strengths(
    players: int,
    pairs: Pairs,
    first_points: Scores,
    games: Scores,
    prior: float = _PRIOR,
    start: Scores | None = None,
) -> Scores:
    """Return ratings as `bradley_terry`, from the sums of several games of each pair.

    Args:
        players: how many.
        pairs: (pairs, 2) numbers of players.
        first_points: (pairs,) points of the first: 1 for each win and 0.5 for each draw.
        games: (pairs,) number of games.
        prior: draws against an average player.
        start: (players,) ratings near the result, which save time.
    """
    model = _BradleyTerry(players, pairs, first_points, games, prior)
    logarithms = np.zeros(players) if start is None else start / _SCALE
    for _ in range(_MOST_STEPS):
        gradient, curvature, own_curvature = model.derive(logarithms)
        step = model.solve(curvature, own_curvature, gradient)
        logarithms = model.search(logarithms, step, float((gradient * step).sum()))
        if np.abs(step).max(initial=0.0) < _TOLERANCE:
            break
    return np.round(_SCALE * logarithms, _DECIMALS)


class _BradleyTerry:
    """The likelihood of logarithms of strengths, with its prior; arguments as for `fit_strengths`."""

    def __init__(self, players: int, pairs: Pairs, first_points: Scores, games: Scores, prior: float) -> None:
        self._players = players
        self._firsts, self._seconds = pairs.T
        self._points = first_points
        self._games = games
        self._prior = prior

    def derive(self, logarithms: Scores) -> tuple[Scores, Scores, Scores]:
        """Return the gradient, and minus the second derivatives by pair and by player, for the prior."""
        chances = _win_chances(logarithms[self._firsts] - logarithms[self._seconds])
        own = _win_chances(logarithms)
        gradient = self._spread(self._points - self._games * chances) + self._prior * (0.5 - own)
        return gradient, self._games * chances * (1.0 - chances), self._prior * own * (1.0 - own)

    def solve(self, curvature: Scores, own_curvature: Scores, gradient: Scores) -> Scores:
        """Return the step of Newton's method, by conjugate gradients scaled by the diagonal.

        Sums have a fixed order, other than those of a library for linear algebra.
        """
        diagonal = (
            own_curvature + self._count(self._firsts, curvature) + self._count(self._seconds, curvature)
        )
        solution, rest = np.zeros_like(gradient), gradient.copy()
        direction = rest / diagonal
        size = float((rest * direction).sum())
        end = size * 1e-24
        for _ in range(2 * self._players + 10):
            if not size > end:
                break
            change = direction[self._firsts] - direction[self._seconds]
            image = own_curvature * direction + self._spread(curvature * change)
            length = size / float((direction * image).sum())
            solution += length * direction
            rest -= length * image
            scaled = rest / diagonal
            size, last = float((rest * scaled).sum()), size
            direction = scaled + size / last * direction
        return solution

    def search(self, logarithms: Scores, step: Scores, slope: float) -> Scores:
        """Go along the step, or the greatest of its halves that improves the likelihood."""
        before = self._measure(logarithms)
        rounding = 1e-13 * abs(before)  # near the maximum, improvements are smaller
        part = 1.0
        for _ in range(30):
            if self._measure(logarithms + part * step) >= before + 1e-4 * part * slope - rounding:
                break
            part /= 2.0
        return logarithms + part * step

    def _measure(self, logarithms: Scores) -> float:
        """Return the logarithm of the likelihood."""
        gaps = logarithms[self._firsts] - logarithms[self._seconds]
        matches = (self._points - 0.5 * self._games) * gaps - self._games * _half_log_cosh(gaps)
        return float(matches.sum() - self._prior * _half_log_cosh(logarithms).sum())

    def _spread(self, values: Scores) -> Scores:
        """Return (players,) sums of (pairs,) values, which count against the second player."""
        return self._count(self._firsts, values) - self._count(self._seconds, values)

    def _count(self, players: NDArray[np.intp], values: Scores) -> Scores:
        return np.bincount(players, weights=values, minlength=self._players).astype(np.float64)


def _win_chance(gap: float) -> float:
    """Return the chance of the first of two players whose logarithms of strengths differ by `gap`."""
    odds = math.exp(-abs(gap))
    return 1.0 / (1.0 + odds) if gap >= 0.0 else odds / (1.0 + odds)


def _win_chances(gaps: Scores) -> Scores:
    # NumPy's exp has other last digits on processors with other instruction sets.
    odds = np.fromiter(map(math.exp, (-np.abs(gaps)).tolist()), np.float64, len(gaps))
    return np.asarray(np.where(gaps >= 0.0, 1.0, odds) / (1.0 + odds))


def _half_log_cosh(gaps: Scores) -> Scores:
    """Return ln(2 cosh(gap / 2)): minus the logarithm of the chance of a win, averaged over both players."""
    sizes = np.abs(gaps)
    return sizes / 2.0 + np.log1p(np.exp(-sizes))


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
