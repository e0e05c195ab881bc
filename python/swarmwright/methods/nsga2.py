"""NSGA-II: multi-objective optimization."""

from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from swarmwright.controllers import Representation
from swarmwright.methods._base import DrawStreams
from swarmwright.methods._pareto import ParetoMethod, ParetoOptions
from swarmwright.methods.archive import Values, crowding, dominates, ranks


class Nsga2Options(ParetoOptions):
    """Multi-objective: trade-offs between fitness and further metrics."""

    kind: Literal["nsga2"] = "nsga2"


class Nsga2(ParetoMethod):
    """NSGA-II, which sorts members and children by non-dominated fronts, and within a front by isolation.

    Parents win a tournament of two by dominance, then by isolation.

    Source: Deb, Pratap, Agarwal and Meyarivan, "A fast and elitist multiobjective genetic algorithm:
    NSGA-II", IEEE Transactions on Evolutionary Computation 6(2), 2002; tournaments as in the authors' code.
    """

    kind: ClassVar[str] = "nsga2"
    options_model = Nsga2Options
    options: Nsga2Options

    def __init__(self, options: Nsga2Options, representation: Representation, *, seed: int) -> None:
        super().__init__(options, representation, seed=seed)
        self._crowding: Values = np.empty(0)

    def _choose_pairs(self, count: int, streams: DrawStreams) -> NDArray[np.int64]:
        drawn = self._shuffle(4 * count, streams).reshape(count, 4)
        first, second = drawn[:, 0::2], drawn[:, 1::2]
        relation = dominates(self._values)
        isolated = ~relation[first, second] & (self._crowding[second] > self._crowding[first])
        return np.where(relation[second, first] | isolated, second, first)

    def _select(self, values: Values) -> list[int]:
        fronts = ranks(values)
        selected: list[int] = []
        distances = np.zeros(len(values))
        for front in range(int(fronts.max()) + 1):
            rows = np.flatnonzero(fronts == front)
            distances[rows] = crowding(np.where(np.isfinite(values[rows]), values[rows], 0.0))
            free = self.options.population - len(selected)
            if len(rows) > free:
                rows = np.sort(rows[np.argsort(-distances[rows], kind="stable")[:free]])
            selected.extend(rows.tolist())
            if len(selected) == self.options.population:
                break
        self._crowding = distances[selected]
        return selected
