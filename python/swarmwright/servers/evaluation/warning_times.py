"""When a pool warned: it reports each warning at once, and returns all of an evaluation together."""

import time
from collections import defaultdict, deque
from collections.abc import Callable, Iterable

from swarmwright.common.engine_types import AttemptFields
from swarmwright.servers.evaluation.reports import WARNINGS, Report
from swarmwright.servers.rows import Journal, WarningEntry


class WarningTimes:
    """The times of warnings that were reported and are not in a journal yet.

    clock: gives the time, seconds since 1970.
    """

    def __init__(self, clock: Callable[[], float] = time.time) -> None:
        self._clock = clock
        self._times: dict[str, deque[float]] = defaultdict(deque)

    def note(self, report: Report) -> None:
        """Note the time of a warning; other reports are ignored."""
        if report["event"] in WARNINGS:
            self._times[_text(report)].append(self._clock())

    def journal(self, attempts: Iterable[AttemptFields], warnings: Iterable[str]) -> Journal:
        """Return the journal of what a pool returned, with the times at which it warned."""
        journal = Journal.of(attempts, ())
        journal.warnings = [WarningEntry(text, time=self._taken(text)) for text in warnings]
        return journal

    def _taken(self, text: str) -> float | None:
        times = self._times.get(text)
        if times is None:
            return None
        at = times.popleft()
        if not times:
            del self._times[text]
        return at


def _text(report: Report) -> str:
    """Return a reported warning as the pool returns it."""
    match report["event"]:
        case "broker_lost":
            return f"lost the broker ({report['reason']}); trying again"
        case "broker_back":
            return "the broker is back"
        case _:
            return str(report["message"])
