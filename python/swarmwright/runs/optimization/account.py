"""What a run has used of its budget, and the best that it has found."""

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
"""Evaluations that stand for no limit of them."""
_WINDOW_S = 2.0
"""Seconds over which evaluations per second are counted."""


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


class Account:
    """Counts what a run uses, and notes the best candidate.

    Args:
        method: of the run.
        budget: of the run.
        reevaluates: whether members of the population are evaluated again in every generation.
    """

    def __init__(self, method: Method, budget: Budget, *, reevaluates: bool) -> None:
        self._method = method
        self._budget = budget
        self._reevaluates = reevaluates
        self.generations = 0
        """Generations that the method has been told of, since the start."""
        self.evaluations = 0
        """Candidates of these."""
        self.failed = 0
        """Of these, candidates that failed."""
        self.stored = 0
        """Generations that were handed to the store."""
        self.best_so_far = -np.inf
        """As in `Generation`."""
        self.leader = -1
        """The evaluation that it is of, counted from 0."""
        self._best_seen = -np.inf
        self._started: float | None = None  # the clock of this session, from `start` on
        self._rate = Rate(0.0, 0)
        self._resumed_at = 0  # told to the method before this session
        self._generations_before = 0  # of earlier sessions
        self._before = 0.0  # seconds of earlier sessions

    def continue_from(self, reader: StoreReader) -> None:
        """Note what earlier sessions have used, of which the method has been told."""
        self._resumed_at, self.stored = self._method.evaluations, len(reader.history())
        self._generations_before = self.stored
        self._before = math.fsum(session.seconds or 0.0 for session in reader.sessions())

    def start(self) -> None:
        """Start the clock: what was before, such as starting servers, is not limited."""
        self._started = time.monotonic()
        self._rate = Rate(self._started, self.evaluations)

    def add(self, fitness: Fitness, leader: int, failed: int) -> None:
        """Count a generation that the method has been told of, and note its best.

        Args:
            fitness: of its candidates.
            leader: index of its best candidate.
            failed: how many of them failed.
        """
        self._lead(fitness, leader)
        self.generations += 1
        self.evaluations += len(fitness)
        self.failed += failed

    @property
    def target_is_reached(self) -> bool:
        """Whether the target of a method that is done is reached."""
        if self._method.by_instance:
            return self._method.reached
        target = self._method.options.target
        return target is not None and self._best_seen >= target

    @property
    def time_is_over(self) -> bool:
        """Whether the budget of seconds is used."""
        limit = self._budget.seconds
        return limit is not None and self._before + self._elapsed() >= limit

    @property
    def most(self) -> int:
        """How many candidates are evaluated in the whole run, at most."""
        return min(
            self._method.budget, self._budget.evaluations or _UNLIMITED_EVALUATIONS, _UNLIMITED_EVALUATIONS
        )

    def expected_generations(self, generations: int | None = None) -> int:
        """Return how many the run will have, as far as it can be told after these, by default the stored."""
        so_far = self.stored if generations is None else generations
        return self._budget.expected_generations(so_far, self.evaluations)

    def report(self, summary: Summary, waiting_for: str) -> Generation:
        """Return what a callback gets.

        Args:
            summary: of the last generation.
            waiting_for: what its evaluation waited for last.
        """
        elapsed = self._elapsed()
        budget, share = self._budget.nearest(
            summary.generation + 1, summary.evaluations, self._before + elapsed
        )
        left = 0 if self._method.done else max(self.most - self._method.evaluations, 0)
        seconds_left = left * elapsed / max(self._method.evaluations - self._resumed_at, 1)
        if self._budget.generations is not None:  # races have generations of very different sizes
            done = summary.generation + 1
            each = elapsed / max(done - self._generations_before, 1)
            seconds_left = min(seconds_left, max(self._budget.generations - done, 0) * each)
        if self._budget.seconds is not None:
            seconds_left = min(seconds_left, max(self._budget.seconds - self._before - elapsed, 0.0))
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
            evaluations_per_second=self._rate.after(time.monotonic(), summary.evaluations),
            seconds_left=seconds_left,
            waiting_for=waiting_for,
            budget=budget,
            share=share,
        )

    def _elapsed(self) -> float:
        """Return the seconds of this session; 0 before its start."""
        return 0.0 if self._started is None else time.monotonic() - self._started

    def _lead(self, fitness: Fitness, leader: int) -> None:
        """Note the best evaluation so far; with re-evaluation, of this generation."""
        if self._method.by_instance:
            incumbent = self._method.incumbent
            if incumbent is not None:
                self.best_so_far, self.leader = incumbent.fitness, incumbent.evaluation
            return
        value = float(fitness[leader])
        self._best_seen = max(self._best_seen, value)
        if value > self.best_so_far or self._reevaluates:
            self.best_so_far = value
            self.leader = self.evaluations + leader
