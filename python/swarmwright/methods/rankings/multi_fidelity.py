"""Multi-fidelity ranking: all candidates in a fast simulation, the best also in a slow one."""

import math
from collections import deque
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from swarmwright.common.arrays import best_first
from swarmwright.common.statistics import mean
from swarmwright.methods.rankings.slow_simulation import (
    Episodes,
    Ranked,
    Rounds,
    SlowOptions,
    SlowRanking,
    compress_below,
    row_means,
)

_MEMORY = 10
"""Default of `memory` if all generations have the same seeds."""


class MultiFidelityOptions(SlowOptions):
    """All candidates are evaluated in the experiment's simulation, the best also in a slow one."""

    kind: Literal["multi_fidelity"] = "multi_fidelity"
    share: float = Field(default=0.1, gt=0, le=1)
    """Share of a generation to evaluate in the slow simulation, at least one candidate."""
    memory: int | None = Field(default=None, ge=1, le=100_000)
    """Generations whose differences between slow and fast fitness correct the fast fitness of other
    candidates. Default: 10; with `seeds: new` 1.
    """


class MultiFidelity(SlowRanking):
    """Fitness in a slow simulation for the best candidates, and corrected fast fitness for the others.

    A share of each generation, the best by fast fitness, is also evaluated in the slow simulation, with the
    same seeds. Their fitness is the mean of these episodes. The fitness of the others is the mean of the fast
    episodes plus the mean of slow minus fast fitness over the last `memory` generations. It is kept below the
    best slow fitness of the generation, in order, so that the best of a run was always evaluated in the slow
    simulation. If all evaluations in the slow simulation fail, the next best candidates are evaluated.

    Sources: the best are chosen as in the best strategy of individual-based evolution control of Jin, Olhofer
    and Sendhoff, "A framework for evolutionary optimization with approximate fitness functions", IEEE
    Transactions on Evolutionary Computation 6(5), 2002, doi:10.1109/TEVC.2002.800884. The correction is the
    model of Kennedy and O'Hagan, "Predicting the output from a complex computer code when fast approximations
    are available", Biometrika 87(1), 2000, with factor one and a constant difference.
    """

    kind: ClassVar[str] = "multi_fidelity"
    options_model = MultiFidelityOptions
    options: MultiFidelityOptions

    def __init__(self, options: MultiFidelityOptions) -> None:
        super().__init__(options)
        self._memory = options.memory or (1 if options.seeds == "new" else _MEMORY)
        self._differences: deque[list[float]] = deque(maxlen=self._memory)

    def count_transfers(self, candidates: int) -> int:
        """Return the number of candidates to evaluate in the slow simulation."""
        return min(candidates, max(1, math.floor(self.options.share * candidates + 0.5)))

    def rounds(self, fast: Episodes, metrics: NDArray[np.float64]) -> Rounds:  # noqa: ARG002 - of another ranking
        """Choose the best by fast fitness; see `SlowRanking.rounds`."""
        approximate = row_means(fast)
        order = best_first(approximate)[: int(np.isfinite(approximate).sum())]
        slow = np.full(len(fast), np.nan)
        measured = np.zeros(len(fast), dtype=np.bool_)
        count = self.count_transfers(len(fast))
        while len(order) and not np.isfinite(slow).any():
            chosen, order = np.sort(order[:count]), order[count:]
            slow[chosen] = row_means((yield chosen))
            measured[chosen] = True
        both = np.isfinite(slow)
        differences = (slow - approximate)[both].tolist()
        fitness = np.where(measured, slow, approximate + self._correction(differences))
        if both.any():
            fitness[~measured] = compress_below(fitness[~measured], float(slow[both].max()))
        fitness[~np.isfinite(fitness)] = np.nan
        return Ranked(fitness + 0.0, differences)

    def learn(self, learned: list[float]) -> None:
        """Store the differences of a generation."""
        self._differences.append(learned)

    def _correction(self, now: list[float]) -> float:
        """Return the mean difference. now: differences of this generation."""
        before = list(self._differences)[-(self._memory - 1) :] if self._memory > 1 else []
        values = [value for generation in (*before, now) for value in generation]
        return mean(values) if values else 0.0
