"""The transferability approach: how far the fast simulation can be trusted is learned, and optimized."""

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
    kept_below,
    row_means,
)

Values = NDArray[np.float64]

_SMALLEST_SQUARED_DISTANCE = 1e-200
"""Squared distance below which candidates are at one place: the weight of a smaller one could be infinite."""


class TransferabilityOptions(SlowOptions):
    """Candidates whose behaviour differs between the two simulations are penalized."""

    kind: Literal["transferability"] = "transferability"
    threshold: float = Field(ge=0)
    """Difference between fast and slow fitness that is not penalized, in units of fitness."""
    weight: float = Field(default=1.0, gt=0)
    """Fitness that is subtracted for each unit of difference above the threshold."""
    every: int = Field(default=1, ge=1, le=100_000)
    """Generations from one in which candidates are evaluated in the slow simulation to the next one."""
    transfers: int = Field(default=2, ge=1, le=100_000)
    """Candidates of such a generation that are evaluated in the slow simulation."""
    descriptor: list[str] = Field(default=[])
    """Metrics of the fast simulation that describe a candidate's behaviour. Default: all that it announces;
    of a simulation without metrics, the fitness."""


class _Known(NamedTuple):
    """What is known of the candidates that were evaluated in both simulations."""

    descriptors: Values
    """(known, metrics)"""
    disparities: Values
    """(known,)"""
    low: Values
    """(metrics,) least value of each metric so far, of all candidates."""
    high: Values
    """(metrics,) greatest value."""
    best: float
    """Greatest fitness of those that were evaluated in both; -inf without any."""
    generations: int


