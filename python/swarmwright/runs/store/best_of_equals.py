"""The best of evaluations with equal fitness, in a run with several objectives."""

from collections.abc import Mapping, Sequence

import numpy as np

from swarmwright.common.statistics import means
from swarmwright.runs.store.generations import Generations, Row


class BestOfEquals:
    """Finds a non-dominated evaluation among those with the best fitness.

    It is the first evaluation with the best value of the first objective, then of the second, and so on. As a
    run grows, only new evaluations are read.

    Args:
        goals: "maximize" or "minimize" for each metric that is an objective besides the fitness.
        metrics: names of the stored metrics.
    """

    def __init__(self, goals: Mapping[str, str], metrics: Sequence[str]) -> None:
        self._columns = [metrics.index(name) for name in goals]
        self._signs = np.array([1.0 if goal == "maximize" else -1.0 for goal in goals.values()])
        self._stored = len(metrics)
        self._start_at(-1)

    def _start_at(self, leader: int) -> None:
        self._leader = leader
        self._end = leader  # evaluations before this number have been searched
        self._number = leader
        self._values: list[float] | None = None  # of the best, larger is better; None if none is finite

    def number(self, generations: Generations, last: Row) -> int:
        """Return the number of the best evaluation up to the generation `last`.

        The leader of that generation is the first evaluation with the best fitness.
        """
        end = last.summary.evaluations
        if last.leader != self._leader or end < self._end:
            self._start_at(last.leader)  # no earlier evaluation has its fitness
        best = generations.best_fitness(last.leader, last.leader + 1)
        for numbers, metrics in generations.select_by_fitness(best, self._end, end, self._stored):
            signed = means(metrics[:, :, self._columns]) * self._signs
            for index in np.flatnonzero(np.isfinite(signed).all(axis=1)):
                values = signed[index].tolist()
                if self._values is None or values > self._values:
                    self._number, self._values = int(numbers[index]), values
        self._end = end
        return self._number
