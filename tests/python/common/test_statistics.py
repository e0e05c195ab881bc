"""Figures of samples."""

import json
import math
import sys
from fractions import Fraction

import numpy as np
import pytest
from scipy.special import stdtrit

from swarmwright.common.statistics import estimate, mean, means, student_t

LARGEST = sys.float_info.max


def test_quantiles_of_student_are_those_of_scipy() -> None:
    for freedom in [*range(1, 1200), 10**4, 10**6]:
        assert student_t(freedom) == pytest.approx(float(stdtrit(freedom, 0.975)), rel=2e-13)


def test_quantiles_for_several_are_those_of_scipy() -> None:
    for of in (2, 4, 19, 999):
        for freedom in [*range(1, 300), 999, 1000, 10**5]:
            expected = float(stdtrit(freedom, 1 - 0.025 / of))
            assert student_t(freedom, of) == pytest.approx(expected, rel=1e-10), (of, freedom)


def test_of_several_intervals_all_are_wider() -> None:
    ends = [estimate([1.0, 2.0, 3.0, 6.0], comparisons=of) for of in (1, 2, 4)]
    assert ends[0] == estimate([1.0, 2.0, 3.0, 6.0])
    lows = [one.low or 0.0 for one in ends]
    assert lows == sorted(lows, reverse=True)
    assert len(set(lows)) == 3


def test_a_confidence_interval() -> None:
    found = estimate([1.0, 2.0, 3.0, 6.0])
    assert (found.mean, found.standard_error) == (3.0, math.sqrt(14 / 12))
    reach = 3.182446305284 * math.sqrt(14 / 12)
    assert (found.low, found.high) == pytest.approx((3 - reach, 3 + reach), rel=1e-11)
    assert estimate([2.0]).low is None
    assert estimate([0.52] * 9).low == pytest.approx(0.52)


def test_huge_values_have_a_mean() -> None:
    found = estimate([1.7e308, 1.5e308, 1.6e308])
    assert found.mean == pytest.approx(1.6e308)
    assert found.standard_deviation == pytest.approx(1e307)
    assert found.low is not None
    assert estimate([1.7e308, -1.7e308]).mean == 0.0
    assert estimate([1e200] * 3).standard_deviation == 0.0


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("count", range(2, 61))
def test_the_largest_numbers_have_a_mean(count: int, sign: int) -> None:
    huge = sign * LARGEST
    same = estimate([huge] * count)
    assert (same.mean, same.standard_deviation, same.low, same.high) == (huge, 0.0, huge, huge)
    for others in ([1.5], [-huge], [huge / 3, 0.0], [-huge, -huge, 1e-300]):
        values = [huge] * count + others
        exact = float(sum(map(Fraction, values)) / len(values))
        assert mean(values) == pytest.approx(exact, rel=4e-16)
        assert mean(values[::-1]) == pytest.approx(exact, rel=4e-16)
        found = estimate(values)
        json.dumps(vars(found), allow_nan=False)
        assert found.low is None or -LARGEST <= found.low <= found.mean <= (found.high or 0) <= LARGEST


def test_ordinary_means_keep_their_bits() -> None:
    values = [0.1 * number for number in range(1, 50)] + [1e300, -1e290]
    assert mean(values) == math.fsum(values) / len(values)
    assert math.isnan(mean([]))


@pytest.mark.parametrize(
    ("episodes", "expected"),
    [
        ([1.0, 2.0, 6.0], 3.0),
        ([1.0, math.nan, 5.0], 3.0),
        ([math.nan] * 3, math.nan),
        ([math.inf, 1.0, 2.0], math.nan),
        ([-math.inf, math.nan, 2.0], math.nan),
        ([math.inf, -math.inf, 2.0], math.nan),
        ([math.inf], math.nan),
        ([2.0], 2.0),
    ],
)
def test_a_mean_over_episodes_leaves_out_nan_and_keeps_no_infinity(
    episodes: list[float], expected: float
) -> None:
    found = means(np.array(episodes)[np.newaxis, :, np.newaxis])
    assert found.shape == (1, 1)
    assert np.array_equal(found[0, 0], expected, equal_nan=True)
