"""Cells of centroidal Voronoi tessellations."""

import hashlib
from itertools import pairwise

import numpy as np
import pytest

from swarmwright.methods.archive import Axis
from swarmwright.methods.voronoi import Voronoi, compute_squared_distances, find_nearest

CELLS = Voronoi((Axis(-1, 3, 1), Axis(10, 20, 1)), 200)


def points(count: int, seed: int = 1) -> np.ndarray:
    return np.random.default_rng(seed).uniform([-1, 10], [3, 20], (count, 2))


def test_every_point_is_in_the_cell_of_its_nearest_centroid() -> None:
    drawn = points(3000)
    scaled = [(values - [-1, 10]) / [4, 10] for values in (drawn, CELLS.centroids)]
    assert CELLS.cells_of(drawn).tolist() == compute_squared_distances(*scaled).argmin(axis=1).tolist()


def test_each_centroid_is_in_its_own_cell_and_cells_are_about_equal() -> None:
    assert CELLS.cells_of(CELLS.centroids).tolist() == list(range(200))
    counts = np.bincount(CELLS.cells_of(points(100_000)), minlength=200)
    assert 200 < counts.min() <= counts.max() < 1000  # 500 on average


def test_values_beyond_the_range_count_as_its_end() -> None:
    beyond = np.array([[-5.0, 12.0], [1e300, 15.0], [0.0, -1e300], [np.nan, 12.0], [0.0, np.inf]])
    ends = np.array([[-1.0, 12.0], [3.0, 15.0], [0.0, 10.0]])
    assert CELLS.cells_of(beyond).tolist() == [*CELLS.cells_of(ends).tolist(), -1, -1]


def test_equally_near_centroids() -> None:
    from scipy.spatial import KDTree

    centroids = np.array([[0.0, 1.0], [1.0, 0.0], [0.0, 0.0], [1.0, 1.0]])
    tree = KDTree(centroids)
    # Halfway between all, between the last two, and one rounding off.
    between = np.array([[0.5, 0.5], [np.nextafter(0.5, 1), 0.5], [0.5, 0.0], [0.5, np.nextafter(0.5, 0)]])
    assert find_nearest(between, tree).tolist() == [0, 1, 1, 1]


def test_the_centroids_are_the_same_everywhere() -> None:
    digest = hashlib.sha256(Voronoi((Axis(0, 1, 1),) * 3, 50).centroids.tobytes()).hexdigest()
    assert digest == "23510e747454d17a43688dae73f81125ad146839839432b49fa7ff78d065da3b"


def test_cells_of_one_measure_divide_its_range() -> None:
    centroids = np.sort(Voronoi((Axis(0, 1, 1),), 20).centroids[:, 0]).tolist()
    assert all(0.02 < after - before < 0.09 for before, after in pairwise(centroids))


@pytest.mark.parametrize("cells", [1, 2])
def test_few_cells(cells: int) -> None:
    few = Voronoi((Axis(0, 1, 1),) * 2, cells)
    assert set(few.cells_of(np.random.default_rng(2).random((100, 2))).tolist()) == set(range(cells))
