"""The account of a run: the rate that is reported."""

import numpy as np
import pytest

from swarmwright.runs.optimization.account import Rate


def test_reports_in_bursts_are_levelled() -> None:
    """Ten generations of 20 evaluations a second that are all reported within its last millisecond."""
    rate = Rate(100.0, 0)
    found = [
        rate.add(101.0 + second + burst / 10_000, 20 * (10 * second + burst + 1))
        for second in range(10)
        for burst in range(10)
    ]
    assert max(found) < 1.5 * 200
    assert found[-1] == pytest.approx(200, rel=0.1)


def test_slow_generations_have_their_own_rate() -> None:
    rate = Rate(0.0, 0)
    assert rate.add(10.0, 100) == pytest.approx(10)
    assert rate.add(30.0, 200) == pytest.approx(5)
    assert rate.add(35.0, 300) == pytest.approx(20)


def test_it_follows_a_change_within_the_window() -> None:
    rate = Rate(0.0, 0)
    for now in np.arange(0.1, 10.05, 0.1):
        rate.add(now, round(now * 1000))
    found = [rate.add(now, round(10_000 + (now - 10) * 100)) for now in np.arange(10.1, 14.05, 0.1)]
    assert found[0] > 900
    assert found[-1] == pytest.approx(100, rel=0.1)


def test_evaluations_of_earlier_sessions_do_not_count() -> None:
    assert Rate(5.0, 1_000_000).add(6.0, 1_000_050) == pytest.approx(50)


def test_the_rate_is_a_number_where_no_time_has_passed() -> None:
    assert np.isfinite(Rate(5.0, 0).add(5.0, 20))
