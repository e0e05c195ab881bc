"""Archives of elites for quality diversity, and fronts for multi-objective optimization."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from swarmwright.common.arrays import Fitness

Values = NDArray[np.float64]
"""(candidates, values)"""


_ROWS = 64
"""Number of rows that are compared with all others at once."""
_SORTED_COLUMNS = 2
"""Columns for which sorting replaces comparisons of all with all."""
_EPSILON = 1e-6
"""Share of a bin by which values are moved up, as bin edges are rounded."""


@dataclass(frozen=True)
class Axis:
    """A measure of an archive."""

    low: float
    high: float
    bins: int
    """Bins of a grid; 1 in other archives."""


def scale(measures: Values, axes: Sequence[Axis]) -> Values:
    """Return measures in units of their ranges: 0 at the low end, 1 at the high end, (n, measures)."""
    low = np.array([axis.low for axis in axes])
    width = np.array([axis.high - axis.low for axis in axes])
    with np.errstate(over="ignore"):  # far beyond the range
        return np.asarray((measures - low) / width)


def subtract(values: Values, others: Values) -> Values:
    """Return differences of finite numbers, at most the largest finite number."""
    largest = np.finfo(np.float64).max
    with np.errstate(over="ignore"):
        return np.clip(values - others, -largest, largest)


@dataclass(frozen=True)
class Grid:
    """Cells of an archive: the range of each measure is divided into equal bins."""

    axes: tuple[Axis, ...]
    """The measures, in order; at least one."""

    @property
    def shape(self) -> tuple[int, ...]:
        """Bins of each measure."""
        return tuple(axis.bins for axis in self.axes)

    @property
    def cells(self) -> int:
        """Number of cells."""
        return math.prod(self.shape)

    def cells_of(self, measures: Values) -> NDArray[np.int64]:
        """Return the cells of candidates, (n,), from 0; -1 if a measure is not finite.

        Values beyond the range of a measure belong to its first or last bin. The last measure varies fastest.
        As in the GridArchive of pyribs, values just below the edge of a bin due to rounding belong to it.

        Args:
            measures: (n, measures).
        """
        finite: NDArray[np.bool_] = np.logical_and.reduce(np.isfinite(measures), axis=1)
        bins = np.array(self.shape)
        low = np.array([measure.low for measure in self.axes])
        width = np.array([measure.high - measure.low for measure in self.axes])
        # pyribs adds 1e-6 in units of the measure, which could be many bins of a small range.
        with np.errstate(over="ignore"):  # far beyond the range
            above = bins * (np.where(finite[:, np.newaxis], measures, low) - low)
            positions = above / width + _EPSILON
        indices = np.clip(np.floor(positions), 0, bins - 1).astype(np.int64)
        cells = np.zeros(len(measures), dtype=np.int64)
        for axis, size in enumerate(self.shape):
            cells = cells * size + indices[:, axis]
        return np.where(finite, cells, -1)


class Cells(Protocol):
    """A division of the space of measures into cells: `Grid` or `Voronoi`."""

    @property
    def axes(self) -> tuple[Axis, ...]:
        """The measures, in order."""

    @property
    def cells(self) -> int:
        """Number of cells."""

    def cells_of(self, measures: Values) -> NDArray[np.int64]:
        """Return the cells of candidates, (n,), from 0; -1 if a measure is not finite."""


class Archive:
    """The best candidate of each cell, by number; the earlier of equal candidates stays."""

    def __init__(self, division: Cells) -> None:
        self.division = division
        self._fitness = np.full(division.cells, np.nan)  # by cell
        self._numbers = np.full(division.cells, -1, dtype=np.int64)
        self._winners = np.empty(division.cells, dtype=np.int64)  # rows of the last batch, where it has any
        self._count = 0

    def __len__(self) -> int:
        """Return the number of cells with an elite."""
        return self._count

    def add(
        self, numbers: Sequence[int] | NDArray[np.int64], fitness: Fitness, measures: Values
    ) -> NDArray[np.int64]:
        """Add candidates, one after the other; return cell and row of each new elite, (k, 2).

        Candidates without finite fitness and measures are skipped.

        Args:
            numbers: numbers of the candidates, n of them.
            fitness: (n,).
            measures: (n, measures).
        """
        cells = self.division.cells_of(measures)
        rows = np.flatnonzero((cells >= 0) & np.isfinite(fitness))
        taken_by = np.where(self._numbers[cells[rows]] < 0, -np.inf, self._fitness[cells[rows]])
        rows = rows[fitness[rows] > taken_by]
        # Of each cell the best, and the first of equals, which is written last.
        order = rows[np.argsort(-fitness[rows], kind="stable")[::-1]]
        self._winners[cells[order]] = order
        rows = rows[self._winners[cells[rows]] == rows]
        new = cells[rows]
        self._count += int((self._numbers[new] < 0).sum())
        self._fitness[new] = fitness[rows]
        self._numbers[new] = np.asarray(numbers)[rows]
        return np.stack([new, rows], axis=1)

    def compare(self, fitness: Fitness, measures: Values) -> tuple[NDArray[np.bool_], Fitness]:
        """Return which candidates are in empty cells, and fitness minus that of the cell's elite, (n,) each.

        In empty cells the difference is the fitness itself; it is NaN for candidates without finite fitness
        and measures.
        """
        cells = self.division.cells_of(measures)
        empty = self._numbers[cells] < 0
        values = np.where(empty, fitness, subtract(fitness, self._fitness[cells]))
        usable = (cells >= 0) & np.isfinite(fitness)
        return empty & usable, np.where(usable, values, np.nan)

    @property
    def cells(self) -> NDArray[np.int64]:
        """Cells with an elite, in order."""
        return np.flatnonzero(self._numbers >= 0)

    @property
    def numbers(self) -> NDArray[np.int64]:
        """Numbers of the elites, in the order of `cells`."""
        return self._numbers[self.cells]

    @property
    def fitness(self) -> Fitness:
        """Fitness of the elites, in the order of `cells`."""
        return self._fitness[self.cells]


def dominates(values: Values) -> NDArray[np.bool_]:
    """Return which rows dominate which, (n, n): as good in every column and better in one; higher is better.

    Rows with values that are not finite dominate no rows and are dominated by all finite rows.
    """
    finite: NDArray[np.bool_] = np.logical_and.reduce(np.isfinite(values), axis=1)
    filled = np.where(finite[:, np.newaxis], values, 0.0)
    at_least = np.ones((len(values), len(values)), dtype=bool)
    better = np.zeros_like(at_least)
    for column in filled.T:
        at_least &= column[:, np.newaxis] >= column
        better |= column[:, np.newaxis] > column
    both = finite[:, np.newaxis] & finite
    return np.where(both, at_least & better, finite[:, np.newaxis] & ~finite)


def front_with(front: Values, values: Values) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Merge rows into a front; return which rows of the front stay, and which new rows join, both (n,).

    New rows that equal an earlier row or one of the front do not join.

    Args:
        front: rows that do not dominate each other, finite.
        values: new rows, finite.
    """
    joins = np.zeros(len(values), dtype=bool)
    rest = np.flatnonzero(~are_covered(values, front))
    joins[rest[non_dominated(values[rest])]] = True
    return ~are_covered(front, values[joins]), joins


