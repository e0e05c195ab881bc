"""Archives whose elites keep a distance."""

import numpy as np
import pytest

from swarmwright.methods.archive import Axis
from swarmwright.methods.unstructured import Unstructured

AXES = (Axis(0, 10, 1), Axis(-1, 1, 1))


def filled(parts: int, neighbours: int = 1, count: int = 600) -> tuple[Unstructured, list[tuple[int, int]]]:
    """An archive of random candidates, added in parts."""
    drawn = np.random.default_rng(5)
    measures, fitness = drawn.uniform([0, -1], [10, 1], (count, 2)), drawn.normal(size=count)
    fitness[::17], measures[::13, 0] = np.nan, np.nan
    archive = Unstructured(AXES, threshold=0.1, neighbours=neighbours)
    new = []
    for rows in np.array_split(np.arange(count), parts):
        added = archive.add(rows.tolist(), fitness[rows], measures[rows])
        new += [(place, int(rows[row])) for place, row in added.tolist()]
    return archive, new


@pytest.mark.parametrize("neighbours", [1, 3])
def test_it_does_not_depend_on_batches(neighbours: int) -> None:
    one, many = filled(1, neighbours), filled(37, neighbours)
    assert one[1] == many[1]
    assert one[0].numbers.tolist() == many[0].numbers.tolist()
    assert one[0].fitness.tolist() == many[0].fitness.tolist()


def test_candidates_join_far_from_elites_and_replace_worse_ones_nearby() -> None:
    archive = Unstructured(AXES, threshold=0.1, neighbours=1)

    def add(number: int, fitness: float, *measures: float) -> list[list[int]]:
        new: list[list[int]] = archive.add([number], np.array([fitness]), np.array([measures])).tolist()
        return new

    assert add(0, 1.0, 5.0, 0.0) == [[0, 0]]
    assert add(1, 1.0, 5.5, 0.0) == []  # 0.05 away and no better
    assert add(2, 2.0, 5.5, 0.0) == [[0, 0]]
    assert add(3, -9.0, 6.6, 0.0) == [[1, 0]]
    assert add(4, 0.0, 500.0, 0.0) == [[2, 0]]  # ranges are units, not limits
    assert add(5, np.nan, 0.0, 0.0) == add(6, 1.0, np.inf, 0.0) == []
    assert archive.numbers.tolist() == [2, 3, 4]
    assert archive.fitness.tolist() == [2.0, -9.0, 0.0]
    assert archive.cells.tolist() == [0, 1, 2]


def test_novelty_is_the_mean_over_neighbours() -> None:
    archive = Unstructured(AXES, threshold=0.25, neighbours=2)
    measures = np.array([[0.0, 0.0], [4.0, 0.0], [2.0, 0.0], [1.0, 0.0]])
    # The third is 0.2 from both; the fourth would be 0.1 and 0.3 from the first two.
    added = archive.add(range(4), np.zeros(4), measures)
    assert added.tolist() == [[0, 0], [1, 1]]


def test_no_addition_lowers_the_sum_above_the_worst_fitness() -> None:
    drawn = np.random.default_rng(8)
    archive, before = Unstructured(AXES, threshold=0.05, neighbours=1), 0.0
    for number in range(300):
        archive.add([number], drawn.random(1), drawn.uniform([0, -1], [10, 1], (1, 2)))
        after = float(archive.fitness.sum())
        assert after >= before
        before = after
    assert len(archive) > 64  # it has grown
