"""The fitness of a run's candidates in another simulation, and their losses."""

from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from swarmwright.common.statistics import Correlation, Estimate, estimate, rank_correlation
from swarmwright.common.values import ComparedByValue
from swarmwright.methods.rankings import Ranking

if TYPE_CHECKING:
    from swarmwright.runs.run import Run

Values = NDArray[np.float64]


@dataclass(frozen=True)
class Candidate:
    """A candidate of a run, or a random one."""

    generation: int | None
    """None for a random controller, which is not from the evolution."""
    candidate: int
    """Index in its generation, or among the random controllers."""
    recorded: float | None
    """Fitness in the record, by which it was chosen; None for random controllers."""

    @property
    def label(self) -> str:
        """Label of the candidate: `generation:candidate`, or `random` and its index."""
        return (
            f"random {self.candidate}" if self.generation is None else f"{self.generation}:{self.candidate}"
        )


@dataclass(frozen=True, eq=False)
class Transferred(ComparedByValue):
    """The candidates of a run in another simulation, the target."""

    run: "Run" = field(compare=False)
    target: str
    candidates: tuple[Candidate, ...]
    """The best of the run first, random controllers last."""
    source_episodes: Values
    """Fitness of episodes in the run's own simulation, (candidates, seeds), NaN for failed episodes."""
    target_episodes: Values
    """Fitness of episodes in the target, (candidates, seeds), NaN for failed episodes."""
    ranking: Ranking = field(repr=False, compare=False)

    @cached_property
    def source_fitness(self) -> list[Estimate]:
        """Mean fitness of each candidate in the run's own simulation, on held-out seeds."""
        return [estimate(self._samples(row)) for row in self.source_episodes]

    @cached_property
    def target_fitness(self) -> list[Estimate]:
        """Mean fitness of each candidate in the target."""
        return [estimate(self._samples(row)) for row in self.target_episodes]

    @cached_property
    def losses(self) -> list[Estimate]:
        """Mean loss of fitness of each candidate, paired by seed; negative for a gain."""
        return [
            estimate([before - after for before, after in zip(*self._pair(*row), strict=True)])
            for row in zip(self.source_episodes, self.target_episodes, strict=True)
        ]

    @cached_property
    def correlation(self) -> Correlation | None:
        """Rank correlation of the candidates in both simulations; None for fewer than three candidates."""
        return rank_correlation(
            [fitness.mean for fitness in self.source_fitness],
            [fitness.mean for fitness in self.target_fitness],
        )

    @property
    def failed(self) -> int:
        """Number of failed episodes in the target."""
        return int(np.isnan(self.target_episodes).sum())

    @property
    def source_failed(self) -> int:
        """Number of failed episodes in the run's own simulation."""
        return int(np.isnan(self.source_episodes).sum())

    def _samples(self, episodes: Values) -> list[float]:
        counted = self.ranking.replace_failures(episodes)
        return list(self.ranking.samples(counted[np.isfinite(counted)].tolist()))

    def _pair(self, source: Values, target: Values) -> tuple[list[float], list[float]]:
        """Return the fitness of the seeds that count in both simulations."""
        source, target = self.ranking.replace_failures(source), self.ranking.replace_failures(target)
        both = np.isfinite(source) & np.isfinite(target)
        return self._samples(source[both]), self._samples(target[both])
