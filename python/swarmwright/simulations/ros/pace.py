"""Timing of steps with a fixed duration, which slow topics prolong."""

from __future__ import annotations

_TOLERANCE = 1.1
"""Longest mean step of an episode without a warning, relative to its duration."""
_SHARE = 0.5
"""Share of the excess time that waits must account for to be named as the cause."""


class Pace:
    """The times between commands in an episode of robots that move continuously.

    Args:
        duration: duration of a step, in seconds.
    """

    def __init__(self, duration: float) -> None:
        self._duration = duration
        self.begin()

    def begin(self) -> None:
        """Start an episode."""
        self._last: float | None = None
        self._seconds = 0.0
        self._steps = 0
        self._waits: dict[str, float] = {}
        self._remedies: dict[str, str] = {}

    def command(self, now: float) -> None:
        """Record that a command is sent; now: seconds of the clock for steps."""
        if self._last is not None and now >= self._last:  # /clock may have been reset
            self._seconds += now - self._last
            self._steps += 1
        self._last = now

    def rest(self) -> None:
        """Leave out the current step, as the robots stand still until the next."""
        self._last = None

    def wait(self, source: str, seconds: float, remedy: str) -> None:
        """Record a wait for a topic after the end of a step.

        source: the topic. seconds: duration of the wait, on the clock for steps. remedy: a remedy other than
        longer steps, in words.
        """
        if seconds <= 0:  # /clock may have been reset
            return
        self._waits[source] = self._waits.get(source, 0.0) + seconds
        self._remedies[source] = remedy

    def warning(self) -> str | None:
        """Return a warning about steps that took too long; None if there is no problem."""
        if not self._steps or self._seconds <= _TOLERANCE * self._duration * self._steps:
            return None
        text = (
            f"steps took {self._seconds / self._steps:.3g} s on average instead of {self._duration:g} s "
            f"(simulation.step), over {self._steps} steps; robots continued with the last command"
        )
        beyond = self._seconds - self._duration * self._steps
        if sum(self._waits.values()) < _SHARE * beyond:
            return f"{text}; this machine is too slow or too busy: make steps longer"
        slowest = max(self._waits, key=lambda source: self._waits[source])
        return (
            f"{text} while they waited, most of the time for {slowest}; make steps longer, or "
            f"{self._remedies[slowest]}"
        )
