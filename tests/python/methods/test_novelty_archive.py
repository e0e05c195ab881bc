"""Nearest behaviours against all distances, and the rules of the archive."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from swarmwright.methods.novelty_archive import Distance, NoveltyArchive, find_nearest, mean_distances

Points = NDArray[np.float64]


def compared_with_all(
    points: Points, first: int, count: int, distance: Distance
) -> tuple[Points, NDArray[np.int64]]:
    """The same by comparing all with all, one after the other."""
    rows = []
    for number in range(first, len(points)):
        differences = np.abs(points - points[number])
        if distance == "euclidean":
            sums = np.zeros(len(points))
            for column in (differences * differences).T:
                sums += column
            values = np.sqrt(sums)
        else:
            values = np.add.accumulate(differences, axis=1)[:, -1]
        order = [other for other in np.argsort(values, kind="stable") if other != number][:count]
        rows.append((values[order], order))
    return np.array([row[0] for row in rows]), np.array([row[1] for row in rows])


@pytest.mark.parametrize("distance", ["euclidean", "manhattan"])
@pytest.mark.parametrize(("columns", "levels"), [(1, 0), (2, 0), (2, 7), (3, 3), (5, 2), (15, 0), (20, 2)])
def test_neighbours_are_those_of_a_comparison_with_all(columns: int, levels: int, distance: Distance) -> None:
    """levels: of a lattice on which many points are equal, or equally distant."""
    rng = np.random.default_rng(columns)
    points = rng.random((400, columns))
    if levels:
        points = np.floor(points * levels) / levels * 0.7
    for first, count in ((300, 15), (399, 1), (0, 3), (390, 500)):
        distances, neighbours = find_nearest(points, first, count, distance, ties=True)
        expected, others = compared_with_all(points, first, count, distance)
        assert distances.tobytes() == expected.tobytes()
        assert neighbours.tolist() == others.tolist()
        assert find_nearest(points, first, count, distance, ties=False)[0].tobytes() == expected.tobytes()


@pytest.mark.parametrize("ties", [False, True])
def test_equal_points_are_compared_once(ties: bool) -> None:
    """Each with each would take minutes."""
    points = np.concatenate([np.zeros((100_000, 2)), [[1.0, 0.0]]])
    distances, neighbours = find_nearest(points, 50_000, 3, "euclidean", ties=ties)
    assert distances[:-1].max() == 0
    assert distances[-1].tolist() == [1, 1, 1]
    assert neighbours[-1].tolist() == neighbours[0].tolist() == [0, 1, 2]


def test_novelty_is_the_mean_distance() -> None:
    assert mean_distances(np.array([[1.0, 2.0], [0.0, 5.0]])).tolist() == [1.5, 2.5]
    assert mean_distances(np.empty((3, 0))).tolist() == [0, 0, 0]
    distances, neighbours = find_nearest(np.zeros((1, 2)), 0, 15, "euclidean", ties=True)
    assert distances.shape == neighbours.shape == (1, 0)


def test_the_latest_stay() -> None:
    archive = NoveltyArchive(1, size=3, threshold=0.0)
    for number in range(5):
        archive.add(np.array([[number * 1.0]]), np.array([number * 10.0]))
        assert len(archive) == min(number + 1, 3)
    assert archive.points[:, 0].tolist() == [2, 3, 4]
    assert archive.fitness.tolist() == [20, 30, 40]


def add(archive: NoveltyArchive, novelty: Any) -> None:
    points = np.array(novelty, dtype=np.float64)[:, np.newaxis]
    archive.add_novel(points, points[:, 0], points[:, 0])


def test_the_threshold_adapts() -> None:
    archive = NoveltyArchive(1, size=0, threshold=1.0)
    add(archive, [0.5, 1.0, 1.5, 2.0, 3.0, 4.0])
    assert archive.points[:, 0].tolist() == [1.5, 2.0, 3.0, 4.0]
    assert archive.threshold == 1.0, "four are not many"
    add(archive, [2, 2, 2, 2, 2])
    assert archive.threshold == 1.2
    for _ in range(9):
        add(archive, [1.1])
    assert archive.threshold == 1.2
    add(archive, [])
    assert archive.threshold == pytest.approx(1.2 * 0.95)
    for _ in range(10):
        add(archive, [0.1])
    assert archive.threshold == pytest.approx(1.2 * 0.95**2)
    assert len(archive) == 9
