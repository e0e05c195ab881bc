"""What every ranking does."""

from abc import ABC, abstractmethod
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from swarmwright._options import Options

Fitness = NDArray[np.float64]
"""A number for each candidate, more is better, NaN where the evaluation failed."""


class RankingOptions(Options):
    """Options of every ranking."""

    episodes: int = Field(default=1, ge=1, le=100_000)
    """Simulation runs per candidate; episode e runs with the simulation seed parameters.seed (default 0) +
    e."""


class Ranking(ABC):
    """Says which episodes a candidate goes through and turns what came out into one fitness per candidate.

    `score` is a template around `_score`: it checks the shapes and keeps failed candidates apart, so that a
    ranking only ever sees numbers.
    """

    kind: ClassVar[str]
    """Name in experiment files."""
    options_model: ClassVar[type[RankingOptions]]
    """Typed options, with `kind` among them."""

    def __init__(self, options: RankingOptions) -> None:
        self.options = options

    def seeds(self, first: int) -> list[int]:
        """Return the simulation seed of each episode; `first` is the experiment's parameters.seed."""
        return [first + episode for episode in range(self.options.episodes)]

    def score(self, episodes: NDArray[np.float64]) -> Fitness:
        """Return (candidates,) fitness of (candidates, episodes) results.

        A candidate of which any episode failed (NaN or infinite), or whose aggregate overflows, has failed:
        NaN.
        """
        scores = np.full(len(episodes), np.nan)
        worked = np.isfinite(episodes).all(axis=1)
        if worked.any():
            # Adding 0.0 turns -0.0 into 0.0: "the goal is reached" has one spelling.
            scores[worked] = self._score(episodes[worked]) + 0.0
        scores[~np.isfinite(scores)] = np.nan
        return scores

    @abstractmethod
    def _score(self, episodes: NDArray[np.float64]) -> Fitness:
        """Return (candidates,) fitness of (candidates, episodes) finite results."""


def best_first(fitness: Fitness) -> NDArray[np.intp]:
    """Return indices from the best to the worst; equal ones by index, failed ones (NaN) last, by index."""
    order: NDArray[np.intp] = np.argsort(-fitness, kind="stable")  # NaN sorts last
    return order
