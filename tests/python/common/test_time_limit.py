"""A limit of time holds for what its thread computes, and nothing else."""

from concurrent.futures import ThreadPoolExecutor

import pytest

from swarmwright import InputError
from swarmwright.common.time_limit import TimeLimit, bound_seconds, check_time_limit


def test_a_limit_holds_within_its_block_and_its_thread() -> None:
    check_time_limit()
    with TimeLimit(100, "outer"):
        with TimeLimit(0, "too long"):
            with pytest.raises(InputError, match="too long"):
                check_time_limit()
            assert bound_seconds(5.0) == 0
            with ThreadPoolExecutor(1) as pool:
                assert pool.submit(check_time_limit).exception() is None
        check_time_limit()
        assert 99 < bound_seconds(1000) <= 100
    assert bound_seconds(1000) == 1000


def test_it_begins_with_its_first_block_and_is_cancelled_from_outside() -> None:
    limit = TimeLimit(100, "given up")
    with limit:
        pass
    first = limit.remaining
    assert first < 100
    with limit:
        check_time_limit()
        limit.cancel()
        with pytest.raises(InputError, match="given up"):
            check_time_limit()
