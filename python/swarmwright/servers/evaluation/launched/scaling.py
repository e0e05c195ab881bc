"""How many servers a launcher is to have, by the work that is left and how long it takes."""

import math
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

WORK_S = 60.0
"""Seconds of work for each server: another one is started where there is more."""


@dataclass(frozen=True)
class Load:
    """What the pool says of its work.

    evaluations: that are left of the run, as far as it is known. at_once: those of a generation, which can be
    made at the same time. speed: evaluations a second of one server, the mean of those that were measured;
    None before the first. busy: servers that have work.
    """

    evaluations: int
    at_once: int
    speed: float | None
    busy: frozenset[int]

    @classmethod
    def of_status(cls, status: Mapping[str, Any]) -> "Load":
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


def needed(load: Load, least: int, most: int) -> int:
    """Return how many servers the work is enough for, from `least` to `most`."""
    if load.speed is None:
        return least
    seconds = load.evaluations / load.speed
    return max(least, min(most, load.at_once, math.ceil(seconds / WORK_S)))


@dataclass
class Scaling:
    """Follows what is needed: upwards at once, downwards when less was needed for `idle` seconds."""

    least: int
    most: int
    idle: float
    _seen: deque[tuple[float, int]] = field(default_factory=deque)

    def wanted(self, now: float, current: int, load: Load) -> int:
        """Return how many servers there are to be. now: seconds of a clock that is never set back."""
        need = needed(load, self.least, self.most)
        self._seen.append((now, need))
        # Kept is what was needed within the last `idle` seconds, and the entry before that.
        while len(self._seen) > 1 and self._seen[1][0] <= now - self.idle:
            self._seen.popleft()
        if need >= current or self._seen[0][0] > now - self.idle:
            return max(need, current)
        return min(current, max(count for _, count in self._seen))
