"""Evaluation of built-in and Python simulations in this process."""

import logging
import time
from collections.abc import Callable, Iterable, Sequence
from collections.abc import Set as AbstractSet
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from swarmwright import _engine
from swarmwright.common import processes
from swarmwright.common.engine_types import AttemptFields, WarningFields
from swarmwright.common.errors import SimulationError, engine_errors
from swarmwright.common.processes import use_threads
from swarmwright.common.untrusted import escape_line
from swarmwright.experiment.derived import fitness_expression
from swarmwright.experiment.experiment import Experiment
from swarmwright.servers.evaluation.base import (
    FIRST_EVALUATIONS,
    AuditedEpisode,
    CodeFailures,
    Controllers,
    Feed,
    OnResults,
    Progress,
    Results,
    apply_expression,
    metrics_of,
    tolerance_of,
)
from swarmwright.servers.rows import IN_PROCESS, AttemptEntry, Journal, ServerUses, WarningEntry
from swarmwright.simulations import catalogue
from swarmwright.simulations.loading import load
from swarmwright.simulations.physics import make_host

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


_log = logging.getLogger("swarmwright")

_HOLD_S = 2.0
"""Seconds after the start of an evaluation during which failures are held back, see `tell_held`."""


class InProcessBackend:
    """Backend for built-in simulations in this process, without broker and servers.

    metrics: names of metrics to return, besides those that the fitness needs.
    """

    def __init__(self, experiment: Experiment, metrics: Sequence[str] = ()) -> None:
        announced = catalogue.description(experiment.simulation, experiment.parameters)
        self.sensors: int = announced["sensors"]
        self.actuators: int = announced["actuators"]
        self.description = "in this process"
        self.is_foreign = False
        self.hash_seed: str | None = processes.current_hash_seed()
        self._simulation = experiment.simulation
        self.parameters = experiment.parameters
        self._expression = fitness_expression(experiment)
        self.metrics = metrics_of(self._expression, metrics)
        self.may_fail = self._expression is not None
        self._failed = 0
        self._evaluator: tuple[dict[str, Any], _engine.Evaluator] | None = None  # of the last architecture

    def evaluate(
        self,
        controllers: Controllers,
        seeds: Sequence[int],
        on_progress: Progress,
        meanwhile: Callable[[], None] | None = None,
        on_results: OnResults | None = None,
    ) -> Results:
        """Return the results; an episode fails if the fitness expression or the simulation's code fails."""
        results = self._evaluate(controllers, seeds, on_progress, meanwhile=meanwhile)
        if on_results is not None:
            on_results(range(len(results.fitness)), results)
        return results

    def _evaluate(
        self,
        controllers: Controllers,
        seeds: Sequence[int],
        on_progress: Progress,
        first: int = 0,
        meanwhile: Callable[[], None] | None = None,
    ) -> Results:
        """Return the results; messages count candidates from `first`."""
        with engine_errors():
            results = self.compute(controllers, seeds, on_progress, meanwhile)
        numbers = range(first, first + len(controllers.weights))
        if first:
            results = Results(results.fitness, results.metrics, results.journal.renumber(numbers))
        results = apply_expression(self._expression, results, numbers)
        self.count_failed(results)
        return results

    def count_failed(self, results: Results) -> None:
        """Count failed episodes."""
        self._failed += int(np.count_nonzero(np.isnan(results.fitness)))

    def build_journal(self, attempts: Iterable[AttemptFields], warnings: Iterable[WarningFields]) -> Journal:
        """Build the journal of evaluations by an engine thread."""
        return Journal.from_fields(attempts, warnings)

    def failure_of(self, _reason: str, /) -> SimulationError | None:
        """Return None, as built-in simulations have no such failures."""
        return None

    def repeat(
        self, controllers: Controllers, evaluations: Sequence[AuditedEpisode], on_progress: Progress
    ) -> tuple[Results, list[int | None]]:
        """Repeat single evaluations, one after the other."""
        parts = []
        for index, evaluation in enumerate(evaluations):
            on_progress(index, len(evaluations), "")
            weights = controllers.weights[evaluation.candidate : evaluation.candidate + 1]
            alone = Controllers(controllers.architecture, weights)
            with engine_errors():
                parts.append(self.compute(alone, [evaluation.seed], lambda *_: None, None))
        on_progress(len(evaluations), len(evaluations), "")
        fitness = np.concatenate([part.fitness for part in parts])
        metrics = np.concatenate([part.metrics for part in parts])
        results = apply_expression(
            self._expression, Results(fitness, metrics, Journal()), range(len(evaluations))
        )
        return results, [None] * len(evaluations)

    def tolerance(self, _servers: AbstractSet[int | None], /) -> float | None:
        """Return 0.0, as built-in simulations are deterministic to the bit."""
        return 0.0

    def evaluator(self, architecture: dict[str, Any]) -> _engine.Evaluator | None:
        """Return the engine's evaluator; None if the experiment has a fitness expression."""
        return self._evaluator_of(architecture) if self._expression is None else None

    def background_evaluator(self, architecture: dict[str, Any]) -> _engine.Evaluator | None:
        """Return the evaluator for a thread of the engine; None if evaluations involve Python."""
        return self.evaluator(architecture)

    def release_background_evaluator(self) -> None:
        """Do nothing, as the thread shares the evaluator."""

    def _evaluator_of(self, architecture: dict[str, Any]) -> _engine.Evaluator:
        use_threads()
        if self._evaluator is None or self._evaluator[0] != architecture:
            evaluator = _engine.Evaluator(
                self._simulation, self.parameters, architecture, metrics=self.metrics
            )
            self._evaluator = architecture, evaluator
        return self._evaluator[1]

    def compute(
        self,
        controllers: Controllers,
        seeds: Sequence[int],
        on_progress: Progress,
        meanwhile: Callable[[], None] | None,
    ) -> Results:
        """Return the results with the simulation's fitness. Raises the engine's errors."""
        evaluator = self._evaluator_of(controllers.architecture)
        fitness, metrics = evaluator.evaluate(controllers.weights, list(seeds), on_progress, meanwhile)
        return Results(fitness, metrics, Journal())

    def check(self) -> None:
        """Do nothing, as there is no other process."""

    def announce(
        self,
        run: str,
        generation: int | None,
        generations: int,
        evaluations: tuple[int, int] | None = None,
    ) -> None:
        """Do nothing, as there are no watchers without a broker."""

    def usage(self) -> str:
        """Return nothing: there are no servers."""
        return ""

    def server_use(self) -> ServerUses:
        """Return nothing: there are no servers."""
        return {}

    def incidents(self) -> dict[str, int]:
        """Return the number of failed evaluations; other faults raise errors."""
        return {"failed": self._failed} if self._failed else {}

    def log_to(self, folder: Path) -> None:
        """Do nothing, as output goes to this process's streams."""

    def announce_post_evaluation(self) -> None:
        """Do nothing, as there are no watchers without a broker."""

    def stream(
        self, controllers: Controllers, seeds: Sequence[int], feed: Feed, on_progress: Progress
    ) -> None:
        """Evaluate all candidates in flight as one batch, repeatedly."""
        first, weights = 0, controllers.weights
        while len(weights):
            numbers = range(first, first + len(weights))
            results = self._evaluate(
                Controllers(controllers.architecture, weights), seeds, on_progress, first
            )
            first += len(weights)
            more = feed(numbers, results)
            if more is None:
                return
            weights = more


