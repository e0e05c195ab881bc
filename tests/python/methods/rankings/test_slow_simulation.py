"""What rankings with a slow simulation share: predicted fitness stays below a measured one, in its order."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmwright.methods.rankings.slow_simulation import compress_below

ANY = st.floats(allow_nan=False)
LIMITS = st.one_of(st.floats(-1e308, 1e308), st.sampled_from([0.0, 1.0, -3.0, 5e-324]))


@given(st.lists(ANY, max_size=12), LIMITS)
def test_all_are_less_than_the_limit_in_their_order(values: list[float], limit: float) -> None:
    before = np.array([*values, math.nan])
    found = compress_below(before, limit)
    assert np.isnan(found[-1])
    for value, now in zip(values, found, strict=False):
        assert now < limit
        assert now == value or value > limit - 1e-9 * abs(limit) - 1e-270
        for other, other_now in zip(values, found, strict=False):
            assert (value < other) == (now < other_now)


@given(st.lists(st.floats(-1e3, 1e3), min_size=1), st.lists(st.floats(-1e3, 1e3), min_size=1))
def test_those_of_two_generations_are_in_order(one: list[float], other: list[float]) -> None:
    """Unless they are almost equal, measured by how far they are from the limit."""
    found, later = compress_below(np.array(one), -3.0), compress_below(np.array(other), -3.0)
    for value, now in zip(one, found, strict=True):
        for another, then in zip(other, later, strict=True):
            if abs(value - another) > 0.01 * (3.0 + max(abs(value), abs(another))):
                assert (value < another) == (now < then)


def test_far_values_differ_by_more_than_rounding() -> None:
    """So that no method takes them for a plateau."""
    found = compress_below(np.array([-1.0, 0.0, 1.0, 2.0]), -3.0)
    assert found == pytest.approx(-3.0, rel=1e-9)
    assert np.diff(found).min() > 1e-13