def non_dominated(values: Values) -> NDArray[np.int64]:
    """Return the rows that no other row dominates, ascending; of equal rows the first. Higher is better.

    values: (n, columns), finite, columns at least two. For two columns it takes n log n steps.
    """
    keys = (np.arange(len(values)), *(-column for column in values.T[::-1]))
    order = np.lexsort(keys)  # rows that dominate or equal another are before it
    if values.shape[1] == _SORTED_COLUMNS:
        second = values[order, 1]
        highest = np.maximum.accumulate(np.concatenate([[-np.inf], second[:-1]]))
        return np.sort(order[second > highest])
    selected: list[NDArray[np.int64]] = []
    while len(order):
        block, order = order[:_ROWS], order[_ROWS:]
        at_least = _compare_rows(values[block], values[block])
        block = block[~np.triu(at_least, 1).any(axis=0)]
        order = order[~are_covered(values[order], values[block])]
        selected.append(block)
    return np.sort(np.concatenate(selected)) if selected else order


def are_covered(values: Values, by: Values) -> NDArray[np.bool_]:
    """Return which rows some row of `by` equals or dominates, (n,). Higher is better.

    values, by: (n, columns) and (m, columns), finite, columns at least two.
    """
    if values.shape[1] == _SORTED_COLUMNS:
        order = np.argsort(by[:, 0])
        best = np.concatenate([np.maximum.accumulate(by[order[::-1], 1])[::-1], [-np.inf]])
        covered: NDArray[np.bool_] = best[np.searchsorted(by[order, 0], values[:, 0])] >= values[:, 1]
        return covered
    rest = np.arange(len(values))
    for first in range(0, len(by), _ROWS):
        if not len(rest):
            break
        rest = rest[~_compare_rows(by[first : first + _ROWS], values[rest]).any(axis=0)]
    covered = np.ones(len(values), dtype=bool)
    covered[rest] = False
    return covered


def _compare_rows(rows: Values, values: Values) -> NDArray[np.bool_]:
    """Return which rows are as good in every column as which values, (rows, values)."""
    at_least = np.ones((len(rows), len(values)), dtype=bool)
    for column in range(values.shape[1]):
        at_least &= rows[:, column, np.newaxis] >= values[:, column]
    return at_least


def ranks(values: Values, last: int | None = None) -> NDArray[np.int64]:
    """Return the number of the front of each row, (n,): 0 for non-dominated rows, then 1, and so on.

    last: last front to compute; later rows get -1. Default: all.

    Source: the non-dominated sorting of Deb, Pratap, Agarwal and Meyarivan, "A fast and elitist
    multiobjective genetic algorithm: NSGA-II", IEEE Transactions on Evolutionary Computation 6(2), 2002.
    """
    relation = dominates(values)
    dominators = relation.sum(axis=0)
    fronts = np.full(len(values), -1, dtype=np.int64)
    front = 0
    while (fronts < 0).any() and (last is None or front <= last):
        now = (dominators == 0) & (fronts < 0)
        fronts[now] = front
        dominators = dominators - relation[now].sum(axis=0)
        front += 1
    return fronts


def crowding(values: Values) -> Values:
    """Return the crowding distance of each row of one front, (n,): infinite at the ends of each column.

    Source: as `ranks`.
    """
    count = len(values)
    distances = np.zeros(count)
    for column in values.T:
        order = np.argsort(column, kind="stable")
        ordered = column[order]
        distances[order[[0, -1]]] = np.inf
        # Halves, so that the difference of two huge values is finite.
        width = ordered[-1] / 2 - ordered[0] / 2
        if count > 2 and width > 0:
            distances[order[1:-1]] += (ordered[2:] / 2 - ordered[:-2] / 2) / width
    return distances
