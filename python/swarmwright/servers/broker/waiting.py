"""Waiting for a broker that does not answer yet: for example one that is started at the same time."""

import time
from collections.abc import Callable
from typing import TypeVar

from swarmwright import _engine

Result = TypeVar("Result")

FIRST_PAUSE_S = 0.1
LONGEST_PAUSE_S = 2.0
"""Seconds between two attempts; they double."""


def connect_with_retries(
    connect: Callable[[], Result], seconds: float, tell: Callable[[str], None]
) -> Result:
    """Return what `connect` returns, called again as long as no broker answers.

    Other errors, such as wrong credentials or certificates, are raised at once: waiting does not fix them.

    Args:
        connect: connects to the broker.
        seconds: for how long at most; 0 for a single attempt.
        tell: gets a line when the wait begins, when its reason changes, and when it is over.

    Raises:
        _engine.NoBrokerError: no broker answered in that time.
    """
    began, since = time.monotonic(), time.strftime("%H:%M:%S")
    pause, told = FIRST_PAUSE_S, ""
    while True:
        try:
            result = connect()
        except _engine.NoBrokerError as error:
            left = began + seconds - time.monotonic()
            if left <= 0:
                if not told:
                    raise
                raise _engine.NoBrokerError(f"{error}; waited since {since}, for {seconds:g} s") from error
            reason = str(error).partition(";")[0]
            if reason != told:
                tell(f"{reason}; waiting for it since {since}, for {seconds:g} s at most")
                told = reason
            time.sleep(min(pause, left))
            pause = min(2 * pause, LONGEST_PAUSE_S)
        else:
            if told:
                tell(f"the broker answers after {time.monotonic() - began:.1f} s")
            return result
