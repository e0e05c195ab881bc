"""Failed evaluations of a run: which they are, how one is repeated, and whether the simulation is broken.

A pool says only that an evaluation failed.
"""

import dataclasses
import logging
import shlex
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from swarmwright.common.errors import RunError
from swarmwright.common.formatting import format_count
from swarmwright.common.message_kinds import kind_of
from swarmwright.common.untrusted import escape_line
from swarmwright.servers.evaluation.base import FIRST_EVALUATIONS, OnResults, Results
from swarmwright.servers.rows import FAILED, AttemptEntry, Journal, WarningEntry

_log = logging.getLogger("swarmwright")
_MOST_NAMED = 10
"""Failures that are named, of those that are reported together."""


class Failure(NamedTuple):
    """An episode that failed in all attempts."""

    candidate: int
    """As the journal counts it."""
    episode: int
    last: AttemptEntry
    """The last attempt that failed."""
    attempts: int
    """That failed, copies on other servers included."""
    quarantine: str = ""
    """Why no other server gets it; empty where that is not so."""

    @property
    def time(self) -> float:
        """The end of the last attempt, seconds since 1970."""
        return self.last.started + self.last.seconds

    def text(self, seeds: Sequence[int]) -> str:
        """Say which episode failed, and how often it was tried."""
        where = f"episode {self.episode} (seed {seeds[self.episode]})"
        end = " and is quarantined" if self.quarantine else ""
        return f"{where} failed after {format_count(self.attempts, 'attempt')}{end}"

    def entry(self, seeds: Sequence[int]) -> WarningEntry:
        """Return the warning of the journal."""
        why = f", since {self.quarantine}" if self.quarantine else ""
        return WarningEntry(f"{self.text(seeds)}{why}: {self.last.error}", self.candidate, time=self.time)


class Failures:
    """Names failed episodes in the journals of a run, and says once how one of them is repeated.

    folder: of the run.
    """

    def __init__(self, folder: Path) -> None:
        self._run = shlex.quote(str(folder))
        self._hint = ""
        self._is_told = False

    def named(
        self,
        results: Results,
        seeds: Sequence[int],
        generation: int | None = None,
        rows: Mapping[int, int] | None = None,
        first: int = 0,
    ) -> Results:
        """Return results whose journal names candidate, episode and seed of what a pool could not evaluate.

        Args:
            results: of candidates that were evaluated together.
            seeds: of the episodes.
            generation: in which candidates are counted; None where they are counted over the whole run.
            rows: of the results, by the number that the journal has for a candidate; None where they are the
                same.
            first: what the journal counts candidates from, which the run counts from 0.
        """
        failures = list(failures_of(results, rows))
        if not failures:
            self._hint = self._hint or self._hint_without_value(results, seeds, generation, first)
            return results
        warnings = [warning for warning in results.journal.warnings if warning.failed is None]
        self._hint = self._hint or self._hint_at(failures[0], seeds, generation, first)
        warnings += [failure.entry(seeds) for failure in failures[:_MOST_NAMED]]
        if len(failures) > _MOST_NAMED:
            warnings.append(
                WarningEntry(f"{len(failures) - _MOST_NAMED} more episodes of this generation failed as well")
            )
        return dataclasses.replace(results, journal=Journal(results.journal.attempts, warnings))

    def tell(self) -> None:
        """Say how the first one is repeated, unless that was said; its generation is to be kept."""
        if self._hint and not self._is_told:
            self._is_told = True
            _log.warning("%s", self._hint)

    def _hint_at(self, failure: Failure, seeds: Sequence[int], generation: int | None, first: int) -> str:
        return self._hint_of(first + failure.candidate, generation, failure.text(seeds))

    def _hint_without_value(
        self, results: Results, seeds: Sequence[int], generation: int | None, first: int
    ) -> str:
        """Return how an episode is repeated for which the fitness expression has no value; empty without."""
        for warning in results.journal.warnings:
            if warning.error is not None and warning.candidate is not None and warning.episode is not None:
                seed, error = seeds[warning.episode], escape_line(warning.error)
                what = f"episode {warning.episode} (seed {seed}) failed: {error}"
                return self._hint_of(first + warning.candidate, generation, what)
        return ""

    def _hint_of(self, candidate: int, generation: int | None, what: str) -> str:
        whose, name = f"candidate {candidate}", f"{candidate}"
        if generation is not None:
            whose, name = f"generation {generation}, {whose}", f"{generation}:{candidate}"
        return (
            f"{whose}, {what}; repeat it: swarmwright evaluate {self._run} --candidate {name}; all failures: "
            f"swarmwright runs show {self._run}"
        )


