"""Scaling of a launcher's servers with the remaining work."""

import math
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

WORK_S = 60.0
"""Seconds of work per server; more work starts another server."""


@dataclass(frozen=True)
class Load:
    """Work of a pool."""

    evaluations: int
    """Remaining evaluations of the run, as far as known."""
    at_once: int
    """Evaluations of a generation, which can run in parallel."""
    speed: float | None
    """Mean evaluations per second of one server; None before the first measurement."""
    busy: frozenset[int]
    """Servers that have work."""

    @classmethod
    def from_status(cls, status: Mapping[str, Any]) -> "Load":
        """Read the status that a pool publishes."""
        speeds = [
            status_of_server["speed"]
            for status_of_server in status.get("servers", ())
            if status_of_server.get("speed")
        ]
        total = status.get("total", 0)
        later = (
            max(0, status.get("generations", 0) - status["generation"] - 1) if "generation" in status else 0
        )
        return cls(
            max(0, total - status.get("done", 0)) + later * total,
            total,
            sum(speeds) / len(speeds) if speeds else None,
            frozenset(status_of_server["server"] for status_of_server in status.get("waiting_for", ())),
        )


def count_needed(load: Load, least: int, most: int) -> int:
    """Return how many servers the work can occupy, from `least` to `most`."""
    if load.speed is None:
        return least
    seconds = load.evaluations / load.speed
    return max(least, min(most, load.at_once, math.ceil(seconds / WORK_S)))


@dataclass
class Scaling:
    """Number of servers over time: grows at once, shrinks after `idle` seconds of lower need."""

    least: int
    most: int
    idle: float
    _history: deque[tuple[float, int]] = field(default_factory=deque)

    def choose_count(self, now: float, current: int, load: Load) -> int:
        """Return the new number of servers. now: monotonic seconds."""
        need = count_needed(load, self.least, self.most)
        self._history.append((now, need))
        # Keep the needs within the last `idle` seconds, and the entry before.
        while len(self._history) > 1 and self._history[1][0] <= now - self.idle:
            self._history.popleft()
        if need >= current or self._history[0][0] > now - self.idle:
            return max(need, current)
        return min(current, max(count for _, count in self._history))
