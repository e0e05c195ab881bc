"""The transferability approach: learn how well a fast simulation transfers, and optimize it."""

from typing import ClassVar, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from swarmwright.common.arrays import Fitness, best_first
from swarmwright.methods.rankings.slow_simulation import (
    Episodes,
    Ranked,
    Rounds,
    SlowOptions,
    SlowRanking,
    compress_below,
    row_means,
)

Values = NDArray[np.float64]

_SMALLEST_SQUARED_DISTANCE = 1e-200
"""Squared distance below which candidates coincide, as their weight could be infinite."""


class TransferabilityOptions(SlowOptions):
    """Candidates whose behaviour differs between the two simulations are penalized."""

    kind: Literal["transferability"] = "transferability"
    threshold: float = Field(ge=0)
    """Difference between fast and slow fitness without penalty, in units of fitness."""
    weight: float = Field(default=1.0, gt=0)
    """Penalty per unit of difference above the threshold."""
    every: int = Field(default=1, ge=1, le=100_000)
    """Interval of evaluations in the slow simulation, in generations."""
    transfers: int = Field(default=2, ge=1, le=100_000)
    """Candidates per such generation to evaluate in the slow simulation."""
    descriptor: list[str] = Field(default=[])
    """Metrics of the fast simulation that describe behaviour. Default: all announced metrics, or else the
    fitness."""


class _Knowledge(NamedTuple):
    """Knowledge about the candidates evaluated in both simulations."""

    descriptors: Values
    """(known, metrics)"""
    disparities: Values
    """(known,)"""
    low: Values
    """(metrics,) smallest value of each metric of all candidates so far."""
    high: Values
    """(metrics,) greatest value."""
    best: float
    """Highest fitness of candidates evaluated in both; -inf without any."""
    generations: int


