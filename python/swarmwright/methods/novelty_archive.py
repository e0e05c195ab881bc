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
"""Neighbours to search for beyond those requested, so that ties are noticed."""
_TOLERANCE = 1e-9
"""Relative error of distances in SciPy's tree, whose last bits depend on the machine; a generous bound."""
MOST_COLUMNS_OF_TREE = 12
"""With more columns, comparing all points is faster than a tree."""
_BLOCK = 4_000_000
"""Distances that are computed at once."""
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
        ties: whether of equally distant points, the earliest must be returned.
    """
    queries, count = len(points) - first, min(count, len(points) - 1)
    if count < 1 or queries < 1:
        return np.zeros((queries, 0)), np.zeros((queries, 0), dtype=np.int64)
    # Equal points have the same neighbours, for which count + 1 of them suffice: these are often thousands.
    groups, order = _group(points)
    numbers = np.arange(len(points)) - np.searchsorted(groups[order], groups[order])
    used = np.sort(order[numbers <= count])
    _, queried, group_of = np.unique(groups[first:], return_index=True, return_inverse=True)
    distances, neighbours = _search(points[used], points[first + queried], count + 1, distance, ties=ties)
    distances, neighbours = distances[group_of], used[neighbours][group_of]
    # A point is among its own neighbours, unless as many earlier ones are equal.
    own = neighbours == np.arange(first, len(points))[:, np.newaxis]
    columns = np.arange(count)
    columns = columns + (columns >= np.where(own.any(axis=1), own.argmax(axis=1), count)[:, np.newaxis])
    return np.take_along_axis(distances, columns, axis=1), np.take_along_axis(neighbours, columns, axis=1)


def _group(points: Values) -> tuple[Indices, Indices]:
    """Return the group of equal points of each point, from 0, and the points in the order of groups."""
    order = np.lexsort(points.T)
    is_new = (points[order[1:]] != points[order[:-1]]).any(axis=1)
    groups = np.empty(len(points), dtype=np.int64)
    groups[order] = np.concatenate([[0], np.cumsum(is_new)])
    return groups, order


def _search(
    points: Values, queries: Values, count: int, distance: Distance, *, ties: bool
) -> tuple[Values, Indices]:
    """Return the `count` points nearest to each query, (queries, count), of which there are enough."""
    from scipy.spatial import cKDTree  # noqa: PLC0415 - it takes long to import
    from scipy.spatial.distance import cdist  # noqa: PLC0415

    metric, norm = ("euclidean", 2) if distance == "euclidean" else ("cityblock", 1)
    total = min(count + _MARGIN, len(points))
    tree = None
    if total < len(points) and points.shape[1] <= MOST_COLUMNS_OF_TREE:
        tree = cKDTree(points)
    distances, neighbours = np.empty((len(queries), count)), np.empty((len(queries), count), dtype=np.int64)
    step = max(_BLOCK // (total if tree is not None else len(points)), 1)
    for begin in range(0, len(queries), step):
        block = queries[begin : begin + step]
        if total == len(points):
            candidates = np.broadcast_to(np.arange(total), (len(block), total))
        elif tree is not None:
            candidates = tree.query(block, k=np.arange(1, total + 1), p=norm)[1].astype(np.int64)
        else:
            every = cdist(block, points, metric)
            candidates = np.argpartition(every, total - 1, axis=1)[:, :total]
        nearest, indices = _sort(points, block, candidates, distance)
        last = nearest[:, count - 1]
        # Beyond the candidates there may be points as near as the last neighbour.
        unsure = (nearest[:, -1] <= last * (1 + _TOLERANCE)) & (ties | (last > 0)) & (total < len(points))
        for row in np.flatnonzero(unsure).tolist():
            query = block[row : row + 1]
            inside = cdist(query, points, metric) <= last[row] * (1 + _TOLERANCE)
            of_row = _sort(points, query, np.flatnonzero(inside)[np.newaxis], distance)
            nearest[row, :count], indices[row, :count] = (values[0, :count] for values in of_row)
        distances[begin : begin + step] = nearest[:, :count]
        neighbours[begin : begin + step] = indices[:, :count]
    return distances, neighbours


def _sort(points: Values, queries: Values, candidates: Indices, distance: Distance) -> tuple[Values, Indices]:
    """Return distances and candidates, (queries, candidates) each, the nearest first.

    Args:
        points: (points, columns).
        queries: (queries, columns).
        candidates: (queries, candidates), indices of points.
        distance: distance between two points.
    """
    sums = np.zeros(candidates.shape)
    for column in range(points.shape[1]):  # in this order on every machine
        differences = np.abs(points[candidates, column] - queries[:, column, np.newaxis])
        sums += differences * differences if distance == "euclidean" else differences
    distances = np.sqrt(sums) if distance == "euclidean" else sums
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
