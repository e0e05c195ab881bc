"""Repeats evaluations that failed in this process, as servers repeat them."""

import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from swarmwright.servers.rows import IN_PROCESS, AttemptEntry, Journal, WarningEntry

_REMEMBERED = 100
"""Different reasons that are told and stored with their stack, each once."""


class Failed(NamedTuple):
    """An attempt at an evaluation that failed."""

    candidate: int
    episode: int
    reason: str
    stack: str | None


class Value(NamedTuple):
    """What came out of an attempt that succeeded."""

    fitness: float
    metrics: NDArray[np.float64]
    """(metrics,)"""


@dataclass
class _Open:
    """An evaluation that has failed in all attempts so far."""

    last: Failed
    same: int = 1
    """Attempts in a row that failed for the last reason."""


class Repetition:
    """Repeats failed evaluations up to `faults.attempts` times in all; the rules are those of servers.

    An evaluation is repeated after all others, so that something else has been evaluated in between. Where
    nothing fails, nothing is done and nothing is stored.

    Args:
        attempts: at an evaluation before it has failed.
        bitwise: whether the simulation declares that it repeats itself to the bit: then it is enough that an
            evaluation fails twice for the same reason, if others succeed.
    """

    def __init__(self, attempts: int, *, bitwise: bool) -> None:
        self._attempts = attempts
        self._bitwise = bitwise
        self._known: set[str] = set()
        self.retries = 0
        """Attempts so far that were not the first."""

    def __call__(
        self,
        failures: Iterable[Failed],
        fitness: NDArray[np.float64],
        metrics: NDArray[np.float64],
        evaluate: Callable[[int, int], Value | Failed],
        started: float,
    ) -> Journal:
        """Put the values of repeated evaluations in their places; return the journal of all failures.

        Args:
            failures: the first attempts that failed.
            fitness: (candidates, episodes), NaN where they failed.
            metrics: (candidates, episodes, metrics), likewise.
            evaluate: evaluates a candidate in an episode once.
            started: when the first attempts were begun, seconds since 1970.
        """
        journal = Journal()
        left = [_Open(failure) for failure in failures]
        if not left:
            return journal
        seconds = time.time() - started
        for opened in left:
            self._note(journal, opened.last, 1, started, seconds)
        for attempt in range(2, self._attempts + 1):
            certain = self._bitwise and bool(np.isfinite(fitness).any())
            left = [opened for opened in left if not (certain and opened.same > 1)]
            left = [
                opened
                for opened in left
                if not self._succeeds(journal, opened, attempt, fitness, metrics, evaluate)
            ]
        return journal

    def _succeeds(
        self,
        journal: Journal,
        attempt_open: _Open,
        attempt: int,
        fitness: NDArray[np.float64],
        metrics: NDArray[np.float64],
        evaluate: Callable[[int, int], Value | Failed],
    ) -> bool:
        candidate, episode = attempt_open.last.candidate, attempt_open.last.episode
        self.retries += 1
        started = time.time()
        found = evaluate(candidate, episode)
        seconds = time.time() - started
        if isinstance(found, Value):
            fitness[candidate, episode] = found.fitness
            metrics[candidate, episode] = found.metrics
            journal.attempts.append(_entry(candidate, episode, attempt, started, seconds))
            return True
        attempt_open.same = attempt_open.same + 1 if found.reason == attempt_open.last.reason else 1
        attempt_open.last = found._replace(candidate=candidate, episode=episode)
        self._note(journal, attempt_open.last, attempt, started, seconds)
        return False

    def _note(self, journal: Journal, failed: Failed, attempt: int, started: float, seconds: float) -> None:
        new = failed.reason not in self._known and len(self._known) < _REMEMBERED
        if new:
            self._known.add(failed.reason)
            journal.warnings.append(
                WarningEntry(f"an episode failed: {failed.reason}", time=started + seconds)
            )
        entry = _entry(failed.candidate, failed.episode, attempt, started, seconds)
        journal.attempts.append(
            entry._replace(outcome="failed", error=failed.reason, stack=failed.stack if new else None)
        )


def _entry(candidate: int, episode: int, attempt: int, started: float, seconds: float) -> AttemptEntry:
    return AttemptEntry(
        mode="in-process",
        candidate=candidate,
        candidates=1,
        episode=episode,
        episodes=1,
        server=IN_PROCESS,
        attempt=attempt,
        steps=None,
        started=started,
        seconds=seconds,
        outcome="done",
        error=None,
        stack=None,
    )