class Transferability(SlowRanking):
    """Fitness of the fast simulation, with a penalty for its difference from the slow one above a threshold.

    The disparity of a candidate is the absolute difference of its mean fitness in the two simulations, in
    episodes with the same seeds. A few candidates are evaluated in both. For the others it is predicted from
    them by inverse distance weighting (Shepard 1968, power two), with the means of metrics of the fast
    simulation as coordinates, each divided by its range in the run. The fitness of a candidate is its fast
    fitness minus `weight` times the disparity above `threshold`. With a predicted disparity it is kept below
    the best fitness with a known one, in order, so that the best of a run was always evaluated in both.

    In every generation, or every few, `transfers` candidates are evaluated in both: alternately the one with
    the highest predicted fitness, and the one whose behaviour is farthest from all known or chosen ones. If
    all of them fail in the slow simulation, further candidates are evaluated.

    Source: Koos, Mouret and Doncieux, "The transferability approach: crossing the reality gap in evolutionary
    robotics", IEEE Transactions on Evolutionary Computation 17(1), 2013, doi:10.1109/TEVC.2012.2185849.
    In the source, disparity is a separate objective besides fitness and diversity.
    """

    kind: ClassVar[str] = "transferability"
    options_model = TransferabilityOptions
    options: TransferabilityOptions

    def __init__(self, options: TransferabilityOptions) -> None:
        super().__init__(options)
        self._knowledge: _Knowledge | None = None

    @property
    def descriptor(self) -> tuple[str, ...]:
        """Names of the required metrics of the fast simulation."""
        return tuple(self.options.descriptor)

    def count_transfers(self, candidates: int) -> int:
        """Return the number of candidates to evaluate in the slow simulation, in generations with any."""
        return min(candidates, self.options.transfers)

    def rounds(self, fast: Episodes, metrics: NDArray[np.float64]) -> Rounds:
        """Choose the best candidates and those that differ most from known ones; see `SlowRanking.rounds`."""
        approximate = row_means(fast)
        working = np.isfinite(approximate)
        points = _descriptors(approximate, metrics)
        knowledge = self._prepare_knowledge(points[working])
        measured = np.zeros(len(fast), dtype=np.bool_)
        slow = np.full(len(fast), np.nan)
        is_due = knowledge.generations % self.options.every == 0
        count = self.count_transfers(len(fast)) if is_due else 0
        while count and (remaining := working & ~measured).any() and not np.isfinite(slow).any():
            chosen = np.sort(self._choose(knowledge, approximate, points, remaining, count))
            slow[chosen] = row_means((yield chosen))
            measured[chosen] = True
        for row in np.flatnonzero(np.isfinite(slow)).tolist():
            knowledge = self._with_candidate(
                knowledge, points[row], float(approximate[row]), float(slow[row])
            )
        fitness = self._fitness(knowledge, approximate, points, measured, slow)
        return Ranked(fitness, knowledge._replace(generations=knowledge.generations + 1))

    def learn(self, learned: _Knowledge) -> None:
        """Store the knowledge."""
        self._knowledge = learned

    def _prepare_knowledge(self, points: Values) -> _Knowledge:
        """Return the knowledge before a generation, with ranges extended by its metrics."""
        before = self._knowledge
        if before is None:
            count = points.shape[1]
            empty = np.full(count, np.inf)
            before = _Knowledge(np.empty((0, count)), np.empty(0), empty, -empty, -np.inf, 0)
        low = np.minimum(before.low, points.min(axis=0, initial=np.inf))
        high = np.maximum(before.high, points.max(axis=0, initial=-np.inf))
        return before._replace(low=low, high=high)

    def _with_candidate(self, knowledge: _Knowledge, point: Values, fast: float, slow: float) -> _Knowledge:
        """Return the knowledge extended by a candidate."""
        disparity = abs(slow - fast)
        return knowledge._replace(
            descriptors=np.concatenate([knowledge.descriptors, point[np.newaxis]]),
            disparities=np.append(knowledge.disparities, disparity),
            best=max(knowledge.best, float(self._penalize(fast, disparity))),
        )

    def _choose(
        self, knowledge: _Knowledge, fast: Fitness, points: Values, remaining: NDArray[np.bool_], count: int
    ) -> list[int]:
        """Return up to `count` of the remaining candidates to evaluate in both simulations."""
        rows = np.flatnonzero(remaining)
        expected = fast[rows]
        nearest = np.full(len(rows), np.inf)
        if len(knowledge.disparities):
            squares = _distances(knowledge, points[rows], knowledge.descriptors)
            expected = self._penalize(expected, _predict(knowledge, squares))
            nearest = squares.min(axis=1)
        order, chosen = list(best_first(expected)), list[int]()
        while order and len(chosen) < count:
            next_row = order[0] if len(chosen) % 2 == 0 else max(order, key=lambda row: nearest[row])
            order.remove(next_row)
            chosen.append(int(rows[next_row]))
            nearest = np.minimum(
                nearest, _distances(knowledge, points[rows], points[rows[next_row], np.newaxis])[:, 0]
            )
        return chosen

    def _fitness(
        self,
        knowledge: _Knowledge,
        fast: Fitness,
        points: Values,
        measured: NDArray[np.bool_],
        slow: Fitness,
    ) -> Fitness:
        fitness = np.full(len(fast), np.nan)
        with np.errstate(invalid="ignore"):
            fitness[measured] = self._penalize(fast[measured], np.abs(slow - fast)[measured])
        unmeasured = np.isfinite(fast) & ~measured
        if unmeasured.any() and len(knowledge.disparities):
            predicted = _predict(knowledge, _distances(knowledge, points[unmeasured], knowledge.descriptors))
            fitness[unmeasured] = compress_below(self._penalize(fast[unmeasured], predicted), knowledge.best)
        fitness[~np.isfinite(fitness)] = np.nan
        return fitness + 0.0

    def _penalize(self, fast: Values | float, disparity: Values | float) -> Values:
        excess = np.maximum(0.0, np.subtract(disparity, self.options.threshold))
        penalized: Values = fast - self.options.weight * excess
        return penalized


def _descriptors(fast: Fitness, metrics: NDArray[np.float64]) -> Values:
    """Return (candidates, metrics) means over episodes; the fitness without metrics."""
    if not metrics.shape[2]:
        return np.nan_to_num(fast)[:, np.newaxis]
    columns = [row_means(metrics[:, :, index]) for index in range(metrics.shape[2])]
    return np.nan_to_num(np.stack(columns, axis=1))


def _distances(knowledge: _Knowledge, points: Values, targets: Values) -> Values:
    """Return (places, others) squared distances, with metrics divided by their ranges."""
    span = knowledge.high - knowledge.low
    squares = np.zeros((len(points), len(targets)))
    # Metric by metric, in order, for the same bits everywhere.
    for index in np.flatnonzero(np.isfinite(span) & (span > 0)):
        squares += ((points[:, index, np.newaxis] - targets[:, index]) / span[index]) ** 2
    return squares


def _predict(knowledge: _Knowledge, squares: Values) -> Values:
    """Predict the disparities of candidates, (candidates,), from squared distances to known ones."""
    same = squares < _SMALLEST_SQUARED_DISTANCE
    weights = np.where(same.any(axis=1, keepdims=True), same, 1 / np.where(same, 1.0, squares))
    sums = np.add.accumulate(weights, axis=1)[:, -1]
    estimates: Values = np.add.accumulate(weights * knowledge.disparities, axis=1)[:, -1] / sums
    return estimates
