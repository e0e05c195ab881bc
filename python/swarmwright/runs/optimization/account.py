"""The used budget and the best candidate of a run."""

import math
import time
from collections import deque

import numpy as np

from swarmwright.common.arrays import Fitness
from swarmwright.common.statistics import Summary
from swarmwright.experiment.budget import Budget
from swarmwright.methods import Method
from swarmwright.runs.optimization.generation import Generation
from swarmwright.runs.store import StoreReader

_UNLIMITED_EVALUATIONS = 10**15
"""Evaluations that stand for no limit."""
_WINDOW_S = 2.0
"""Seconds over which evaluations per second are counted."""


class Rate:
    """Evaluations per second over about the last two seconds.

    The time between two reports alone is misleading: generations that were evaluated ahead are reported in
    quick succession.

    Args:
        now: time of a clock when evaluations begin, in seconds.
        evaluations: their number at that time.
    """

    def __init__(self, now: float, evaluations: int) -> None:
        self._reports = deque([(now, evaluations)])

    def add(self, now: float, evaluations: int) -> float:
        """Add a report; return the rate since the last report at least two seconds ago, or the start."""
        reports = self._reports
        reports.append((now, evaluations))
        while now - reports[1][0] >= _WINDOW_S:
            reports.popleft()
        begin, before = reports[0]
        return (evaluations - before) / max(now - begin, 1e-9)


class Account:
    """Tracks the used budget of a run and its best candidate.

    Args:
        method: method of the run.
        budget: budget of the run.
        reevaluates: whether members of the population are re-evaluated in every generation.
    """

    def __init__(self, method: Method, budget: Budget, *, reevaluates: bool) -> None:
        self._method = method
        self._budget = budget
        self._reevaluates = reevaluates
        self.generations = 0
        """Generations told to the method since the start."""
        self.evaluations = 0
        """Candidates of these generations."""
        self.failed = 0
        """Failed candidates of these generations."""
        self.stored = 0
        """Generations passed to the store."""
        self.best_so_far = -np.inf
        """As in `Generation`."""
        self.leader = -1
        """Index of the best evaluation, from 0."""
        self._best_ever = -np.inf
        self._violation = np.inf  # of the leader
        self._started: float | None = None  # time of `start`
        self._rate = Rate(0.0, 0)
        self._resumed_at = 0  # evaluations told to the method before this session
        self._earlier_generations = 0
        self._earlier_seconds = 0.0

    def continue_from(self, reader: StoreReader) -> None:
        """Add the budget used by earlier sessions, whose generations the method has been told."""
        self._resumed_at, self.stored = self._method.evaluations, len(reader.history())
        self._earlier_generations = self.stored
        self._earlier_seconds = math.fsum(session.seconds or 0.0 for session in reader.sessions())

    def start(self) -> None:
        """Start the clock; the time before, such as for starting servers, does not count."""
        self._started = time.monotonic()
        self._rate = Rate(self._started, self.evaluations)

    def add(self, fitness: Fitness, leader: int, failed: int, violation: float = 0.0) -> None:
        """Count a generation told to the method, and note its best candidate.

        Args:
            fitness: fitness of its candidates.
            leader: index of its best candidate.
            failed: number of failed candidates.
            violation: violation of constraints by its best candidate; above 0 only if all violate them.
        """
        self._update_best(fitness, leader, violation)
        self.generations += 1
        self.evaluations += len(fitness)
        self.failed += failed

    @property
    def target_is_reached(self) -> bool:
        """Whether a finished method has reached its target."""
        if self._method.by_instance:
            return self._method.reached
        target = self._method.options.target
        return target is not None and self._best_ever >= target

    @property
    def time_is_over(self) -> bool:
        """Whether the budget of seconds is used up."""
        limit = self._budget.seconds
        return limit is not None and self._earlier_seconds + self._measure_elapsed() >= limit

    @property
    def max_evaluations(self) -> int:
        """Largest number of candidates evaluated in the whole run."""
        return min(
            self._method.budget, self._budget.evaluations or _UNLIMITED_EVALUATIONS, _UNLIMITED_EVALUATIONS
        )

    def estimate_generations(self, generations: int | None = None) -> int:
        """Estimate the run's total number of generations after these, by default after the stored ones."""
        so_far = self.stored if generations is None else generations
        return self._budget.estimate_generations(so_far, self.evaluations)

    def report(self, summary: Summary, waiting_for: str) -> Generation:
        """Build the progress report for a callback.

        Args:
            summary: summary of the last generation.
            waiting_for: what its evaluation waited for last.
        """
        elapsed = self._measure_elapsed()
        total_seconds = self._earlier_seconds + elapsed
        budget, share = self._budget.find_nearest(summary.generation + 1, summary.evaluations, total_seconds)
        remaining = 0 if self._method.done else max(self.max_evaluations - self._method.evaluations, 0)
        seconds_left = remaining * elapsed / max(self._method.evaluations - self._resumed_at, 1)
        if self._budget.generations is not None:  # races have generations of very different sizes
            done = summary.generation + 1
            seconds_each = elapsed / max(done - self._earlier_generations, 1)
            seconds_left = min(seconds_left, max(self._budget.generations - done, 0) * seconds_each)
        if self._budget.seconds is not None:
            seconds_left = min(seconds_left, max(self._budget.seconds - self._earlier_seconds - elapsed, 0.0))
        return Generation(
            generation=summary.generation,
            generations=self._budget.generations,
            best=summary.best,
            mean=summary.mean,
            best_so_far=summary.best_so_far,
            failed=summary.failed,
            failed_so_far=self.failed,
            evaluations=summary.evaluations,
            seconds=elapsed,
            evaluations_per_second=self._rate.add(time.monotonic(), summary.evaluations),
            seconds_left=seconds_left,
            waiting_for=waiting_for,
            budget=budget,
            share=share,
        )

    def _measure_elapsed(self) -> float:
        """Return the seconds of this session; 0 before its start."""
        return 0.0 if self._started is None else time.monotonic() - self._started

    def _update_best(self, fitness: Fitness, leader: int, violation: float) -> None:
        """Note the best evaluation so far, or of this generation if members are re-evaluated."""
        if self._method.by_instance:
            incumbent = self._method.incumbent
            if incumbent is not None:
                self.best_so_far, self.leader = incumbent.fitness, incumbent.evaluation
            return
        if violation > 0:
            # Until a candidate is feasible, the best is the one with the smallest violation.
            if violation < self._violation or self.leader < 0:
                self._violation, self.leader = violation, self.evaluations + leader
            return
        self._violation = 0.0
        value = float(fitness[leader])
        self._best_ever = max(self._best_ever, value)
        if value > self.best_so_far or self._reevaluates:
            self.best_so_far = value
            self.leader = self.evaluations + leader
