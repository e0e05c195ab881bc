"""The best of evaluations with equal fitness, in a run with several objectives."""

from collections.abc import Mapping, Sequence

import numpy as np

from swarmwright.common.statistics import means
from swarmwright.runs.store.generations import Generations, Row


class BestOfEquals:
    """Finds, among the evaluations with the best fitness, one that no other evaluation dominates.

    It is the first of those with the best value of the first objective, then of the second, and so on. What
    was looked at once is not read again, for a run that grows.

    Args:
        goals: "maximize" or "minimize" of each objective beside the fitness, a metric.
        metrics: names of those that are stored.
    """

    def __init__(self, goals: Mapping[str, str], metrics: Sequence[str]) -> None:
        self._columns = [metrics.index(name) for name in goals]
        self._signs = np.array([1.0 if goal == "maximize" else -1.0 for goal in goals.values()])
        self._stored = len(metrics)
        self._start_at(-1)

    def _start_at(self, leader: int) -> None:
        self._leader = leader
        self._end = leader  # evaluations before this number have been looked at
        self._number = leader
        self._values: list[float] | None = None  # of the best, more is better; None without finite ones

    def number(self, generations: Generations, last: Row) -> int:
        """Return its number in the run up to the generation `last`, whose leader is the first of them."""
        end = last.summary.evaluations
        if last.leader != self._leader or end < self._end:
            self._start_at(last.leader)  # no evaluation before it has its fitness
        best = generations.best_fitness(last.leader, last.leader + 1)
        for numbers, metrics in generations.with_fitness(best, self._end, end, self._stored):
            signed = means(metrics[:, :, self._columns]) * self._signs
            for index in np.flatnonzero(np.isfinite(signed).all(axis=1)):
                values = signed[index].tolist()
                if self._values is None or values > self._values:
                    self._number, self._values = int(numbers[index]), values
        self._end = end
        return self._number
