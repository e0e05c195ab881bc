"""Connection to a broker that may not be up yet."""

import time
from collections.abc import Callable
from typing import TypeVar

from swarmwright import _engine
from swarmwright.common.time_limit import bound_seconds

Result = TypeVar("Result")

FIRST_PAUSE_S = 0.1
LONGEST_PAUSE_S = 2.0
"""Seconds between two attempts, doubling up to this."""


def connect_with_retries(
    connect: Callable[[], Result], seconds: float, report: Callable[[str], None]
) -> Result:
    """Call `connect` until a broker answers, and return its result.

    Other errors, such as wrong credentials or certificates, are raised at once.

    Args:
        connect: connects to the broker.
        seconds: time limit; 0 for a single attempt.
        report: called with a line when the wait begins, its reason changes, and it ends.

    Raises:
        _engine.NoBrokerError: no broker answered in this time.
    """
    seconds = bound_seconds(seconds)
    began, since = time.monotonic(), time.strftime("%H:%M:%S")
    pause, reported = FIRST_PAUSE_S, ""
    while True:
        try:
            result = connect()
        except _engine.NoBrokerError as error:
            remaining = began + seconds - time.monotonic()
            if remaining <= 0:
                if not reported:
                    raise
                raise _engine.NoBrokerError(f"{error}; waited since {since}, for {seconds:g} s") from error
            reason = str(error).partition(";")[0]
            if reason != reported:
                report(f"{reason}; waiting since {since}, for at most {seconds:g} s")
                reported = reason
            time.sleep(min(pause, remaining))
            pause = min(2 * pause, LONGEST_PAUSE_S)
        else:
            if reported:
                report(f"the broker answers after {time.monotonic() - began:.1f} s")
            return result
