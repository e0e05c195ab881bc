"""The candidates of a run in another simulation, and what they lose there."""

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
    """None: a random controller, which evolution did not see."""
    candidate: int
    """Index among those of its generation, or among the random ones."""
    recorded: float | None
    """Fitness in the record, by which it was chosen; None of random ones."""

    @property
    def label(self) -> str:
        """What it is called: generation:candidate, or random and its number."""
        return (
            f"random {self.candidate}" if self.generation is None else f"{self.generation}:{self.candidate}"
        )


@dataclass(frozen=True, eq=False)
class Transferred(ComparedByValue):
    """The candidates of one run in one target."""

    run: "Run" = field(compare=False)
    target: str
    candidates: tuple[Candidate, ...]
    """The best of the run first, random ones last."""
    source_episodes: Values
    """(candidates, seeds) fitness of episodes in the run's own simulation, NaN where one failed."""
    target_episodes: Values
    """(candidates, seeds) fitness of episodes in the target, NaN where one failed."""
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
        """Mean fitness that each candidate loses, of pairs with the same seed; negative: it gains."""
        return [
            estimate([one - other for one, other in zip(*self._together(*row), strict=True)])
            for row in zip(self.source_episodes, self.target_episodes, strict=True)
        ]

    @cached_property
    def correlation(self) -> Correlation | None:
        """Whether candidates keep their order; None of fewer than three."""
        return rank_correlation(
            *([values.mean for values in of] for of in (self.source_fitness, self.target_fitness))
        )

    @property
    def failed(self) -> int:
        """Episodes that failed in the target."""
        return int(np.isnan(self.target_episodes).sum())

    @property
    def source_failed(self) -> int:
        """Episodes that failed in the run's own simulation."""
        return int(np.isnan(self.source_episodes).sum())

    def _samples(self, episodes: Values) -> list[float]:
        counted = self.ranking.replace_failures(episodes)
        return list(self.ranking.samples(counted[np.isfinite(counted)].tolist()))

    def _together(self, one: Values, other: Values) -> tuple[list[float], list[float]]:
        """Return the fitness of the seeds that count in both."""
        one, other = self.ranking.replace_failures(one), self.ranking.replace_failures(other)
        both = np.isfinite(one) & np.isfinite(other)
        return self._samples(one[both]), self._samples(other[both])
