"""Absolute ranking: the fitness is what the episodes say, whoever else there is."""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from swarmwright.rankings._base import Fitness, Ranking, RankingOptions


def _mean(values: Sequence[float]) -> float:
    return _sum(values) / len(values)


def _sum(values: Sequence[float]) -> float:
    try:
        return math.fsum(values)  # exact, rounded once: the same on any machine
    except OverflowError:
        return math.nan


def _median(values: Sequence[float]) -> float:
    ordered = sorted(values)
    middle = len(ordered) // 2
    return ordered[middle] if len(ordered) % 2 else ordered[middle - 1] / 2 + ordered[middle] / 2


_AGGREGATES: Mapping[str, Callable[[Sequence[float]], float]] = {
    "mean": _mean,
    "sum": _sum,
    "median": _median,
    "worst": min,
}


class AbsoluteOptions(RankingOptions):
    """A candidate's fitness is an aggregate of its own episodes."""

    kind: Literal["absolute"] = "absolute"
    aggregate: Literal["mean", "sum", "median", "worst"] = "mean"
    """How the episodes' fitness becomes the candidate's (FREVO's problems use the sum)."""


class Absolute(Ranking):
    """The aggregate of a candidate's episodes."""

    kind: ClassVar[str] = "absolute"
    options_model = AbsoluteOptions
    options: AbsoluteOptions

    def _score(self, episodes: NDArray[np.float64]) -> Fitness:
        aggregate = _AGGREGATES[self.options.aggregate]
        return np.array([aggregate(row) for row in episodes.tolist()], dtype=np.float64)
