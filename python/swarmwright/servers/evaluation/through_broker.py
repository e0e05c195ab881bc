"""Evaluation on simulation servers, through an MQTT broker."""

import shlex
import time
from collections.abc import Callable, Iterable, Sequence
from collections.abc import Set as AbstractSet
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from swarmwright import _engine
from swarmwright.common import processes
from swarmwright.common.engine_types import AttemptFields, Report, WarningFields
from swarmwright.common.errors import RunError, SimulationError, engine_errors
from swarmwright.common.simulation_names import is_command
from swarmwright.common.suggestions import did_you_mean
from swarmwright.experiment.competition import check_announced
from swarmwright.experiment.derived import fitness_expression, steers_agents
from swarmwright.experiment.experiment import Experiment
from swarmwright.servers.evaluation import reports
from swarmwright.servers.evaluation.base import (
    FIRST_EVALUATIONS,
    OUTPUT,
    AuditedEpisode,
    CodeFailures,
    Controllers,
    Feed,
    OnResults,
    Progress,
    Results,
    StartedServers,
    apply_expression,
    metrics_of,
    tolerance_of,
)
from swarmwright.servers.evaluation.module_code import is_in_python, with_digests
from swarmwright.servers.rows import Journal, ServerUses, WarningEntry
from swarmwright.simulations import catalogue, near_names

EXPECTED_AUDITS = 10
"""Expected audits before the warning; the probability that none was drawn by chance is then e^-10."""


class MissingAudits:
    """Warns once if a single server does all evaluations, so that no audit takes place.

    share: fraction of evaluations to audit, 0 to 1.
    """

    def __init__(self, share: float) -> None:
        self._share = share
        self._evaluations = 0
        self._servers: set[int] = set()

    def note(self, journal: Journal) -> str | None:
        """Count evaluations; add a warning when it is due, and return its text."""
        if not self._share:
            return None
        for attempt in journal.attempts:
            self._servers.add(attempt.server)
            self._evaluations += attempt.candidates * attempt.episodes
        is_reported = any(warning.unaudited for warning in journal.warnings)  # the pool reports more
        if is_reported or len(self._servers) > 1:
            self._share = 0.0
        if self._evaluations * self._share < EXPECTED_AUDITS:
            return None
        share, self._share = self._share, 0.0
        (server,) = self._servers
        text = (
            f"no audits take place during the run despite faults.audit: {share:g}, because only server "
            f"{server} "
            "is used; it is audited at the end. Start a second server that declares its determinism, and "
            "check with `swarmwright servers` that it is found"
        )
        journal.warnings.append(WarningEntry(text, time=time.time()))
        return text