def failures_of(results: Results, rows: Mapping[int, int] | None) -> Iterator[Failure]:
    """Yield the episodes that failed in all attempts; rows: as in `Failures.named`."""
    failed = np.isnan(results.fitness)
    if not failed.any():
        return
    quarantined = {
        (warning.failed["candidate"], warning.failed["episode"]): warning.failed["quarantined"]
        for warning in results.journal.warnings
        if warning.failed is not None
    }
    found: dict[tuple[int, int], list[AttemptEntry]] = {}
    for entry in results.journal.attempts:
        if entry.outcome not in FAILED:
            continue
        for candidate in range(entry.candidate, entry.candidate + entry.candidates):
            row = candidate if rows is None else rows.get(candidate, -1)
            for episode in range(entry.episode, entry.episode + entry.episodes):
                if 0 <= row < failed.shape[0] and episode < failed.shape[1] and failed[row, episode]:
                    found.setdefault((candidate, episode), []).append(entry)
    for (candidate, episode), entries in sorted(found.items(), key=lambda item: item[0]):
        # Copies of one attempt have one number; a batch that failed as a whole says nothing of its parts.
        alone = sum(entry.candidates * entry.episodes == 1 for entry in entries)
        attempts = max(alone, *(entry.attempt for entry in entries))
        servers = quarantined.get((candidate, episode))
        why = "" if servers is None else f"servers failed {servers} times while evaluating nothing else"
        yield Failure(candidate, episode, entries[-1], attempts, why)


class FirstFailedError(RunError):
    """The first evaluations of a run all failed in the same way."""

    def __init__(self, message: str, journal: Journal) -> None:
        super().__init__(message)
        self.journal = journal
        """Of the generation so far."""


class FirstEvaluations:
    """Looks at the evaluations of a run, in the order of candidates, until one of them succeeds.

    The order makes the outcome independent of which server is faster. An evaluation succeeds here when at
    least one of its episodes does.

    Args:
        failure_fitness: `ranking.failed` where it is a number: then an episode whose fitness expression has
            no value is a result like others, and only failures of the simulation count.
    """

    def __init__(self, failure_fitness: float | None) -> None:
        self._failure_fitness = failure_fitness
        self._kinds: set[str] = set()
        self._failed = 0
        self._lacks_value = False  # the fitness expression, for an episode
        self.is_open = True
        """Whether no evaluation has succeeded yet, and those so far have failed in the same way."""

    def close(self) -> None:
        """Look at no more of them."""
        self.is_open = False

    def of_generation(self) -> OnResults:
        """Return what takes the results of a generation, whose candidates are counted from 0.

        It raises FirstFailedError when the first `FIRST` evaluations have failed.
        """
        waiting: dict[int, set[str] | None] = {}
        journal = Journal()
        place = 0

        def take(candidates: Sequence[int], results: Results) -> None:
            nonlocal place
            if not self.is_open:
                return
            journal.extend(results.journal)
            waiting.update(self._outcomes(candidates, results))
            while place in waiting:
                is_last = self._add(waiting.pop(place))
                place += 1
                if is_last:
                    hint = (
                        "; ranking.failed: NUMBER gives failed episodes a fitness"
                        if self._lacks_value
                        else ""
                    )
                    raise FirstFailedError(
                        f"the first {FIRST_EVALUATIONS} evaluations all failed in the same way, and none "
                        f"succeeded{hint}",
                        journal,
                    )

        return take

    def _add(self, kinds: set[str] | None) -> bool:
        """Count an evaluation, None: it succeeded; return whether enough have failed in the same way."""
        if kinds is None:
            self.is_open = False
            return False
        self._kinds |= kinds
        self._failed += 1
        self.is_open = self.is_open and len(self._kinds) <= 1
        return self.is_open and self._failed >= FIRST_EVALUATIONS

    def _outcomes(self, candidates: Sequence[int], results: Results) -> Iterable[tuple[int, set[str] | None]]:
        """Yield each candidate with the kinds of reasons for which it failed; None: it succeeded."""
        rows = {candidate: row for row, candidate in enumerate(candidates)}
        kinds: dict[int, set[str]] = {}
        for failure in failures_of(results, rows):
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
