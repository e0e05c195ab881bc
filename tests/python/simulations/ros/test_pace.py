"""What is said of steps that take longer than their duration."""

import pytest

from swarmwright.simulations.ros.episodes import Pace


def paced(duration: float, *times: float) -> Pace:
    pace = Pace(duration)
    for time in times:
        pace.command(time)
    return pace


@pytest.mark.parametrize(
    "times", [(), (5.0,), (5.0, 5.1, 5.2, 5.3), (5.0, 5.105, 5.21), (5.0, 5.15, 5.2, 5.3)]
)
def test_steps_that_are_in_time_on_average_need_no_warning(times: tuple[float, ...]) -> None:
    assert paced(0.1, *times).warning() is None


def test_a_slow_topic_is_named_with_the_time_that_steps_took() -> None:
    pace = paced(0.1, 0.0, 0.5, 1.0, 1.5)
    pace.wait("/a (sensor a)", 0.2, "give slow sensors a timeout")
    pace.wait("/d (metric d)", 0.5, "give slow metrics a value otherwise")
    assert pace.warning() == (
        "steps took 0.5 s on average instead of 0.1 s (simulation.step), over 3 steps; robots continued "
        "with the last command while they waited, most of the time for /d (metric d); make steps longer, "
        "or give slow metrics a value otherwise"
    )
    pace.begin()
    assert pace.warning() is None


@pytest.mark.parametrize("waited", [0.0, 0.001, 0.19, -5.0])
def test_without_a_slow_topic_it_is_the_machine(waited: float) -> None:
    """Waits of less than half of the 0.4 s beyond the durations are no cause."""
    pace = paced(0.1, 0.0, 0.3, 0.6)
    pace.wait("/a (sensor a)", waited, "give slow sensors a timeout")
    assert "this machine is too slow or too busy" in str(pace.warning())
    pace.wait("/a (sensor a)", 0.2, "give slow sensors a timeout")
    assert "/a (sensor a)" in str(pace.warning())


def test_neither_rests_nor_a_clock_that_begins_anew_count() -> None:
    pace = paced(0.1, 0.0, 0.1)
    pace.rest()
    pace.command(9.0)
    pace.command(9.1)
    pace.command(0.0)
    pace.command(0.1)
    assert pace.warning() is None