class BrokerBackend:
    """Backend for simulation servers behind a broker."""

    may_fail = True

    def __init__(
        self,
        experiment: Experiment,
        pool: _engine.Pool,
        servers: StartedServers | None,
        description: str,
        metrics: Sequence[str] = (),
    ) -> None:
        self._pool = pool
        self._servers = servers
        self._restarts = 0 if servers is None else servers.restarts
        self._without_value = 0
        self._run: str | None = None
        self._code_failures = CodeFailures()
        self._missing_audits = MissingAudits(experiment.faults.audit_share)
        self._listen()
        self._expression = fitness_expression(experiment)
        self.metrics = metrics_of(self._expression, metrics)
        self.description = description
        self.is_foreign = servers is None
        self.hash_seed = None if servers is None else processes.child_hash_seed()

        try:
            with engine_errors():
                self.sensors, self.actuators = pool.wait_for_server(sizes=steers_agents(experiment))
        except RunError as error:
            self.check()
            hint = near_names.suggest_title(experiment.simulation)
            if isinstance(error.__cause__, _engine.NoServerError):
                hint = hint or _suggest_server(experiment)
            raise RunError(f"{error}{self._metrics_hint() or hint}") from error
        check_announced(experiment, pool.announced_sides())

    def announce(
        self,
        run: str,
        generation: int | None,
        generations: int,
        evaluations: tuple[int, int] | None = None,
    ) -> None:
        """Publish the progress to watchers of the broker."""
        self._run = run
        self._pool.about(run, generation, generations, evaluations)

    def evaluator(self, architecture: dict[str, Any]) -> None:
        """Return None, as servers evaluate."""

    def background_evaluator(self, architecture: dict[str, Any]) -> _engine.Pool | None:
        """Return the pool; None if the experiment has a fitness expression or Python modules."""
        return None if self._expression is not None or is_in_python(architecture) else self._pool

    def release_background_evaluator(self) -> None:
        """Take the pool back."""
        self._pool.take_back()

    def count_failed(self, results: Results) -> None:
        """Do nothing, as the pool counts."""

    def _listen(self) -> None:
        """Forward the pool's reports to listeners; warnings always, for their times."""
        on_status = None if self._servers is None else self._servers.on_status

        def forward(report: Report) -> None:
            event = cast("dict[str, Any]", report)
            if on_status is not None and event["event"] == "status":
                on_status(event["status"])
            if reports.has_listeners():
                reports.tell(report)

        self._pool.listen(forward, warnings_only=on_status is None and reports.needs_only_warnings())

    def build_journal(self, attempts: Iterable[AttemptFields], warnings: Iterable[WarningFields]) -> Journal:
        """Build the journal of a pool's evaluations, with the times of its warnings."""
        journal = Journal.from_fields(attempts, warnings)
        self._code_failures.note(journal)
        warning = self._missing_audits.note(journal)
        if warning is not None:
            reports.tell({"event": "warning", "message": warning})
        return journal

    def failure_of(self, reason: str, /) -> SimulationError | None:
        """Return the error of the simulation's code on servers for a reason in a journal."""
        return self._code_failures.find_error(reason)

    def usage(self) -> str:
        """Return the resource use of remote servers as text."""
        return "" if self._servers is None else self._servers.usage

    def server_use(self) -> ServerUses:
        """Return the use of the servers of each launcher so far."""
        return {} if self._servers is None else self._servers.use

    def incidents(self) -> dict[str, int]:
        """Return the pool's counts of faults and countermeasures."""
        counts: dict[str, int] = {**self._pool.counts()}  # type: ignore[dict-item] # all of them are int
        if self._servers is not None:
            counts["restarts"] = self._servers.restarts - self._restarts
        counts["failed"] = counts.get("failed", 0) + self._without_value
        return {name: count for name, count in counts.items() if count}

    def log_to(self, folder: Path) -> None:
        """Write the output of started servers to a file in a run's folder."""
        if self._servers is not None:
            self._servers.log_to(folder / OUTPUT)

    def announce_post_evaluation(self) -> None:
        """Publish to servers.log and watchers that post-evaluation begins."""
        self._pool.about(self._run, purpose="post-evaluation")

    def _apply_fitness(self, results: Results, numbers: Sequence[int]) -> Results:
        """Apply the experiment's fitness and count episodes without a value."""
        judged = apply_expression(self._expression, results, numbers)
        self._without_value += len(judged.journal.warnings) - len(results.journal.warnings)
        return judged

    def _metrics_hint(self) -> str:
        """Suggest an announced name for a misspelt metric."""
        announced = self._pool.announced_metrics()
        missing = [name for name in self.metrics if name not in announced]
        return next((hint for name in missing if (hint := did_you_mean(name, announced))), "")

    def evaluate(
        self,
        controllers: Controllers,
        seeds: Sequence[int],
        on_progress: Progress,
        meanwhile: Callable[[], None] | None = None,
        on_results: OnResults | None = None,
    ) -> Results:
        """Return the results, NaN where evaluations failed, with the pool's journal."""
        if on_results is not None:
            if meanwhile is not None:
                meanwhile()
            return self._evaluate_incrementally(controllers, seeds, on_progress, on_results)

        def progress(done: int, total: int, waiting_for: str) -> None:
            self.check()
            on_progress(done, total, waiting_for)

        with engine_errors():
            fitness, metrics, attempts, warnings = self._pool.evaluate(
                with_digests(controllers.architecture),
                controllers.weights,
                list(seeds),
                progress,
                meanwhile,
                controllers.sample,
            )
        self.check()
        results = Results(fitness, metrics, self.build_journal(attempts, warnings))
        return self._apply_fitness(results, range(len(fitness)))

    def _evaluate_incrementally(
        self, controllers: Controllers, seeds: Sequence[int], on_progress: Progress, on_results: OnResults
    ) -> Results:
        """Evaluate and report the results of each candidate as soon as it is evaluated.

        All candidates after the first `FIRST` wait until one of those succeeds or all are evaluated, so that
        code that crashes servers does not crash them for every candidate. A candidate is reported again if a
        server turns out to be wrong.
        """
        count, weights = controllers.weights.shape
        first = Controllers(controllers.architecture, controllers.weights[:FIRST_EVALUATIONS])
        remaining = np.ascontiguousarray(controllers.weights[FIRST_EVALUATIONS:])
        evaluated = set[int]()
        fitness = np.full((count, len(seeds)), np.nan)
        metrics = np.full((count, len(seeds), len(self.metrics)), np.nan)
        journal = Journal()
        empty = np.empty((0, weights), dtype=np.float32)

        def feed(candidates: Sequence[int], results: Results) -> NDArray[np.float32]:
            nonlocal remaining
            rows = list(candidates)
            fitness[rows], metrics[rows] = results.fitness, results.metrics
            journal.extend(results.journal)
            on_results(candidates, results)
            evaluated.update(rows)
            if len(remaining) and (
                len(evaluated) == len(first.weights) or np.isfinite(results.fitness).any()
            ):
                more, remaining = remaining, empty
                return more
            return empty

        def progress(done: int, _: int, waiting_for: str) -> None:
            on_progress(done, count * len(seeds), waiting_for)

        self._stream(first, seeds, feed, progress, revised=True)
        return Results(fitness, metrics, journal)

    def repeat(
        self, controllers: Controllers, evaluations: Sequence[AuditedEpisode], on_progress: Progress
    ) -> tuple[Results, list[int | None]]:
        """Repeat single evaluations, each on another server than before if there is one."""
        seeds = list(dict.fromkeys(evaluation.seed for evaluation in evaluations))
        columns = {seed: index for index, seed in enumerate(seeds)}
        cells = [(evaluation.candidate, columns[evaluation.seed]) for evaluation in evaluations]
        selected = [(*cell, evaluation.before) for cell, evaluation in zip(cells, evaluations, strict=True)]
        skipped = len(controllers.weights) * len(seeds) - len(set(cells))

        def progress(done: int, total: int, waiting_for: str) -> None:
            self.check()
            on_progress(done - skipped, total - skipped, waiting_for)

        with engine_errors():
            fitness, metrics, attempts, _ = self._pool.evaluate(
                with_digests(controllers.architecture),
                controllers.weights,
                seeds,
                progress,
                only=selected,
            )
        self.check()
        servers = {
            (attempt["candidate"], attempt["episode"]): attempt["server"]
            for attempt in attempts
            if attempt["outcome"] == "done"
        }
        rows, episodes = (list(part) for part in zip(*cells, strict=True))
        measured = Results(
            fitness[rows, episodes][:, np.newaxis], metrics[rows, episodes][:, np.newaxis], Journal()
        )
        results = apply_expression(self._expression, measured, range(len(evaluations)))
        return results, [servers.get(cell) for cell in cells]

    def tolerance(self, servers: AbstractSet[int | None]) -> float | None:
        """Return the largest tolerance that these servers declare."""
        declared = {server: (kind, margin) for server, kind, margin in self._pool.determinism()}
        return tolerance_of(declared[server] for server in servers if server in declared)

    def stream(
        self, controllers: Controllers, seeds: Sequence[int], feed: Feed, on_progress: Progress
    ) -> None:
        """Evaluate on all servers; each gets a new candidate as soon as it has finished one."""
        self._stream(controllers, seeds, feed, on_progress, revised=False)

    def _stream(
        self,
        controllers: Controllers,
        seeds: Sequence[int],
        feed: Feed,
        on_progress: Progress,
        *,
        revised: bool,
    ) -> None:
        """Evaluate as `stream`; with `revised`, feed candidates again if a server turns out to be wrong."""

        def take(
            candidates: list[int],
            fitness: NDArray[np.float64],
            metrics: NDArray[np.float64],
            attempts: list[AttemptFields],
            warnings: list[WarningFields],
        ) -> NDArray[np.float32] | None:
            self.check()
            results = Results(fitness, metrics, self.build_journal(attempts, warnings))
            return feed(candidates, self._apply_fitness(results, candidates))

        def progress(done: int, total: int, waiting_for: str) -> None:
            self.check()
            on_progress(done, total, waiting_for)

        with engine_errors():
            architecture = with_digests(controllers.architecture)
            self._pool.stream(architecture, controllers.weights, list(seeds), take, progress, revised=revised)

    def check(self) -> None:
        """Log servers that were given up; raise RunError if none remains."""
        if self._servers is not None:
            self._servers.check()


def _suggest_server(experiment: Experiment) -> str:
    """Return advice on starting a server of the experiment's simulation."""
    served = experiment.simulation
    if is_command(served):
        served = "EXPERIMENT.yaml" if experiment.path is None else str(experiment.path)
    elif not catalogue.is_local(served):
        return (
            f"; start a server that offers {served!r} on this broker, or set a launcher under `servers:` in "
            "the experiment. A server that does not announce itself answers only if its title, dimensions "
            "and max_agents match the requirements"
        )
    return f"; start one with: swarmwright serve {shlex.quote(served)}"
