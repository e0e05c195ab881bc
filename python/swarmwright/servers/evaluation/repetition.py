"""Retries of evaluations that failed in this process."""

import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from swarmwright.servers.rows import IN_PROCESS, AttemptEntry, Journal, WarningEntry

_MAX_REASONS = 100
"""Upper limit of distinct reasons to report and to store with their traceback."""


class Failure(NamedTuple):
    """An attempt at an evaluation that failed."""

    candidate: int
    episode: int
    reason: str
    stack: str | None


class Value(NamedTuple):
    """Results of a successful attempt."""

    fitness: float
    metrics: NDArray[np.float64]
    """(metrics,)"""


@dataclass
class _FailedEvaluation:
    """An evaluation that has failed in all attempts so far."""

    last: Failure
    same: int = 1
    """Attempts in a row that failed for the last reason."""


class Repetition:
    """Retries failed evaluations, up to `faults.attempts` attempts in all, by the same rules as servers.

    Retries come after all other evaluations, so that other evaluations lie in between.

    Args:
        attempts: at an evaluation before it counts as failed.
        bitwise: whether the simulation declares bitwise determinism: then two failures for the same reason
            are final, if other evaluations succeed.
    """

    def __init__(self, attempts: int, *, bitwise: bool) -> None:
        self._attempts = attempts
        self._bitwise = bitwise
        self._reported: set[str] = set()
        self.retries = 0
        """Attempts so far that were not the first."""

    def __call__(
        self,
        failures: Iterable[Failure],
        fitness: NDArray[np.float64],
        metrics: NDArray[np.float64],
        evaluate: Callable[[int, int], Value | Failure],
        started: float,
    ) -> Journal:
        """Retry failures, write the values of successful retries into the arrays, and return the journal.

        Args:
            failures: the first attempts that failed.
            fitness: (candidates, episodes), NaN where they failed.
            metrics: (candidates, episodes, metrics), likewise.
            evaluate: evaluates a candidate in an episode once.
            started: beginning of the first attempts, seconds since 1970.
        """
        journal = Journal()
        pending = [_FailedEvaluation(failure) for failure in failures]
        if not pending:
            return journal
        seconds = time.time() - started
        for evaluation in pending:
            self._note(journal, evaluation.last, 1, started, seconds)
        for attempt in range(2, self._attempts + 1):
            certain = self._bitwise and bool(np.isfinite(fitness).any())
            pending = [evaluation for evaluation in pending if not (certain and evaluation.same > 1)]
            pending = [
                evaluation
                for evaluation in pending
                if not self._succeeds(journal, evaluation, attempt, fitness, metrics, evaluate)
            ]
        return journal

    def _succeeds(
        self,
        journal: Journal,
        evaluation: _FailedEvaluation,
        attempt: int,
        fitness: NDArray[np.float64],
        metrics: NDArray[np.float64],
        evaluate: Callable[[int, int], Value | Failure],
    ) -> bool:
        candidate, episode = evaluation.last.candidate, evaluation.last.episode
        self.retries += 1
        started = time.time()
        result = evaluate(candidate, episode)
        seconds = time.time() - started
        if isinstance(result, Value):
            fitness[candidate, episode] = result.fitness
            metrics[candidate, episode] = result.metrics
            journal.attempts.append(_entry(candidate, episode, attempt, started, seconds))
            return True
        evaluation.same = evaluation.same + 1 if result.reason == evaluation.last.reason else 1
        evaluation.last = result._replace(candidate=candidate, episode=episode)
        self._note(journal, evaluation.last, attempt, started, seconds)
        return False

    def _note(self, journal: Journal, failed: Failure, attempt: int, started: float, seconds: float) -> None:
        new = failed.reason not in self._reported and len(self._reported) < _MAX_REASONS
        if new:
            self._reported.add(failed.reason)
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
