"""Ends a run whose first evaluations all fail in the same way: the simulation is broken."""

from collections.abc import Iterable, Sequence

import numpy as np

from swarmwright.common.errors import RunError
from swarmwright.common.message_kinds import kind_of
from swarmwright.runs.optimization.failures import failures_of
from swarmwright.servers.evaluation.base import FIRST, OnResults, Results
from swarmwright.servers.rows import Journal


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
            journal.extend(results.journal, 0)
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
                        f"the first {FIRST} evaluations all failed in the same way, and none succeeded{hint}",
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
        return self.is_open and self._failed >= FIRST

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
