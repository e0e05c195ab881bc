"""The number of servers follows the work."""

from swarmwright.servers.evaluation.launched.servers import WORK_S, Load, Scaling, count_needed


def load(evaluations: int, seconds: float | None = 1.0) -> Load:
    return Load(evaluations, 40, None if seconds is None else 1 / seconds, frozenset())


def test_there_is_a_server_for_each_minute_of_work() -> None:
    assert count_needed(load(1000, None), 2, 9) == 2
    assert count_needed(load(0), 2, 9) == 2
    assert count_needed(load(int(5 * WORK_S)), 2, 9) == 5
    assert count_needed(load(int(50 * WORK_S)), 2, 9) == 9
    # Not more than a generation has evaluations, however long each takes.
    assert count_needed(load(100, 3600.0), 2, 50) == 40


def test_upwards_at_once_and_downwards_after_a_while() -> None:
    scaling = Scaling(1, 9, idle=60.0)
    much, little = load(int(6 * WORK_S)), load(int(2 * WORK_S))
    assert scaling.choose_count(0.0, 1, much) == 6
    assert scaling.choose_count(30.0, 6, little) == 6
    assert scaling.choose_count(80.0, 6, little) == 6
    assert scaling.choose_count(91.0, 6, little) == 2
    assert scaling.choose_count(92.0, 2, much) == 6


def test_a_short_lull_ends_no_server() -> None:
    scaling = Scaling(1, 9, idle=60.0)
    much, none = load(int(6 * WORK_S)), load(0)
    for second in range(0, 600, 10):
        assert scaling.choose_count(float(second), 6, none if second % 40 == 0 else much) == 6


def test_the_status_of_a_pool() -> None:
    status = {
        "generation": 2,
        "generations": 5,
        "total": 120,
        "done": 20,
        "servers": [{"server": 1, "speed": 2.0}, {"server": 2, "speed": 4.0}, {"server": 3}],
        "waiting_for": [{"server": 2, "kind": "block"}],
    }
    assert Load.from_status(status) == Load(100 + 2 * 120, 120, 3.0, frozenset({2}))
    assert Load.from_status({}) == Load(0, 0, None, frozenset())
