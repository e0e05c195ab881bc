"""How fast a run is, as it is reported after each generation."""

from collections import deque

_WINDOW_S = 2.0


class Rate:
    """Evaluations per second over about the last two seconds.

    The time between two reports alone says little: generations that were evaluated ahead are reported one
    right after the other.

    Args:
        now: a clock, in seconds, when evaluations begin.
        evaluations: before that.
    """

    def __init__(self, now: float, evaluations: int) -> None:
        self._reports = deque([(now, evaluations)])

    def after(self, now: float, evaluations: int) -> float:
        """Note how many evaluations there are now; return the rate since the report that began the window.

        That is the last one at least two seconds ago, or the begin.
        """
        reports = self._reports
        reports.append((now, evaluations))
        while now - reports[1][0] >= _WINDOW_S:
            reports.popleft()
        begin, before = reports[0]
        return (evaluations - before) / max(now - begin, 1e-9)
