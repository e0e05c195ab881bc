"""Absolute ranking: a candidate's fitness depends on its episodes only."""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from swarmwright.core.statistics import neighbours, quantile
from swarmwright.rankings._base import Ranking, RankingOptions
from swarmwright.typing import Fitness


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


def _worst_share(values: Sequence[float], share: float) -> float:
    """Return the mean of the worst share of values; the last one counts in part."""
    ordered = sorted(values)
    mass = share * len(ordered)
    whole = math.floor(mass)
    part = mass - whole
    parts = ordered[:whole] + ([ordered[whole] * part] if whole < len(ordered) else [])
    return _sum(parts) / mass


def _row_sums(episodes: NDArray[np.float64]) -> Fitness:
    """Return the exact sum of each row, rounded once; NaN where it overflows."""
    if episodes.shape[1] == 2:
        return np.asarray(episodes[:, 0] + episodes[:, 1])
    try:
        return np.array([math.fsum(row) for row in episodes.tolist()])
    except OverflowError:
        return np.array([_sum(row) for row in episodes.tolist()])


class AbsoluteOptions(RankingOptions):
    """A candidate's fitness is an aggregate of its episodes."""

    kind: Literal["absolute"] = "absolute"
    aggregate: Literal["mean", "sum", "median", "worst", "quantile", "cvar"] = "mean"
    """How the episodes' fitness becomes the candidate's. FREVO's problems use the sum. quantile: what the
    worst `level` of the episodes does not exceed. cvar (conditional value at risk, expected shortfall): the
    mean of the worst `level` of the episodes."""
    level: float = Field(default=0.25, gt=0, le=1)
    """Share of episodes that quantile and cvar look at."""


class Absolute(Ranking):
    """The aggregate of a candidate's episodes.

    Sources: the quantile interpolates between neighbours (Hyndman and Fan 1996, definition 7); cvar is that
    of Rockafellar and Uryasev 2000, for a sample: of five episodes at level 0.3 the worst counts wholly and
    the second worst half.
    """

    kind: ClassVar[str] = "absolute"
    options_model = AbsoluteOptions
    options: AbsoluteOptions

    def samples(self, episodes: Sequence[float]) -> Fitness:
        """Return fitness values of one candidate; of a mean or a sum, every episode makes one."""
        if self.options.aggregate in {"mean", "sum"}:
            share = self.options.episodes if self.options.aggregate == "sum" else 1
            return np.array(episodes, dtype=np.float64) * share
        return super().samples(episodes)

    def _score_array(self, episodes: NDArray[np.float64]) -> Fitness:
        aggregate = self.options.aggregate
        if aggregate == "cvar":
            return super()._score_array(episodes)
        if episodes.shape[1] == 1:
            # Whatever the aggregate of one number, it is the number.
            return episodes[:, 0]
        if aggregate in {"mean", "sum"}:
            share = episodes.shape[1] if aggregate == "mean" else 1
            return _row_sums(episodes) / share
        ordered = np.sort(episodes, axis=1)
        if aggregate == "worst":
            return ordered[:, 0]
        if aggregate == "median":
            middle = episodes.shape[1] // 2
            upper = ordered[:, middle]
            return upper if episodes.shape[1] % 2 else ordered[:, middle - 1] / 2 + upper / 2
        low, high, part = neighbours(episodes.shape[1], self.options.level)
        return np.asarray(ordered[:, low] * (1 - part) + ordered[:, high] * part)

    def _score(self, episodes: Sequence[Sequence[float]]) -> Fitness:
        level = self.options.level
        aggregates: Mapping[str, Callable[[Sequence[float]], float]] = {
            "mean": _mean,
            "sum": _sum,
            "median": _median,
            "worst": min,
            "quantile": lambda values: quantile(sorted(values), level),
            "cvar": lambda values: _worst_share(values, level),
        }
        aggregate = aggregates[self.options.aggregate]
        return np.array([aggregate(row) for row in episodes], dtype=np.float64)
