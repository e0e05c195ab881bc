"""Evaluations in a grid."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmwright import InputError
from swarmwright.runs.density import evaluation_density, nearest_evaluation

VALUES = st.one_of(st.floats(-1e6, 1e6), st.sampled_from([np.nan, np.inf, -np.inf, 0.0]))


def run_of(values: Any) -> Any:
    return SimpleNamespace(fitness=np.array(values, dtype=np.float64))


@given(st.lists(VALUES, max_size=80), st.integers(1, 30), st.integers(1, 20))
def test_each_evaluation_is_in_the_cell_of_its_number_and_fitness(
    values: list[float], columns: int, rows: int
) -> None:
    grid = evaluation_density(run_of(values), columns, rows)
    expected = np.zeros((columns, rows), np.uint32)
    finite = [value for value in values if np.isfinite(value)]
    low, high = (min(finite), max(finite)) if finite else (0.0, 0.0)
    for number, value in enumerate(values):
        if np.isfinite(value):
            row = min(int((value - low) / ((high - low) or 1.0) * rows), rows - 1)
            expected[number * columns // len(values), row] += 1
    assert (grid.counts == expected).all()
    assert (grid.lowest, grid.highest) == (low, high)
    assert (grid.evaluations, grid.failed) == (len(values), len(values) - len(finite))


@pytest.mark.parametrize("number", [0, -1, 4097])
def test_sizes_out_of_range_are_refused(number: int) -> None:
    with pytest.raises(InputError, match="columns: must be from 1 to 4096"):
        evaluation_density(run_of([1.0]), number, 10)


def test_huge_and_equal_values_have_cells() -> None:
    largest = float(np.finfo(np.float64).max)
    grid = evaluation_density(run_of([-largest, largest, 0.0]), 3, 4)
    assert grid.counts.argmax(axis=1).tolist() == [0, 3, 2]
    assert evaluation_density(run_of([largest, largest]), 2, 4).counts[:, 0].tolist() == [1, 1]
    assert evaluation_density(run_of([0.0, 5e-324]), 2, 2).counts.argmax(axis=1).tolist() == [0, 1]


@pytest.mark.parametrize("number", [-1e308, -1.0, 0.0, 2.0, 1e308])
@pytest.mark.parametrize("fitness", [-1e308, 0.0, 1e308])
@pytest.mark.parametrize("size", [0.0, -1.0, 5e-324, 1.0, 1e308])
def test_any_point_has_a_nearest_evaluation(number: float, fitness: float, size: float) -> None:
    run = run_of([-1.7e308, np.nan, 1.7e308])
    run.evaluation = lambda number=None: number
    assert nearest_evaluation(run, number, fitness, size, size) in {None, 0, 2}
