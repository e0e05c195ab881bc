"""Nearest neighbours in the space of behaviour, and the archive of past behaviours."""

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from swarmwright.common.arrays import Fitness
from swarmwright.methods.archive import Values

Indices = NDArray[np.int64]
Distance = Literal["euclidean", "manhattan"]
"""Distance between two behaviours."""

_MARGIN = 8
"""Neighbours to search for beyond those requested, so that ties are seen."""
_TOLERANCE = 1e-9
"""Relative error of distances in SciPy's tree, whose last bits depend on the machine; a generous bound."""
_MOST_COLUMNS_OF_TREE = 12
"""With more columns, comparing all points is faster than a tree."""
_BLOCK = 64
"""Points that are compared with all others at once."""
_QUIET = 10
"""Generations without new behaviours after which the threshold is lowered."""
_MANY = 4
"""New behaviours of a generation above which the threshold is raised."""


def find_nearest(
    points: Values, first: int, count: int, distance: Distance, *, ties: bool
) -> tuple[Values, Indices]:
    """Return the nearest neighbours of points[first:] among all other points: distances and indices.

    Both are (queries, min(count, points - 1)), the nearest first. Distances have the same bits on every
    machine.

    Args:
        points: (points, columns), finite.
        first: the first of the points whose neighbours are searched.
        count: number of neighbours, at least 1.
        distance: distance between two points.
        ties: whether of equally distant points, the earliest must be returned, which takes long if there are
            many equal points.
    """
    queries, count = len(points) - first, min(count, len(points) - 1)
    if count < 1 or queries < 1:
        return np.zeros((queries, 0)), np.zeros((queries, 0), dtype=np.int64)
    from scipy.spatial.distance import cdist  # noqa: PLC0415 - it takes long to import

    metric = "euclidean" if distance == "euclidean" else "cityblock"
    total = min(count + 1 + _MARGIN, len(points))
    numbers = np.arange(first, len(points))
    candidates = _find_candidates(points, numbers, total, metric)
    distances, neighbours = _sort(points, numbers, candidates, distance)
    last = distances[:, count - 1]
    # Beyond the candidates there may be points as near as the last neighbour.
    unsure = (distances[:, -2] <= last * (1 + _TOLERANCE)) & (ties | (last > 0)) & (total < len(points))
    for row in np.flatnonzero(unsure).tolist():
        number = numbers[row : row + 1]
        inside = cdist(points[number], points, metric) <= last[row] * (1 + _TOLERANCE)
        of_row = _sort(points, number, np.flatnonzero(inside)[np.newaxis], distance)
        distances[row, :count], neighbours[row, :count] = (values[0, :count] for values in of_row)
    return distances[:, :count], neighbours[:, :count]


def _find_candidates(points: Values, numbers: Indices, total: int, metric: str) -> Indices:
    """Return the `total` points nearest to some points, (numbers, total), except for rounding errors."""
    from scipy.spatial import cKDTree  # noqa: PLC0415
    from scipy.spatial.distance import cdist  # noqa: PLC0415

    if total == len(points):
        return np.broadcast_to(np.arange(total), (len(numbers), total))
    if points.shape[1] <= _MOST_COLUMNS_OF_TREE:
        norm = 2 if metric == "euclidean" else 1
        nearest: Indices = cKDTree(points).query(points[numbers], k=np.arange(1, total + 1), p=norm)[1]
        return nearest.astype(np.int64)
    blocks = [
        np.argpartition(cdist(points[block], points, metric), total - 1, axis=1)[:, :total]
        for block in np.array_split(numbers, range(_BLOCK, len(numbers), _BLOCK))
    ]
    return np.concatenate(blocks)


def _sort(
    points: Values, numbers: Indices, candidates: Indices, distance: Distance
) -> tuple[Values, Indices]:
    """Return distances and candidates, (queries, candidates) each, the nearest first.

    The point itself has the distance infinity.

    Args:
        points: (points, columns).
        numbers: (queries,), indices of points.
        candidates: (queries, candidates), indices of points.
        distance: distance between two points.
    """
    sums = np.zeros(candidates.shape)
    for column in points.T:  # in this order on every machine
        differences = np.abs(column[candidates] - column[numbers, np.newaxis])
        sums += differences * differences if distance == "euclidean" else differences
    distances = np.sqrt(sums) if distance == "euclidean" else sums
    distances[candidates == numbers[:, np.newaxis]] = np.inf
    order = np.lexsort((candidates, distances), axis=-1)
    return np.take_along_axis(distances, order, axis=1), np.take_along_axis(candidates, order, axis=1)


def mean_distances(distances: Values) -> Values:
    """Return the novelty of each row, (n,): the mean of the distances, (n, neighbours); 0 without any."""
    if not distances.shape[1]:
        return np.zeros(len(distances))
    sums: Values = np.add.accumulate(distances, axis=1)[:, -1]  # strictly one after another
    means: Values = sums / distances.shape[1]
    return means


class NoveltyArchive:
    """Past behaviours with their fitness, from which new ones should differ.

    Args:
        columns: numbers of a behaviour.
        size: behaviours to keep, the latest; 0: all.
        threshold: initial novelty above which `add_novel` adds behaviours.
    """

    def __init__(self, columns: int, size: int, threshold: float) -> None:
        self.points: Values = np.empty((0, columns))
        """(behaviours, columns)"""
        self.fitness: Fitness = np.empty(0)
        """(behaviours,)"""
        self.threshold = threshold
        self._size = size
        self._quiet = 0

    def __len__(self) -> int:
        """Return the number of behaviours."""
        return len(self.points)

    def add(self, points: Values, fitness: Fitness) -> None:
        """Add behaviours, (n, columns), with their fitness, (n,)."""
        remaining = slice(-self._size, None) if self._size else slice(None)
        self.points = np.concatenate([self.points, points])[remaining]
        self.fitness = np.concatenate([self.fitness, fitness])[remaining]

    def add_novel(self, points: Values, fitness: Fitness, novelty: Values) -> None:
        """Add the behaviours of a generation whose novelty, (n,), exceeds the threshold; then adapt it.

        Source: Lehman and Stanley, "Abandoning objectives: evolution through the search for novelty alone",
        Evolutionary Computation 19(2), 2011; generations as in FREVO instead of 2,500 evaluations.
        """
        novel = novelty > self.threshold
        self.add(points[novel], fitness[novel])
        self._quiet = 0 if novel.any() else self._quiet + 1
        if self._quiet == _QUIET:
            self._quiet = 0
            self.threshold *= 0.95
        elif novel.sum() > _MANY:
            self.threshold *= 1.2
