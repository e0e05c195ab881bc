"""Absolute ranking: a candidate's fitness depends on its own episodes only."""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import ClassVar, Literal

import numpy as np
from pydantic import Field

from swarmwright.core.statistics import quantile
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


class AbsoluteOptions(RankingOptions):
    """A candidate's fitness is an aggregate of its own episodes."""

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

    def _score(self, episodes: Sequence[Sequence[float]]) -> Fitness:
        if self.options.aggregate != "cvar" and all(len(row) == 1 for row in episodes):
            # Whatever the aggregate of one number, it is the number.
            return np.array([row[0] for row in episodes], dtype=np.float64)
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
