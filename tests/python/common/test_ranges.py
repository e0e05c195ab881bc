"""What -1 and 1 stand for: both directions, words, mistakes."""

import math
from typing import Any

import numpy as np
import pytest

from swarmwright.common.ranges import Range, intersect_ranges, ranges_of


@pytest.mark.parametrize("given", [(0, 10, "m"), (-4, 4), (100.0, -20.0, "N"), [np.float32(0.1), 3]])
def test_values_and_numbers_become_each_other(given: Any) -> None:
    found = Range.parse(given)
    assert found is not None
    (there, more), (back, less) = found.to_value, found.from_value
    for number, value in ((-1.0, found.low), (1.0, found.high), (0.0, (found.low + found.high) / 2)):
        assert number * there + more == pytest.approx(value)
        assert value * back + less == pytest.approx(number)
    assert Range.from_scale(there, more, found.unit) == pytest.approx(found) or found.low == np.float32(0.1)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ((0, 100, "N"), "0 to 100 N"),
        ((-0.0, 0.1), "0 to 0.1"),
        ((np.float32(0.1), 1234567), "0.1 to 1.234567e+06"),
        ((1 / 3, 1e300), "0.3333333333333333 to 1e+300"),
    ],
)
def test_words(given: Any, words: str) -> None:
    found = Range.parse(given)
    assert found is not None
    assert found.words == words
    assert found.scaled_words == f"-1 to 1 for {words}"


@pytest.mark.parametrize(
    "given",
    [
        5, "01", (), (1,), (1, 1), (0, math.nan), (-math.inf, 0), (0, 10**400), (True, 2), ("0", "1"),
        (0, 1, 5), (0, 1, "m", ""), (-1e308, 1e308), (0, 5e-324),
    ],
)  # fmt: skip
def test_what_is_no_range(given: Any) -> None:
    with pytest.raises(ValueError, match=r"found, expected \(low, high\) or \(low, high, unit\)"):
        Range.parse(given)


def test_numbers_that_stand_for_themselves_have_none() -> None:
    assert Range.from_scale(1, 0) is None
    assert Range.from_scale(0, 3) is None
    assert Range.from_scale(-0.5, 0) == Range(0.5, -0.5)


def test_one_for_each_or_none_at_all() -> None:
    assert ranges_of((), 3) == ()
    assert ranges_of([None, (0, 1)], 2) == (None, Range(0, 1))
    for given, words in (
        ([None], "1 ranges found, expected 2"),
        (7, "expected a list of 2"),
        ("ab", "a list"),
    ):
        with pytest.raises(ValueError, match=words):
            ranges_of(given, 2)


def test_what_several_have_in_common() -> None:
    one, other = Range(0, 1), Range(0, 2)
    assert intersect_ranges([[one, one, None], [one, other], [one]]) == (one, None, None)
    assert intersect_ranges([]) == ()
