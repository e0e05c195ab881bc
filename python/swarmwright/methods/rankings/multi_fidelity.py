"""Two fidelities: all candidates in a fast simulation, the best of them in a slow one, too."""

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
    kept_below,
    row_means,
)

_MEMORY = 10
"""Default of `memory` where all generations have the same seeds."""


class MultiFidelityOptions(SlowOptions):
    """All candidates are evaluated in the experiment's simulation, the best of them in a slow one as well."""

    kind: Literal["multi_fidelity"] = "multi_fidelity"
    share: float = Field(default=0.1, gt=0, le=1)
    """Share of a generation that is evaluated in the slow simulation, rounded; at least one candidate."""
    memory: int | None = Field(default=None, ge=1, le=100_000)
    """Generations, this one among them, whose differences between slow and fast fitness correct the fast
    fitness of the other candidates. Default: 10; with `seeds: new` 1, since differences between the two
    simulations that a seed makes are those of its generation only."""


class MultiFidelity(SlowRanking):
    """The fitness in a slow simulation where there is one, else the corrected one of the fast simulation.

    A share of each generation, the best by their fast fitness, is evaluated in the slow simulation as well,
    with the same seeds. Their fitness is the mean of these episodes. That of the others is the mean of the
    fast episodes plus the mean of slow minus fast over all candidates of the last `memory` generations that
    have both; those for which this is not less than the best slow one of their generation are kept below it,
    in their order, so that the best of a run was always evaluated in the slow simulation. Where all that are
    evaluated there fail, the next best ones are, until one does not.

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

    def expected(self, candidates: int) -> int:
        """Return how many candidates of a generation are evaluated in the slow simulation."""
        return min(candidates, max(1, math.floor(self.options.share * candidates + 0.5)))

    def rounds(self, fast: Episodes, metrics: NDArray[np.float64]) -> Rounds:  # noqa: ARG002 - of another ranking
        """Choose the best by their fast fitness; see `SlowRanking.rounds`."""
        approximate = row_means(fast)
        order = best_first(approximate)[: int(np.isfinite(approximate).sum())]
        slow = np.full(len(fast), np.nan)
        measured = np.zeros(len(fast), dtype=np.bool_)
        count = self.expected(len(fast))
        while len(order) and not np.isfinite(slow).any():
            who, order = np.sort(order[:count]), order[count:]
            slow[who] = row_means((yield who))
            measured[who] = True
        both = np.isfinite(slow)
        differences = (slow - approximate)[both].tolist()
        fitness = np.where(measured, slow, approximate + self._correction(differences))
        if both.any():
            fitness[~measured] = kept_below(fitness[~measured], float(slow[both].max()))
        fitness[~np.isfinite(fitness)] = np.nan
        return Ranked(fitness + 0.0, differences)

    def learn(self, learned: list[float]) -> None:
        """Keep the differences of a generation."""
        self._differences.append(learned)

    def _correction(self, now: list[float]) -> float:
        """Return the mean difference; now: those of this generation."""
        before = list(self._differences)[-(self._memory - 1) :] if self._memory > 1 else []
        values = [value for generation in (*before, now) for value in generation]
        return mean(values) if values else 0.0
