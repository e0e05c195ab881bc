"""Figures of samples."""

import math

import pytest
from scipy.special import stdtrit

from swarmwright.core.statistics import estimate, student_t


def test_quantiles_of_student_are_those_of_scipy() -> None:
    for freedom in [*range(1, 1200), 10**4, 10**6]:
        assert student_t(freedom) == pytest.approx(float(stdtrit(freedom, 0.975)), rel=2e-13)


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
