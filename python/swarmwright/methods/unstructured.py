"""Archives without cells, in which elites keep a distance."""

from collections.abc import Sequence
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from swarmwright.common.arrays import Fitness
from swarmwright.methods.archive import Axis, Values, scale, subtract
from swarmwright.methods.voronoi import compute_squared_distances

MOST_ELITES = 100_000
"""Elites after which candidates only replace others."""


class Unstructured:
    """Elites whose behaviour was novel when they joined, or that replaced a worse elite nearby.

    A candidate joins if the mean distance to its nearest elites, in units of the ranges of the measures, is
    at least the threshold. Otherwise it replaces the nearest elite if its fitness is higher. Candidates are
    added one after the other, so that the archive does not depend on how they are divided into batches.

    Source: the archive of Lehman and Stanley, "Abandoning objectives: evolution through the search for
    novelty alone", Evolutionary Computation 19(2), 2011, with the local competition of `ProximityArchive` in
    pyribs, which compares a batch with the archive before it.
    """

    def __init__(self, axes: Sequence[Axis], *, threshold: float, neighbours: int) -> None:
        self._axes = axes
        self._threshold, self._neighbours = threshold, neighbours
        self._count = 0
        self._points: Values = np.empty((64, len(axes)))
        self._fitness = np.empty(64)
        self._numbers = np.empty(64, dtype=np.int64)

    def __len__(self) -> int:
        """Return the number of elites."""
        return self._count

    def add(
        self, numbers: Sequence[int] | NDArray[np.int64], fitness: Fitness, measures: Values
    ) -> NDArray[np.int64]:
        """Add candidates, one after the other; return place and row of each that became an elite, (k, 2).

        A later one may have replaced an earlier one. Candidates without finite fitness and measures are
        skipped.

        Args:
            numbers: numbers of the candidates, n of them.
            fitness: (n,).
            measures: (n, measures).
        """
        points = scale(measures, self._axes)
        usable = np.isfinite(fitness) & np.logical_and.reduce(np.isfinite(points), axis=1)
        new = []
        for row in np.flatnonzero(usable).tolist():
            slot = self._find_place(points[row], float(fitness[row]))
            if slot is not None:
                self._points[slot], self._fitness[slot] = points[row], fitness[row]
                self._numbers[slot] = numbers[row]
                new.append((slot, row))
        return np.array(new, dtype=np.int64).reshape(-1, 2)

    def compare(self, fitness: Fitness, measures: Values) -> tuple[NDArray[np.bool_], Fitness]:
        """Return which candidates are novel, and fitness minus that of the nearest elite, (n,) each.

        For novel candidates the difference is the fitness itself; it is NaN for candidates without finite
        fitness and measures. All are compared with the archive as it is.
        """
        points = scale(measures, self._axes)
        usable = np.isfinite(fitness) & np.logical_and.reduce(np.isfinite(points), axis=1)
        new, nearest = np.zeros(len(fitness), dtype=bool), np.full(len(fitness), np.nan)
        for row in np.flatnonzero(usable).tolist():
            distances = compute_squared_distances(points[row][np.newaxis], self._points[: self._count])[0]
            new[row] = self._is_novel(distances)
            nearest[row] = 0.0 if new[row] else self._fitness[distances.argmin()]
        return new, subtract(fitness, nearest)

    def _is_novel(self, distances: NDArray[np.float64]) -> bool:
        """Return whether a candidate at these squared distances from the elites joins."""
        if not self._count < MOST_ELITES:
            return False
        if len(distances) > self._neighbours:
            distances = np.partition(distances, self._neighbours - 1)[: self._neighbours]
        nearest = np.sort(distances).tolist()
        return not nearest or sum(map(sqrt, nearest)) / len(nearest) >= self._threshold

    def _find_place(self, point: NDArray[np.float64], fitness: float) -> int | None:
        """Return the place that a candidate gets; None if it does not become an elite."""
        distances = compute_squared_distances(point[np.newaxis], self._points[: self._count])[0]
        if self._is_novel(distances):
            self._grow()
            self._count += 1
            return self._count - 1
        slot = int(distances.argmin())
        return slot if fitness > self._fitness[slot] else None

    def _grow(self) -> None:
        if self._count == len(self._fitness):
            for name in ("_points", "_fitness", "_numbers"):
                values = getattr(self, name)
                setattr(self, name, np.concatenate([values, np.empty_like(values)]))

    @property
    def cells(self) -> NDArray[np.int64]:
        """Places of the elites, in order."""
        return np.arange(self._count)

    @property
    def numbers(self) -> NDArray[np.int64]:
        """Numbers of the elites, in the order of `cells`."""
        return self._numbers[: self._count].copy()

    @property
    def fitness(self) -> Fitness:
        """Fitness of the elites, in the order of `cells`."""
        return self._fitness[: self._count].copy()
