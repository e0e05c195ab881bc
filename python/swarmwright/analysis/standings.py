"""Standings of a league: points and ratings of players in matches of two sides, with intervals."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swarmwright.common.random_numbers import Stream
from swarmwright.methods.rankings.match_scores import fit_strengths

Values = NDArray[np.float64]

RESAMPLES = 200
"""Bootstrap samples of the seeds of an interval."""
_RESAMPLED_CELLS = 4_000_000
"""Pairs of players in all bootstrap samples together, which bounds memory; at least `_FEWEST` are drawn."""
_FEWEST = 40
_COUNTED = 255
"""Games that a byte counts."""
_TAIL = 2.5
"""Percentage of the bootstrap samples on each side of the 95 % interval."""
Interval = tuple[float, float] | None


@dataclass(frozen=True)
class Games:
    """Games of players against each other, by the seed of their episodes."""

    wins: Values
    """(seeds, players, players): games that the first won against the second."""
    draws: Values
    """(seeds, players, players), symmetric."""

    @property
    def points(self) -> Values:
        """(seeds, players, players): 1 for each win, 0.5 for each draw."""
        return self.wins + self.draws / 2


@dataclass(frozen=True)
class Standing:
    """The games of one player."""

    wins: int
    draws: int
    losses: int
    points: float
    """Share of the points of its games, 0 to 1; NaN without any."""
    points_interval: Interval
    """95 % interval over other seeds; None if each seed has the same winners, or there is a single seed."""
    rating: float
    """Bradley-Terry rating in the units of Elo's, 0 for an average player; NaN without games."""
    rating_interval: Interval
    """Likewise."""


def games_of_matches(fitness: Values) -> Games:
    """Return the games between the two sides of each match: the one with the higher fitness wins.

    fitness: (players, players, seeds, 2), of the match in which the first plays the first side; NaN if it
    was not played or has failed.
    """
    first, second = fitness[..., 0], fitness[..., 1]
    with np.errstate(invalid="ignore"):
        won, lost, drawn = (
            np.moveaxis(each, 2, 0) for each in (first > second, first < second, first == second)
        )
    wins = won + np.swapaxes(lost, 1, 2).astype(np.float64)
    draws = drawn + np.swapaxes(drawn, 1, 2).astype(np.float64)
    return Games(wins, draws)


def games_on_side(fitness: Values, side: int) -> Games:
    """Return the games between players of one side, who never meet: a game is the same opponent and seed.

    Args:
        fitness: as for `games_of_matches`.
        side: 0 or 1.
    """
    return games_against_equals(fitness[..., side] if side == 0 else np.swapaxes(fitness[..., side], 0, 1))


def games_against_equals(own: Values) -> Games:
    """Return the games between players who never meet: a game is the same opponent and seed.

    own: (players, opponents, seeds) fitness; NaN if a match was not played or has failed.
    """
    players, opponents, seeds = own.shape
    wins, draws = np.zeros((seeds, players, players)), np.zeros((seeds, players, players))
    for seed in range(seeds):
        columns = np.ascontiguousarray(own[:, :, seed].T)
        for start in range(0, opponents, _COUNTED):
            won, drawn = np.zeros((2, players, players), np.uint8)
            for column in columns[start : start + _COUNTED]:
                with np.errstate(invalid="ignore"):
                    won += (column[:, np.newaxis] > column).view(np.uint8)
                    drawn += (column[:, np.newaxis] == column).view(np.uint8)
            wins[seed] += won
            draws[seed] += drawn
        np.fill_diagonal(draws[seed], 0.0)
    return Games(wins, draws)


def rate(points: Values, start: Values | None = None) -> Values:
    """Return Bradley-Terry ratings, (players,), 0 for an average player.

    Args:
        points: (players, players): points of the first against the second.
        start: (players,) ratings near the result, which save time.
    """
    pairs = np.argwhere(np.triu(points + points.T, 1) > 0)
    first, second = points[tuple(pairs.T)], points.T[tuple(pairs.T)]
    return fit_strengths(len(points), pairs, first, first + second, start=start)


def standings(games: Games) -> list[Standing]:
    """Return the standing of each player. Intervals are percentiles of a bootstrap over the seeds."""
    points = games.points
    wins, draws, losses = (
        each.sum(axis=0).sum(axis=1) for each in (games.wins, games.draws, np.swapaxes(games.wins, 1, 2))
    )
    total = points.sum(axis=0)
    played = wins + draws + losses
    with np.errstate(invalid="ignore"):
        share = np.where(played > 0, total.sum(axis=1) / played, np.nan)
    ratings = rate(total)
    share_samples, rating_samples = _resample(points, ratings)
    return [
        Standing(
            int(wins[player]),
            int(draws[player]),
            int(losses[player]),
            float(share[player]),
            _interval(share_samples, player),
            float(ratings[player]) if played[player] else np.nan,
            _interval(rating_samples, player) if played[player] else None,
        )
        for player in range(len(played))
    ]


def _resample(points: Values, ratings: Values) -> tuple[Values | None, Values | None]:
    """Return shares of points and ratings of bootstrap samples, (samples, players); None if all are equal."""
    seeds, players, _ = points.shape
    if seeds < 2 or (points == points[0]).all():
        return None, None
    samples = int(np.clip(_RESAMPLED_CELLS // max(players**2, 1), _FEWEST, RESAMPLES))
    chosen = np.asarray(Stream(0, "league.bootstrap", 0, 0).integers(seeds, samples * seeds))
    weights = np.stack([np.bincount(row, minlength=seeds) for row in chosen.reshape(samples, seeds)])
    drawn = np.tensordot(weights.astype(np.float64), points, axes=1)
    played = (drawn + np.swapaxes(drawn, 1, 2)).sum(axis=2)
    with np.errstate(invalid="ignore"):
        shares = drawn.sum(axis=2) / played
    return shares, np.stack([rate(sample, ratings) for sample in drawn])


def _interval(samples: Values | None, player: int) -> Interval:
    if samples is None:
        return None
    values = samples[:, player]
    values = values[np.isfinite(values)]
    if not len(values):
        return None
    low, high = np.percentile(values, [_TAIL, 100 - _TAIL])
    return float(low), float(high)
