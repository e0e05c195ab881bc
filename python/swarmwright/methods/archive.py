"""What quality diversity and multi-objective optimization keep: elites of cells, and fronts."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swarmwright.common.arrays import Fitness

Values = NDArray[np.float64]
"""Of each candidate (a row) several values (columns)."""


_EPSILON = 1e-6
"""Share of a bin by which values are moved up, since the ends of bins are rounded."""


@dataclass(frozen=True)
class Axis:
    """A measure by which an archive is divided into cells."""

    low: float
    high: float
    bins: int


@dataclass(frozen=True)
class Grid:
    """Cells of an archive: the range of each measure is divided into bins of the same width."""

    axes: tuple[Axis, ...]
    """The measures, in order; at least one."""

    @property
    def shape(self) -> tuple[int, ...]:
        """Bins of each measure."""
        return tuple(axis.bins for axis in self.axes)

    @property
    def cells(self) -> int:
        """How many there are."""
        return math.prod(self.shape)

    def cells_of(self, measures: Values) -> NDArray[np.int64]:
        """Return the cells of candidates, (n,), from 0; -1 where a measure is not finite.

        Values beyond the range of a measure belong to its first or last bin. The last measure counts fastest.
        As in the GridArchive of pyribs, values that rounding puts just below the begin of a bin belong to it.

        Args:
            measures: (n, measures).
        """
        known: NDArray[np.bool_] = np.logical_and.reduce(np.isfinite(measures), axis=1)
        bins = np.array(self.shape)
        low = np.array([measure.low for measure in self.axes])
        width = np.array([measure.high - measure.low for measure in self.axes])
        # pyribs adds 1e-6 in the unit of the measure, which could be many bins of a small range.
        with np.errstate(over="ignore"):  # far beyond the range
            above = bins * (np.where(known[:, np.newaxis], measures, low) - low)
            places = above / width + _EPSILON
        indices = np.clip(np.floor(places), 0, bins - 1).astype(np.int64)
        cells = np.zeros(len(measures), dtype=np.int64)
        for axis, size in enumerate(self.shape):
            cells = cells * size + indices[:, axis]
        return np.where(known, cells, -1)


class Archive:
    """The best candidate of each cell, by its number; of equally good ones the earliest stays."""

    def __init__(self, grid: Grid) -> None:
        self.grid = grid
        self._fitness = np.full(grid.cells, np.nan)  # by cell
        self._numbers = np.full(grid.cells, -1, dtype=np.int64)
        self._count = 0

    def __len__(self) -> int:
        """Return how many cells have an elite."""
        return self._count

    def add(self, numbers: Sequence[int], fitness: Fitness, measures: Values) -> list[tuple[int, int]]:
        """Add candidates, one after the other; return (cell, row) of those that are elites afterwards.

        Those whose fitness or measures are not finite are left out.

        Args:
            numbers: of the candidates, n of them.
            fitness: (n,).
            measures: (n, measures).
        """
        new: dict[int, int] = {}
        cells = self.grid.cells_of(measures).tolist()
        rows = zip(numbers, cells, fitness.tolist(), strict=True)
        for row, (number, cell, value) in enumerate(rows):
            if cell < 0 or not math.isfinite(value):
                continue
            if self._numbers[cell] < 0:
                self._count += 1
            elif not value > self._fitness[cell]:
                continue
            self._fitness[cell], self._numbers[cell] = value, number
            new[cell] = row
        return sorted(new.items())

    @property
    def cells(self) -> NDArray[np.int64]:
        """Cells that have an elite, in order."""
        return np.flatnonzero(self._numbers >= 0)

    @property
    def numbers(self) -> NDArray[np.int64]:
        """Numbers of the elites, in the order of `cells`."""
        return self._numbers[self.cells]

    @property
    def fitness(self) -> Fitness:
        """Their fitness."""
        return self._fitness[self.cells]


def dominates(values: Values) -> NDArray[np.bool_]:
    """Return which rows dominate which, (n, n): as good in every column and better in one; more is better.

    A row with a value that is not finite dominates nothing, and is dominated by all that are finite.
    """
    finite: NDArray[np.bool_] = np.logical_and.reduce(np.isfinite(values), axis=1)
    known = np.where(finite[:, np.newaxis], values, 0.0)
    at_least = np.ones((len(values), len(values)), dtype=bool)
    better = np.zeros_like(at_least)
    for column in known.T:
        at_least &= column[:, np.newaxis] >= column
        better |= column[:, np.newaxis] > column
    both = finite[:, np.newaxis] & finite
    return np.where(both, at_least & better, finite[:, np.newaxis] & ~finite)


def front_with(front: Values, values: Values) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return which rows of a front stay when others come, and which of those belong to it, both (n,).

    Rows that equal an earlier one, or one of the front, do not.

    Args:
        front: rows that do not dominate each other, finite.
        values: the others, finite.
    """
    _, first = np.unique(values, axis=0, return_index=True)
    joins = np.zeros(len(values), dtype=bool)
    joins[first] = ranks(values[first], last=0) == 0
    stays = np.ones(len(front), dtype=bool)
    for row in np.flatnonzero(joins):
        measured = values[row]
        as_good: NDArray[np.bool_] = np.logical_and.reduce(front >= measured, axis=1)
        joins[row] = not as_good.any()
        if joins[row]:
            stays &= ~np.logical_and.reduce(front <= measured, axis=1)
    return stays, joins


def ranks(values: Values, last: int | None = None) -> NDArray[np.int64]:
    """Return the front of each row, (n,): 0 for those that no row dominates, then 1, and so on.

    last: number of the last front that is looked for; the rows behind it have -1. Default: all.

    Source: the non-dominated sorting of Deb, Pratap, Agarwal and Meyarivan, "A fast and elitist
    multiobjective genetic algorithm: NSGA-II", IEEE Transactions on Evolutionary Computation 6(2), 2002.
    """
    relation = dominates(values)
    left = relation.sum(axis=0)
    found = np.full(len(values), -1, dtype=np.int64)
    front = 0
    while (found < 0).any() and (last is None or front <= last):
        now = (left == 0) & (found < 0)
        found[now] = front
        left = left - relation[now].sum(axis=0)
        front += 1
    return found


def crowding(values: Values) -> Values:
    """Return the crowding distance of each row of one front, (n,): infinite at the ends of each column.

    Source: as `ranks`.
    """
    count = len(values)
    found = np.zeros(count)
    for column in values.T:
        order = np.argsort(column, kind="stable")
        ordered = column[order]
        found[order[[0, -1]]] = np.inf
        # Halves, so that the difference of two huge values is finite.
        width = ordered[-1] / 2 - ordered[0] / 2
        if count > 2 and width > 0:
            found[order[1:-1]] += (ordered[2:] / 2 - ordered[:-2] / 2) / width
    return found
