"""Absolute ranking: a candidate's fitness depends on its episodes only."""

from collections.abc import Sequence
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from swarmwright import _engine
from swarmwright.common.arrays import Fitness
from swarmwright.methods.rankings._base import Ranking, RankingOptions


class AbsoluteOptions(RankingOptions):
    """A candidate's fitness is an aggregate of its episodes."""

    kind: Literal["absolute"] = "absolute"
    aggregate: Literal["mean", "sum", "median", "worst", "quantile", "cvar"] = "mean"
    """Aggregation of the episodes' fitness. quantile: the `level` quantile. cvar (conditional value at risk):
    the mean of the worst `level`. FREVO's problems use the sum.
    """
    level: float = Field(default=0.25, gt=0, le=1)
    """Share of worst episodes for quantile and cvar."""


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
        """Return fitness values of one candidate; one per episode for mean and sum."""
        if self.options.aggregate in {"mean", "sum"}:
            share = self.options.episodes if self.options.aggregate == "sum" else 1
            return np.array(episodes, dtype=np.float64) * share
        return super().samples(episodes)

    def _score_array(self, episodes: NDArray[np.float64]) -> Fitness:
        return _engine.aggregates(np.ascontiguousarray(episodes), self.options.aggregate, self.options.level)

    def _score(self, episodes: Sequence[Sequence[float]]) -> Fitness:
        rows = (np.array([row], dtype=np.float64) for row in episodes)
        return np.concatenate([self._score_array(row) for row in rows])
