import numpy as np
import pytest
from pymoo.indicators.hv import Hypervolume

from swarmwright.analysis.indicators import hypervolume


def test_of_two_objectives() -> None:
    values = np.array([[1.0, 3.0], [2.0, 2.0], [3.0, 1.0], [1.0, 1.0]])
    assert hypervolume(values, np.zeros(2)) == 6.0
    assert hypervolume(values, np.ones(2)) == 1.0
    assert hypervolume(values, np.array([3.0, 3.0])) == 0.0
    assert hypervolume(np.empty((0, 2)), np.zeros(2)) == 0.0


@pytest.mark.parametrize("count", [2, 3, 4, 5])
def test_it_counts_the_cells_that_are_dominated(count: int) -> None:
    random = np.random.default_rng(count)
    for rows in (0, 1, 2, 7):
        values = random.integers(-1, 5, (rows, count))  # some are equal, dominated, or behind the reference
        cells = np.stack(np.meshgrid(*[np.arange(5)] * count, indexing="ij"), axis=-1).reshape(-1, count)
        dominated = sum(any((cell < row).all() for row in values) for cell in cells)
        assert hypervolume(values.astype(np.float64), np.zeros(count)) == dominated


@pytest.mark.parametrize("count", [2, 3, 4, 6])
def test_it_is_that_of_pymoo(count: int) -> None:
    random = np.random.default_rng(count)
    values = random.standard_normal((40, count))
    reference = np.full(count, -1.2)
    theirs = Hypervolume(ref_point=-reference)(-values)
    assert hypervolume(values, reference) == pytest.approx(theirs, rel=1e-12)
