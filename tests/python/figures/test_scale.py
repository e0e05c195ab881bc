"""Axes: limits hold all numbers, ticks are round, labels tell them apart."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmwright.figures.scale import Scale, cut, labels, limits, ticks

NUMBERS = st.floats(allow_nan=False, allow_infinity=False)


@given(st.lists(NUMBERS | st.just(math.nan), min_size=1, max_size=20))
def test_limits_hold_all_numbers_with_room(values: list[float]) -> None:
    low, high = limits(np.array(values), 0.1)
    assert math.isfinite(high - low)
    assert low < high
    for value in values:
        if abs(value) < 7e307:
            assert low <= value <= high


@given(st.lists(NUMBERS.filter(lambda value: abs(value) < 1e300), min_size=1, max_size=5), st.booleans())
def test_ticks_are_few_round_and_different(values: list[float], whole: bool) -> None:
    low, high = limits(np.array(values), 0.1)
    found = ticks(low, high, 8, whole=whole)
    assert len(found) <= 9
    assert len(found) >= 1 or whole
    assert all(low - (high - low) * 1e-6 <= tick <= high + (high - low) * 1e-6 for tick in found)
    shown = labels(found)
    assert len(set(shown)) == len(found)
    if whole:
        assert all(tick == round(tick) for tick in found)


@pytest.mark.parametrize(
    ("low", "high", "shown"),
    [
        (-590.0, 60.0, ["−500", "−400", "−300", "−200", "−100", "0"]),
        (-0.03, 1.05, ["0.0", "0.2", "0.4", "0.6", "0.8", "1.0"]),
        (0.1, 2.1, ["0.25", "0.50", "0.75", "1.00", "1.25", "1.50", "1.75", "2.00"]),
        (0.0, 8e9, ["0", "1e+09", "2e+09", "3e+09", "4e+09", "5e+09", "6e+09", "7e+09", "8e+09"]),
    ],
)
def test_labels_are_written_with_the_digits_they_need(low: float, high: float, shown: list[str]) -> None:
    assert labels(ticks(low, high, 8)) == shown


def test_a_scale_maps_its_limits_to_its_ends() -> None:
    scale = Scale(-1, 3, 600, 100)
    assert [scale.at(value) for value in (-1, 1, 3)] == [600, 350, 100]
    assert scale.each(np.array([-1.0, 3.0])).tolist() == [600, 100]


def test_first_values_are_cut_off_where_they_would_squash_the_rest() -> None:
    x = np.arange(40.0)
    rising = -1000 * 0.3**x + x
    found = cut([(x, rising - 1, rising + 1)])
    assert found is not None
    assert (found.least, found.low < (rising - 1)[4:].min(), found.low > -100) == (-1001, True, True)
    assert found.high > 40
    assert found.note == "↓ the beginning reaches down to −1001"
    assert cut([(x, x - 1, x + 1)]) is None, "a steady rise needs the room"
    assert cut([(x[:5], rising[:5], rising[:5])]) is None, "too few to tell beginning from rest"
    flat = np.where(x < 2, -9.0, 0.0)
    assert cut([(x, flat, flat)]) is None, "of a flat rest nothing more would be seen"
    late = (1000 * x, rising, rising)
    assert cut([(x, rising, rising), late]) == cut([late, (x, rising, rising)]) is not None, (
        "each its own tenth"
    )


@given(st.lists(st.lists(NUMBERS | st.just(math.nan), min_size=1, max_size=15), max_size=3))
def test_a_cut_leaves_room_for_a_picture(rows: list[list[float]]) -> None:
    values = [np.array(row) for row in rows]
    found = cut([(np.arange(len(row), dtype=np.float64), row, row) for row in values])
    if found is not None:
        assert found.low < found.high
        assert found.least < found.low
