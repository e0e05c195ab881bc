"""A limit on the time of computations that somebody waits for, in whatever code they spend it."""

import math
import threading
import time
from types import TracebackType
from typing import Self

from swarmwright.common.errors import InputError

_present = threading.local()


class TimeLimit:
    """A limit for what this thread computes within a `with` block; it begins with the first one.

    Code that takes long calls `check_time_limit` between its steps.

    Args:
        seconds: from the beginning.
        message: of the InputError that is raised afterwards.
    """

    def __init__(self, seconds: float, message: str) -> None:
        self._seconds = seconds
        self._message = message
        self._end: float | None = None
        self._former: TimeLimit | None = None
        self._is_cancelled = False

    def cancel(self) -> None:
        """End the computation at its next step, from any thread."""
        self._is_cancelled = True

    @property
    def remaining(self) -> float:
        """Seconds that remain, at least 0."""
        if self._is_cancelled:
            return 0.0
        return self._seconds if self._end is None else max(0.0, self._end - time.monotonic())

    def check(self) -> None:
        """Raise InputError when the time is over."""
        if self.remaining <= 0:
            raise InputError(self._message)

    def __enter__(self) -> Self:
        """Begin."""
        if self._end is None:
            self._end = time.monotonic() + self._seconds
        self._former = getattr(_present, "limit", None)
        _present.limit = self
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """End."""
        _present.limit = self._former


def check_time_limit() -> None:
    """Raise InputError when the time limit of this thread, if it has one, is over."""
    limit: TimeLimit | None = getattr(_present, "limit", None)
    if limit is not None:
        limit.check()


def bound_seconds(seconds: float) -> float:
    """Return seconds to wait, at most those that remain of the time limit of this thread."""
    limit: TimeLimit | None = getattr(_present, "limit", None)
    return min(seconds, math.inf if limit is None else limit.remaining)
