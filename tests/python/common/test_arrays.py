"""Arrays that callers give become 32-bit floats, or are refused with the reason."""

import warnings
from decimal import Decimal
from typing import Any

import numpy as np
import pytest

from swarmwright import InputError
from swarmwright.common.arrays import float32_of


@pytest.mark.parametrize(
    "given", [[1, 2], [1.0, 2.0], [True, 2], [np.float64(1), Decimal(2)], np.array([1, 2], np.uint8)]
)
def test_numbers_are_taken(given: Any) -> None:
    found = float32_of("genomes", given)
    assert found.dtype == np.float32
    assert found.tolist() == [1, 2]


def test_what_is_not_finite_is_taken() -> None:
    found = float32_of("genomes", [np.inf, -np.inf, np.nan, 3e38])
    assert np.array_equal(np.isfinite(found), [False, False, False, True])


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ([[1e300, 1]], "1e+300 at [0, 0] is too large for a 32-bit float, at most 3.40282e+38"),
        (
            [[np.inf, 1], [2, -(10**39)]],
            "-1e+39 at [1, 1] is too large for a 32-bit float, at most 3.40282e+38",
        ),
        ([10**400], "must be an array of numbers: int too large to convert to float"),
        ([1j], "must be an array of numbers, not of the type complex128"),
        (np.array([1j], object), "must be an array of numbers: it holds an object of the class complex"),
        ([b"1"], "must be an array of numbers, not of the type |S1"),
        (["1"], "must be an array of numbers, not of the type <U1"),
        ([None], "must be an array of numbers: it holds an object of the class NoneType"),
        (np.ma.masked_array([1.0]), "must be an array without a mask; write genomes.filled(..)"),
        ([np.ma.masked_array([1.0])], "must be an array without a mask; write genomes.filled(..)"),
    ],
)
def test_others_are_refused(given: Any, words: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(InputError) as caught:
            float32_of("genomes", given)
    assert str(caught.value) == f"genomes: {words}"
