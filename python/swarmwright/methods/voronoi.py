"""Centroidal Voronoi tessellations: cells of nearly equal size for any number of measures."""

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from swarmwright.common.random_numbers import Streams
from swarmwright.methods.archive import Axis, Values, scale

if TYPE_CHECKING:
    from scipy.spatial import KDTree

_SAMPLES = 10
"""Samples of the space of measures for each cell."""
_FEWEST_SAMPLES = 10_000
_ITERATIONS = 10
"""Iterations of Lloyd's algorithm; later ones hardly move centroids."""
_TIE = 1e-9
"""Relative difference of distances up to which they are compared exactly: trees differ in the last bits."""
_ROWS = 64
"""Points that are compared with all centroids at once."""


@dataclass(frozen=True)
class Voronoi:
    """Cells of an archive: each has the points that are closer to its centroid than to all others.

    The centroids are spread evenly over the ranges of the measures by Lloyd's algorithm. They depend on the
    number of measures and cells alone, so that runs with different seeds have the same cells.

    Source: Vassiliades, Chatzilygeroudis and Mouret, "Using centroidal Voronoi tessellations to scale up the
    multidimensional archive of phenotypic elites algorithm", IEEE Transactions on Evolutionary Computation
    22(4), 2018.
    """

    axes: tuple[Axis, ...]
    """The measures, in order; at least one."""
    cells: int
    """Number of cells."""

    @property
    def centroids(self) -> Values:
        """The centroid of each cell in units of the measures, (cells, measures)."""
        low = np.array([axis.low for axis in self.axes])
        width = np.array([axis.high - axis.low for axis in self.axes])
        return np.asarray(low + _centroids(len(self.axes), self.cells) * width)

    def cells_of(self, measures: Values) -> NDArray[np.int64]:
        """Return the cells of candidates, (n,), from 0; -1 if a measure is not finite.

        Values beyond the range of a measure count as its end. Of equally near centroids the first counts.

        Args:
            measures: (n, measures).
        """
        finite: NDArray[np.bool_] = np.logical_and.reduce(np.isfinite(measures), axis=1)
        points = np.clip(scale(np.where(finite[:, np.newaxis], measures, 0.0), self.axes), 0.0, 1.0)
        return np.where(finite, find_nearest(points, _tree(len(self.axes), self.cells)), -1)


@lru_cache(maxsize=8)
def _tree(measures: int, cells: int) -> "KDTree":
    return _new_tree(_centroids(measures, cells))


def _new_tree(centroids: Values) -> "KDTree":
    from scipy.spatial import KDTree  # noqa: PLC0415 - takes long to import

    return KDTree(centroids)


@lru_cache(maxsize=8)
def _centroids(measures: int, cells: int) -> Values:
    """Return the centroids of cells of the unit cube, (cells, measures), by Lloyd's algorithm."""
    count = max(_FEWEST_SAMPLES, _SAMPLES * cells)
    samples = Streams(0, "map_elites.centroids", 0, [0]).units(count * measures).reshape(count, measures)
    centroids = samples[:cells]
    for _ in range(_ITERATIONS):
        nearest = find_nearest(samples, _new_tree(centroids))
        counts = np.bincount(nearest, minlength=cells)[:, np.newaxis]
        # bincount adds in the order of the samples, the same on every processor.
        sums = [np.bincount(nearest, weights=column, minlength=cells) for column in samples.T]
        centroids = np.where(counts > 0, np.stack(sums, axis=1) / np.maximum(counts, 1), centroids)
    centroids.flags.writeable = False
    return centroids


def find_nearest(points: Values, tree: "KDTree") -> NDArray[np.int64]:
    """Return the nearest point of a tree for each point, (n,); the first of equally near ones.

    The result is exact: squared differences are added in the order of the columns, in binary64, wherever
    the distances of the tree are nearly equal.
    """
    centroids = np.asarray(tree.data)
    if len(centroids) == 1:
        return np.zeros(len(points), dtype=np.int64)
    distances, indices = tree.query(points, k=2, workers=-1)
    nearest: NDArray[np.int64] = indices[:, 0].astype(np.int64)
    unclear = np.flatnonzero(distances[:, 1] <= distances[:, 0] * (1 + _TIE))
    for first in range(0, len(unclear), _ROWS):
        rows = unclear[first : first + _ROWS]
        nearest[rows] = compute_squared_distances(points[rows], centroids).argmin(axis=1)
    return nearest


def compute_squared_distances(points: Values, others: Values) -> Values:
    """Return squared distances, (points, others), added in the order of the columns."""
    total = np.zeros((len(points), len(others)))
    with np.errstate(over="ignore"):  # infinitely far
        for column in range(points.shape[1]):
            difference = points[:, column, np.newaxis] - others[:, column]
            total += difference * difference
    return total
