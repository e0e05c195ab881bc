"""Failed evaluations of a run: their warnings, how to repeat them, and whether the simulation is broken.

A pool reports only that an evaluation failed.
"""

import dataclasses
import logging
import shlex
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from swarmwright.common.errors import RunError
from swarmwright.common.formatting import format_count, kind_of
from swarmwright.common.untrusted import escape_line
from swarmwright.servers.evaluation.base import FIRST_EVALUATIONS, OnResults, Results
from swarmwright.servers.rows import FAILED, AttemptEntry, Journal, WarningEntry

_log = logging.getLogger("swarmwright")
_MOST_NAMED = 10
"""Failures named individually, of those reported together."""


class Failure(NamedTuple):
    """An episode that failed in all attempts."""

    candidate: int
    """Number of the candidate in the journal."""
    episode: int
    last: AttemptEntry
    """The last failed attempt."""
    attempts: int
    """Number of failed attempts, backups on other servers included."""
    quarantine: str = ""
    """Why the episode is quarantined; empty if it is not."""

    @property
    def time(self) -> float:
        """The end of the last attempt, seconds since 1970."""
        return self.last.started + self.last.seconds

    def text(self, seeds: Sequence[int]) -> str:
        """Describe which episode failed after how many attempts."""
        episode = f"episode {self.episode} (seed {seeds[self.episode]})"
        end = " and is quarantined" if self.quarantine else ""
        return f"{episode} failed after {format_count(self.attempts, 'attempt')}{end}"

    def entry(self, seeds: Sequence[int]) -> WarningEntry:
        """Return the warning for the journal."""
        why = f", since {self.quarantine}" if self.quarantine else ""
        return WarningEntry(f"{self.text(seeds)}{why}: {self.last.error}", self.candidate, time=self.time)


class Failures:
    """Adds warnings of failed episodes to the journals of a run, and logs once how to repeat a failure.

    folder: folder of the run.
    """

    def __init__(self, folder: Path) -> None:
        self._run = shlex.quote(str(folder))
        self._hint = ""
        self._is_logged = False

    def add_warnings(
        self,
        results: Results,
        seeds: Sequence[int],
        generation: int | None = None,
        rows: Mapping[int, int] | None = None,
        first: int = 0,
    ) -> Results:
        """Add warnings with candidate, episode and seed of each failed episode to the journal of results.

        Args:
            results: results of candidates that were evaluated together.
            seeds: seeds of the episodes.
            generation: generation within which candidates are counted; None if over the whole run.
            rows: row in the results by the candidate's number in the journal; None if they are the same.
            first: number in the run of the journal's candidate 0.
        """
        failures = list(find_failures(results, rows))
        if not failures:
            self._hint = self._hint or self._find_valueless_hint(results, seeds, generation, first)
            return results
        warnings = [warning for warning in results.journal.warnings if warning.failed is None]
        self._hint = self._hint or self._format_hint(
            first + failures[0].candidate, generation, failures[0].text(seeds)
        )
        warnings += [failure.entry(seeds) for failure in failures[:_MOST_NAMED]]
        if len(failures) > _MOST_NAMED:
            warnings.append(
                WarningEntry(f"{len(failures) - _MOST_NAMED} more episodes of this generation failed as well")
            )
        return dataclasses.replace(results, journal=Journal(results.journal.attempts, warnings))

    def tell(self) -> None:
        """Log once how to repeat the first failure, whose generation is about to be kept."""
        if self._hint and not self._is_logged:
            self._is_logged = True
            _log.warning("%s", self._hint)

    def _find_valueless_hint(
        self, results: Results, seeds: Sequence[int], generation: int | None, first: int
    ) -> str:
        """Return how to repeat an episode whose fitness expression has no value; empty if there is none."""
        for warning in results.journal.warnings:
            if warning.error is not None and warning.candidate is not None and warning.episode is not None:
                seed, error = seeds[warning.episode], escape_line(warning.error)
                problem = f"episode {warning.episode} (seed {seed}) failed: {error}"
                return self._format_hint(first + warning.candidate, generation, problem)
        return ""

    def _format_hint(self, candidate: int, generation: int | None, problem: str) -> str:
        location, name = f"candidate {candidate}", f"{candidate}"
        if generation is not None:
            location, name = f"generation {generation}, {location}", f"{generation}:{candidate}"
        return (
            f"{location}, {problem}; repeat it: swarmwright evaluate {self._run} --candidate {name}; all "
            f"failures: swarmwright runs show {self._run}"
        )


