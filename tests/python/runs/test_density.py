"""Evaluations in a grid."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmwright import InputError
from swarmwright.runs.density import evaluation_density

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