class Transferability(SlowRanking):
    """The fitness of the fast simulation, less what it differs by from the slow one above a threshold.

    The disparity of a candidate is the absolute difference of its mean fitness in the two simulations, in
    episodes with the same seeds. A few candidates are evaluated in both. For the others it is predicted by
    inverse distance weighting (Shepard 1968, power two) of those few, with the means of metrics of the fast
    simulation as coordinates, each divided by the range that it has had in the run. The fitness of a
    candidate is its fast one minus `weight` times what its disparity exceeds `threshold` by. That of a
    candidate whose disparity is predicted is kept below that of the best one so far whose disparity is known,
    so that the best of a run was always evaluated in both; several such candidates keep their order.

    In every generation, or every few ones, `transfers` candidates are evaluated in both: by turns the one
    with the greatest predicted fitness, and the one whose behaviour is farthest from all that are known or
    chosen.
    Where all of them fail in the slow simulation, others are evaluated, until one does not.

    Source: Koos, Mouret and Doncieux, "The transferability approach: crossing the reality gap in evolutionary
    robotics", IEEE Transactions on Evolutionary Computation 17(1), 2013, doi:10.1109/TEVC.2012.2185849.
    There, disparity is an objective of its own beside fitness and diversity.
    """

    kind: ClassVar[str] = "transferability"
    options_model = TransferabilityOptions
    options: TransferabilityOptions

    def __init__(self, options: TransferabilityOptions) -> None:
        super().__init__(options)
        self._known: _Known | None = None

    @property
    def descriptor(self) -> tuple[str, ...]:
        """Names of metrics of the fast simulation that it needs."""
        return tuple(self.options.descriptor)

    def expected(self, candidates: int) -> int:
        """Return how many candidates are evaluated in the slow simulation, of a generation where any are."""
        return min(candidates, self.options.transfers)

    def rounds(self, fast: Episodes, metrics: NDArray[np.float64]) -> Rounds:
        """Choose the best and those that are unlike the known ones; see `SlowRanking.rounds`."""
        approximate = row_means(fast)
        working = np.isfinite(approximate)
        places = _descriptors(approximate, metrics)
        known = self._begun(places[working])
        measured = np.zeros(len(fast), dtype=np.bool_)
        slow = np.full(len(fast), np.nan)
        some = known.generations % self.options.every == 0
        wanted = self.expected(len(fast)) if some else 0
        while wanted and (left := working & ~measured).any() and not np.isfinite(slow).any():
            who = np.sort(self._choice(known, approximate, places, left, wanted))
            slow[who] = row_means((yield who))
            measured[who] = True
        for row in np.flatnonzero(np.isfinite(slow)).tolist():
            known = self._with_candidate(known, places[row], float(approximate[row]), float(slow[row]))
        fitness = self._fitness(known, approximate, places, measured, slow)
        return Ranked(fitness, known._replace(generations=known.generations + 1))

    def learn(self, learned: _Known) -> None:
        """Keep what is known."""
        self._known = learned

    def _begun(self, places: Values) -> _Known:
        """Return what is known before a generation, with the ranges that its metrics have."""
        before = self._known
        if before is None:
            count = places.shape[1]
            empty = np.full(count, np.inf)
            before = _Known(np.empty((0, count)), np.empty(0), empty, -empty, -np.inf, 0)
        low = np.minimum(before.low, places.min(axis=0, initial=np.inf))
        high = np.maximum(before.high, places.max(axis=0, initial=-np.inf))
        return before._replace(low=low, high=high)

    def _with_candidate(self, known: _Known, place: Values, fast: float, slow: float) -> _Known:
        """Return what is known with one more candidate."""
        disparity = abs(slow - fast)
        return known._replace(
            descriptors=np.concatenate([known.descriptors, place[np.newaxis]]),
            disparities=np.append(known.disparities, disparity),
            best=max(known.best, float(self._penalized(fast, disparity))),
        )

    def _choice(
        self, known: _Known, fast: Fitness, places: Values, left: NDArray[np.bool_], count: int
    ) -> list[int]:
        """Return who is evaluated in both simulations, `count` of those that are left, or all."""
        rows = np.flatnonzero(left)
        expected = fast[rows]
        near = np.full(len(rows), np.inf)
        if len(known.disparities):
            squares = _distances(known, places[rows], known.descriptors)
            expected = self._penalized(expected, _predicted(known, squares))
            near = squares.min(axis=1)
        order, chosen = list(best_first(expected)), list[int]()
        while order and len(chosen) < count:
            next_row = order[0] if len(chosen) % 2 == 0 else max(order, key=lambda row: near[row])
            order.remove(next_row)
            chosen.append(int(rows[next_row]))
            near = np.minimum(near, _distances(known, places[rows], places[rows[next_row], np.newaxis])[:, 0])
        return chosen

    def _fitness(
        self,
        known: _Known,
        fast: Fitness,
        places: Values,
        measured: NDArray[np.bool_],
        slow: Fitness,
    ) -> Fitness:
        fitness = np.full(len(fast), np.nan)
        with np.errstate(invalid="ignore"):
            fitness[measured] = self._penalized(fast[measured], np.abs(slow - fast)[measured])
        others = np.isfinite(fast) & ~measured
        if others.any() and len(known.disparities):
            predicted = _predicted(known, _distances(known, places[others], known.descriptors))
            fitness[others] = kept_below(self._penalized(fast[others], predicted), known.best)
        fitness[~np.isfinite(fitness)] = np.nan
        return fitness + 0.0

    def _penalized(self, fast: Values | float, disparity: Values | float) -> Values:
        excess = np.maximum(0.0, np.subtract(disparity, self.options.threshold))
        found: Values = fast - self.options.weight * excess
        return found


def _descriptors(fast: Fitness, metrics: NDArray[np.float64]) -> Values:
    """Return (candidates, metrics) means over episodes; the fitness where there are no metrics."""
    if not metrics.shape[2]:
        return np.nan_to_num(fast)[:, np.newaxis]
    columns = [row_means(metrics[:, :, index]) for index in range(metrics.shape[2])]
    return np.nan_to_num(np.stack(columns, axis=1))


def _distances(known: _Known, places: Values, others: Values) -> Values:
    """Return (places, others) squares of distances, each metric divided by the range that it has had."""
    span = known.high - known.low
    squares = np.zeros((len(places), len(others)))
    # Metric by metric, in order: the same bits everywhere.
    for index in np.flatnonzero(np.isfinite(span) & (span > 0)):
        squares += ((places[:, index, np.newaxis] - others[:, index]) / span[index]) ** 2
    return squares


def _predicted(known: _Known, squares: Values) -> Values:
    """Return the disparities of candidates, (candidates,), by their squared distances from known ones."""
    same = squares < _SMALLEST_SQUARED_DISTANCE
    weights = np.where(same.any(axis=1, keepdims=True), same, 1 / np.where(same, 1.0, squares))
    sums = np.add.accumulate(weights, axis=1)[:, -1]
    found: Values = np.add.accumulate(weights * known.disparities, axis=1)[:, -1] / sums
    return found
