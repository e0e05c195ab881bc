"""Archives and fronts, against what their definitions say."""

import math
from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray
from pymoo.operators.survival.rank_and_crowding.metrics import calc_crowding_distance
from pymoo.util.nds.non_dominated_sorting import NonDominatedSorting

from swarmwright.methods.archive import (
    Archive,
    Axis,
    Grid,
    are_covered,
    crowding,
    front_with,
    non_dominated,
    ranks,
)

GRID = Grid((Axis(0.0, 1.0, 4), Axis(-10.0, 10.0, 3)))


def random(seed: int, *shape: int) -> NDArray[np.float64]:
    return np.random.default_rng(seed).random(shape)


def test_cells_divide_the_ranges_and_what_lies_beyond_belongs_to_the_ends() -> None:
    measures = np.array(
        [[0.0, -10.0], [0.249, -3.4], [0.25, -3.3], [1.0, 10.0], [-5.0, 99.0], [1e300, -1e300], [0.5, 0.0]]
    )
    assert GRID.cells == 12
    assert GRID.cells_of(measures).tolist() == [0, 0, 4, 11, 2, 9, 7]


@pytest.mark.parametrize("bins", [1, 3, 7, 49, 100, 1000])
@pytest.mark.parametrize("scale", [1.0, 0.12, 1e-9, 3e7, 1e300])
def test_the_begin_of_a_bin_belongs_to_it_however_it_is_rounded(bins: int, scale: float) -> None:
    for low in (0.0, -0.3 * scale):
        grid = Grid((Axis(low, low + scale, bins),))
        begins = np.array([[low + scale * (number / bins)] for number in range(bins)])
        assert grid.cells_of(begins).tolist() == list(range(bins))
        inside = np.array([[low + scale * ((number + 0.999) / bins)] for number in range(bins)])
        assert grid.cells_of(inside).tolist() == list(range(bins))


@pytest.mark.parametrize("largest", [3, 10, 49, 1000])
def test_whole_numbers_have_a_bin_each(largest: int) -> None:
    numbers = np.arange(largest + 1.0)[:, np.newaxis]
    found = Grid((Axis(0.0, float(largest), largest),)).cells_of(numbers)
    assert found.tolist() == [*range(largest), largest - 1]


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_a_measure_that_is_not_finite_has_no_cell(value: float) -> None:
    assert GRID.cells_of(np.array([[0.1, value], [value, 0.0]])).tolist() == [-1, -1]


@pytest.mark.parametrize("part", [1, 7, 100])
def test_an_archive_has_the_best_of_each_cell_and_of_equal_ones_the_first(part: int) -> None:
    measures = random(1, 700, 2) * [1.0, 20.0] - [0.0, 10.0]
    fitness = np.round(random(2, 700) * 20)
    fitness[::13] = np.nan
    elites = Archive(GRID)
    for first in range(0, 700, part):
        rows = slice(first, first + part)
        elites.add(range(first, min(first + part, 700)), fitness[rows], measures[rows])
    cells = GRID.cells_of(measures)
    expected: dict[int, int] = {}
    for number in range(700):
        cell = int(cells[number])
        if np.isfinite(fitness[number]) and fitness[number] > fitness[expected.get(cell, 0)]:
            expected[cell] = number
        elif np.isfinite(fitness[number]):
            expected.setdefault(cell, number)
    assert dict(zip(elites.cells.tolist(), elites.numbers.tolist(), strict=True)) == expected
    assert elites.fitness.tolist() == [fitness[expected[cell]] for cell in elites.cells.tolist()]


def test_what_is_reported_as_new_is_what_is_in_the_archive_afterwards() -> None:
    elites = Archive(Grid((Axis(0.0, 1.0, 1),)))
    assert elites.add([5, 6, 7], np.array([1.0, 3.0, 2.0]), np.zeros((3, 1))).tolist() == [[0, 1]]
    assert elites.add([8, 9], np.array([3.0, np.nan]), np.zeros((2, 1))).tolist() == []
    assert (elites.numbers.tolist(), elites.fitness.tolist(), len(elites)) == ([6], [3.0], 1)


@pytest.mark.parametrize("columns", [1, 2, 3, 5])
@pytest.mark.parametrize("steps", [3, 1000])
def test_fronts_are_those_of_pymoo(columns: int, steps: int) -> None:
    values = np.round(random(columns, 150, columns) * steps)
    expected = np.empty(150, dtype=int)
    for number, front in enumerate(NonDominatedSorting().do(-values)):
        expected[front] = number
    assert ranks(values).tolist() == expected.tolist()
    assert (ranks(values, last=0) == 0).tolist() == (expected == 0).tolist()


def test_rows_that_are_not_finite_come_last() -> None:
    values = np.array([[1.0, np.nan], [-1e308, -1e308], [np.inf, 5.0], [0.0, 0.0]])
    assert ranks(values).tolist() == [2, 1, 2, 0]


@pytest.mark.parametrize("columns", [2, 3])
def test_crowding_distances_are_those_of_pymoo(columns: int) -> None:
    values = random(columns, 60, columns)
    # pymoo divides by the number of objectives, and filters rows that are equal.
    expected = calc_crowding_distance(-values) * columns
    np.testing.assert_allclose(crowding(values), expected, rtol=1e-12)


def test_crowding_of_huge_values_is_finite_but_for_the_ends() -> None:
    found = crowding(np.array([[-1.7e308], [0.0], [1.7e308], [1e308]]))
    assert np.isinf(found).tolist() == [True, False, True, False]
    assert crowding(np.ones((4, 2))).tolist() == [math.inf, 0.0, 0.0, math.inf]
    assert all(one >= 0 for one, _ in pairwise(found))


@pytest.mark.parametrize("columns", [1, 2, 4])
@pytest.mark.parametrize("steps", [4, 1000])
def test_a_front_that_grows_is_that_of_all_rows(columns: int, steps: int) -> None:
    values = np.round(random(columns, 300, columns) * steps)
    front = np.empty((0, columns))
    for part in np.split(values, 10):
        stays, joins = front_with(front, part)
        front = np.concatenate([front[stays], part[joins]])
    expected = np.unique(values[ranks(values, last=0) == 0], axis=0)
    assert np.unique(front, axis=0).tolist() == expected.tolist()
    assert len(front) == len(expected)


@pytest.mark.parametrize("columns", [1, 2, 3, 5])
def test_rows_that_nothing_dominates_are_those_of_rank_0(columns: int) -> None:
    values = np.random.default_rng(columns).integers(0, 6, (300, columns)).astype(float)
    _, first = np.unique(values, axis=0, return_index=True)
    expected = sorted(row for row in first.tolist() if ranks(values)[row] == 0)
    assert non_dominated(values).tolist() == expected
    covered = are_covered(values, values[:40])
    assert covered.tolist() == [bool((values[:40] >= row).all(axis=1).any()) for row in values]
    assert not are_covered(values, values[:0]).any()