def find_failures(results: Results, rows: Mapping[int, int] | None) -> Iterator[Failure]:
    """Yield the episodes that failed in all attempts; rows: as in `Failures.add_warnings`."""
    failed = np.isnan(results.fitness)
    if not failed.any():
        return
    quarantined = {
        (warning.failed["candidate"], warning.failed["episode"]): warning.failed["quarantined"]
        for warning in results.journal.warnings
        if warning.failed is not None
    }
    attempts_of_episode: dict[tuple[int, int], list[AttemptEntry]] = {}
    for entry in results.journal.attempts:
        if entry.outcome not in FAILED:
            continue
        for candidate in range(entry.candidate, entry.candidate + entry.candidates):
            row = candidate if rows is None else rows.get(candidate, -1)
            for episode in range(entry.episode, entry.episode + entry.episodes):
                if 0 <= row < failed.shape[0] and episode < failed.shape[1] and failed[row, episode]:
                    attempts_of_episode.setdefault((candidate, episode), []).append(entry)
    for (candidate, episode), entries in sorted(attempts_of_episode.items(), key=lambda item: item[0]):
        # Backups of an attempt share its number; the failure of a whole batch tells nothing about its parts.
        alone = sum(entry.candidates * entry.episodes == 1 for entry in entries)
        attempt_count = max(alone, *(entry.attempt for entry in entries))
        servers = quarantined.get((candidate, episode))
        reason = "" if servers is None else f"servers failed {servers} times while evaluating nothing else"
        yield Failure(candidate, episode, entries[-1], attempt_count, reason)


class FirstFailedError(RunError):
    """The first evaluations of a run all failed for the same reason."""

    def __init__(self, message: str, journal: Journal) -> None:
        super().__init__(message)
        self.journal = journal
        """Journal of the generation so far."""


class FirstEvaluations:
    """Checks the evaluations of a run, in the order of candidates, until an evaluation succeeds.

    The order makes the outcome independent of the speed of servers. An evaluation counts as successful when
    at least one of its episodes succeeds.

    Args:
        failure_fitness: `ranking.failed` if it is a number: then an episode whose fitness expression has no
            value counts as a result, and only failures of the simulation count as failures.
    """

    def __init__(self, failure_fitness: float | None) -> None:
        self._failure_fitness = failure_fitness
        self._kinds: set[str] = set()
        self._failed = 0
        self._lacks_value = False  # whether the fitness expression had no value for an episode
        self.is_open = True
        """Whether all evaluations so far have failed for the same reason."""

    def close(self) -> None:
        """Stop checking."""
        self.is_open = False

    def start_generation(self) -> OnResults:
        """Return a callback for the results of a generation, whose candidates are counted from 0.

        It raises FirstFailedError when the first `FIRST_EVALUATIONS` evaluations have failed.
        """
        waiting: dict[int, set[str] | None] = {}
        journal = Journal()
        next_candidate = 0

        def take(candidates: Sequence[int], results: Results) -> None:
            nonlocal next_candidate
            if not self.is_open:
                return
            journal.extend(results.journal)
            waiting.update(self._outcomes(candidates, results))
            while next_candidate in waiting:
                is_last = self._add(waiting.pop(next_candidate))
                next_candidate += 1
                if is_last:
                    hint = (
                        "; ranking.failed: NUMBER gives failed episodes a fitness"
                        if self._lacks_value
                        else ""
                    )
                    raise FirstFailedError(
                        f"the first {FIRST_EVALUATIONS} evaluations all failed for the same reason{hint}",
                        journal,
                    )

        return take

    def _add(self, kinds: set[str] | None) -> bool:
        """Count an evaluation (None if it succeeded); return whether enough failed for the same reason."""
        if kinds is None:
            self.is_open = False
            return False
        self._kinds |= kinds
        self._failed += 1
        self.is_open = self.is_open and len(self._kinds) <= 1
        return self.is_open and self._failed >= FIRST_EVALUATIONS

    def _outcomes(self, candidates: Sequence[int], results: Results) -> Iterable[tuple[int, set[str] | None]]:
        """Yield each candidate with the kinds of its failures, None if it succeeded."""
        rows = {candidate: row for row, candidate in enumerate(candidates)}
        kinds: dict[int, set[str]] = {}
        for failure in find_failures(results, rows):
            kinds.setdefault(failure.candidate, set()).add(kind_of(failure.last.error or ""))
        for warning in results.journal.warnings:
            if warning.candidate in rows and warning.error is not None:
                self._lacks_value = True
                if self._failure_fitness is not None:
                    self.close()
                kinds.setdefault(warning.candidate, set()).add(kind_of(warning.error))
        succeeded = np.asarray(np.isfinite(results.fitness).any(axis=1))
        for candidate, row in rows.items():
            yield candidate, None if succeeded[row] else kinds.get(candidate, set())
