"""How long steps take that have a duration: topics that are slower stretch them."""

from __future__ import annotations

_TOLERANCE = 1.1
"""The mean step of an episode may take so many times its duration."""
_SHARE = 0.5
"""Share of the time beyond the durations that waits must have taken to be named as the cause."""


class Pace:
    """The time from command to command in an episode of robots that move by themselves.

    Args:
        duration: of a step, in seconds.
    """

    def __init__(self, duration: float) -> None:
        self._duration = duration
        self.begin()

    def begin(self) -> None:
        """Begin an episode."""
        self._last: float | None = None
        self._seconds = 0.0
        self._steps = 0
        self._waits: dict[str, float] = {}
        self._remedies: dict[str, str] = {}

    def command(self, now: float) -> None:
        """Note that a command is sent; now: seconds of the clock that counts steps."""
        if self._last is not None and now >= self._last:  # /clock may have begun anew
            self._seconds += now - self._last
            self._steps += 1
        self._last = now

    def rest(self) -> None:
        """Leave out the step under way: the robots stand while none is asked for."""
        self._last = None

    def wait(self, source: str, seconds: float, remedy: str) -> None:
        """Note that a step was over before a topic had sent something.

        source: the topic. seconds: of the clock that counts steps. remedy: what else than longer steps ends
        such waits, in words.
        """
        if seconds <= 0:  # /clock may have begun anew
            return
        self._waits[source] = self._waits.get(source, 0.0) + seconds
        self._remedies[source] = remedy

    def warning(self) -> str | None:
        """Return what is to be said of the episode; None where steps took about as long as they should."""
        if not self._steps or self._seconds <= _TOLERANCE * self._duration * self._steps:
            return None
        text = (
            f"steps took {self._seconds / self._steps:.3g} s on average instead of {self._duration:g} s "
            f"(simulation.step), over {self._steps} steps; robots went on with the last command"
        )
        beyond = self._seconds - self._duration * self._steps
        if sum(self._waits.values()) < _SHARE * beyond:
            return f"{text}; this machine is too slow or too busy: make steps longer"
        slowest = max(self._waits, key=lambda source: self._waits[source])
        return (
            f"{text} while they waited, most of the time for {slowest}; make steps longer, or "
            f"{self._remedies[slowest]}"
        )
