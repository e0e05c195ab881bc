"""The base class of pairings, and what they share."""

from abc import ABC, abstractmethod
from collections.abc import Generator
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Pairs: TypeAlias = NDArray[np.intp]
"""Matches, (matches, 2): who plays the first side, and who the second."""
Results: TypeAlias = NDArray[np.float64]
"""Fitness of both, (matches, 2); NaN where a match has failed."""
Rounds: TypeAlias = Generator[Pairs, Results, None]
"""Yields the matches of a round, receives their results."""


@dataclass(frozen=True)
class PairingOptions:
    """What pairings need to know beside the number of candidates."""

    rounds: int | None = None
    """Matches of a candidate where none are left out, in each session; None: as many as the pairing takes by
    itself."""
    sessions: int = 3
    """Swiss tournaments of multi_swiss."""
    win: float = 1.0
    """Points for a win, by which Swiss tournaments pair; a loss has none."""
    draw: float = 0.5
    """Points for a draw."""


class Pairing(ABC):
    """Base class of pairings, which say who meets whom.

    A pairing depends on nothing but the arguments of `rounds` and the results sent to it, so that a run can
    be replayed.
    """

    @abstractmethod
    def most_matches(self, candidates: int, options: PairingOptions) -> int:
        """Return a bound for the matches of any candidate."""

    @abstractmethod
    def rounds(self, candidates: int, options: PairingOptions, random: np.random.Generator) -> Rounds:
        """Pair candidates, numbered from 0, round by round.

        Matches of a round can be played in parallel. Every round has at least one; a single candidate has no
        rounds.

        Args:
            candidates: how many, at least 1.
            options: rounds and sessions.
            random: the only source of randomness.
        """


def count_swiss_rounds(candidates: int) -> int:
    """Return the rounds of a knock-out tournament: the binary logarithm, rounded up."""
    return (candidates - 1).bit_length()


def as_pairs(pairs: list[tuple[int, int]]) -> Pairs:
    """Return (matches, 2), also for no matches."""
    return np.array(pairs, dtype=np.intp).reshape(len(pairs), 2)


def points_of(results: Results, win: float = 1.0, draw: float = 0.5) -> Results:
    """Return the points of both in each match, (matches, 2): none for a loss, and NaN for a failed match.

    Args:
        results: (matches, 2).
        win: points for the higher fitness.
        draw: points of both for equal fitness.
    """
    others = results[:, ::-1]
    points = np.where(results > others, win, np.where(results == others, draw, 0.0))
    points[~np.isfinite(results).all(axis=1)] = np.nan
    return points