class PythonBackend(InProcessBackend):
    """Backend for Python simulations in this process, one episode at a time, with retries."""

    def __init__(self, experiment: Experiment, metrics: Sequence[str] = ()) -> None:
        super().__init__(experiment, metrics)
        self.may_fail = True
        self.log_failure: Callable[[str, str], None] = _log_failure
        """Called with (reason, traceback) of a failure, once per reason."""
        self._held: list[tuple[str, str]] = []
        self._started = 0.0
        self._host = make_host(load(experiment.simulation), self._report)
        self._code_failures = CodeFailures()
        self._repetition = Repetition(experiment.faults.attempts, bitwise=self._host.determinism == "bitwise")

    def _report(self, reason: str, stack: str) -> None:
        self._held.append((reason, stack))
        if time.monotonic() - self._started > _HOLD_S:
            self.log_held()

    def log_held(self) -> None:
        """Log the failures held back; if all episodes fail, the run's error reports them instead."""
        for reason, stack in self._held:
            self.log_failure(reason, stack)
        self._held.clear()

    def evaluate(
        self,
        controllers: Controllers,
        seeds: Sequence[int],
        on_progress: Progress,
        meanwhile: Callable[[], None] | None = None,
        on_results: OnResults | None = None,
    ) -> Results:
        """Return the results; `on_results` gets those of the first candidates before the others."""
        count = len(controllers.weights)
        if on_results is None or count <= FIRST_EVALUATIONS:
            return super().evaluate(controllers, seeds, on_progress, meanwhile, on_results)
        parts: list[Results] = []
        for first, end in ((0, FIRST_EVALUATIONS), (FIRST_EVALUATIONS, count)):

            def progress(done: int, _: int, waiting_for: str, before: int = first * len(seeds)) -> None:
                on_progress(before + done, count * len(seeds), waiting_for)

            part = Controllers(controllers.architecture, controllers.weights[first:end])
            parts.append(self._evaluate(part, seeds, progress, first, meanwhile))
            on_results(range(first, end), parts[-1])
            meanwhile = None
        journal = Journal()
        for results in parts:
            journal.extend(results.journal)
        fitness, metrics = ([getattr(results, name) for results in parts] for name in ("fitness", "metrics"))
        return Results(np.concatenate(fitness), np.concatenate(metrics), journal)

    def tolerance(self, _servers: AbstractSet[int | None], /) -> float | None:
        """Return the tolerance that the class declares."""
        return tolerance_of([(self._host.determinism, self._host.tolerance)])

    def evaluator(self, architecture: dict[str, Any]) -> None:
        """Return None, as Python evaluates its code itself."""

    def compute(
        self,
        controllers: Controllers,
        seeds: Sequence[int],
        on_progress: Progress,
        meanwhile: Callable[[], None] | None,
    ) -> Results:
        """Return the results, NaN if the code failed in all attempts. Raises the engine's errors."""
        self.log_held()  # the run continued
        self._host.forget_failure()
        self._started = time.monotonic()
        if meanwhile is not None:
            meanwhile()
        started = time.time()
        fitness, metrics, failures = self._once(controllers, seeds, on_progress)
        total = fitness.size

        def retry(candidate: int, episode: int) -> Value | Failure:
            candidate_controllers = Controllers(
                controllers.architecture, controllers.weights[candidate : candidate + 1]
            )
            value, measured, failed = self._once(
                candidate_controllers, seeds[episode : episode + 1], lambda *_: on_progress(total, total, "")
            )
            return failed[0] if failed else Value(float(value[0, 0]), measured[0, 0])

        journal = self._repetition(failures, fitness, metrics, retry, started)
        self._code_failures.note(journal)
        if np.isfinite(fitness).any() or len(self._held) > 1:  # the error that ends the run has one reason
            self.log_held()
        return Results(fitness, metrics, journal)

    def _once(
        self, controllers: Controllers, seeds: Sequence[int], on_progress: Progress
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], list[Failure]]:
        """Return fitness, metrics and failures of one attempt at every evaluation."""
        fitness, metrics, failures = _engine.evaluate_host(
            self._host,
            self.parameters,
            controllers.architecture,
            controllers.weights,
            list(seeds),
            on_progress,
            metrics=self.metrics,
        )
        return fitness, metrics, [Failure(*failure) for failure in failures]

    def failure_of(self, reason: str, /) -> SimulationError | None:
        """Return the error for a reason in a journal; the latest failure includes its exception."""
        last = self._host.failure
        return last if last is not None and str(last) == reason else self._code_failures.find_error(reason)

    def incidents(self) -> dict[str, int]:
        """Return the numbers of retries and of evaluations that failed in all attempts."""
        retries = {"retries": self._repetition.retries} if self._repetition.retries else {}
        return retries | super().incidents()


def _log_failure(reason: str, _stack: str) -> None:
    """Log why an episode failed; the traceback is in the run's journal."""
    _log.warning("an episode failed: %s", escape_line(reason))
