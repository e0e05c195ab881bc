"""Rank correlations, against SciPy's."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import spearmanr

from swarmwright.common.statistics import rank_correlation

VALUES = st.integers(-5, 5).map(float)


@given(st.lists(st.tuples(VALUES, VALUES), min_size=3, max_size=40))
def test_it_is_spearmans(pairs: list[tuple[float, float]]) -> None:
    one, other = (list(values) for values in zip(*pairs, strict=True))
    found = rank_correlation(one, other)
    if len(set(one)) == 1 or len(set(other)) == 1:
        assert found is None
        return
    assert found is not None
    assert found.rho == pytest.approx(spearmanr(one, other).statistic, abs=1e-12)
    assert (found.low is None) == (len(pairs) < 4)
    if found.low is not None and found.high is not None:
        assert -1 <= found.low <= found.rho <= found.high <= 1


def test_the_interval_holds_the_true_correlation_in_95_of_100_samples() -> None:
    random = np.random.default_rng(7)
    held = []
    for _ in range(1000):
        one = random.standard_normal(25)
        other = 0.6 * one + 0.8 * random.standard_normal(25)
        found = rank_correlation(one.tolist(), other.tolist())
        assert found is not None
        assert found.low is not None
        assert found.high is not None
        true = 6 / math.pi * math.asin(0.3)  # Spearman's of normal variables with Pearson's 0.6
        held.append(found.low <= true <= found.high)
    assert 0.92 < np.mean(held) < 0.98


@pytest.mark.parametrize("sign", [1, -1])
def test_a_perfect_order_of_few_candidates_is_no_certainty(sign: int) -> None:
    reached = []
    for count in (4, 6, 10, 30):
        values = [float(one) for one in range(count)]
        found = rank_correlation(values, [sign * one for one in values])
        assert found is not None
        assert found.low is not None
        assert found.high is not None
        assert found.rho == pytest.approx(sign)
        near, far = (found.high, found.low) if sign > 0 else (-found.low, -found.high)
        assert near == pytest.approx(1)
        reached.append(far)
    assert reached == sorted(reached), "more candidates, less doubt"
    assert reached[0] < 0, "of 24 orders of four candidates, one is theirs by chance"
    assert 0.95 < reached[-1] < 1


def test_failed_candidates_do_not_count() -> None:
    found = rank_correlation([1.0, math.nan, 2.0, 3.0, 4.0], [1.0, 9.0, 2.0, 3.0, math.nan])
    assert found is not None
    assert (found.rho, found.candidates) == (1.0, 3)
    assert rank_correlation([1.0, 2.0], [1.0, 2.0]) is None
    assert rank_correlation([], []) is None
