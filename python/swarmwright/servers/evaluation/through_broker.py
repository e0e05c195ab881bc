"""Evaluation on simulation servers, through an MQTT broker."""

import shlex
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
from swarmwright.experiment.derived import fitness_expression, steers_agents
from swarmwright.experiment.experiment import Experiment
from swarmwright.servers.evaluation import reports
from swarmwright.servers.evaluation.base import (
    FIRST,
    OUTPUT,
    AuditedEpisode,
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
from swarmwright.servers.evaluation.code_failures import CodeFailures
from swarmwright.servers.evaluation.missing_audits import MissingAudits
from swarmwright.servers.evaluation.module_code import is_in_python, with_digests
from swarmwright.servers.rows import Journal
from swarmwright.servers.server_use import ServerUses
from swarmwright.simulations import catalogue, near_names


class BrokerBackend:
    """Evaluates on simulation servers through a broker."""

    may_fail = True

    def __init__(
        self,
        experiment: Experiment,
        pool: _engine.Pool,
        servers: StartedServers | None,
        where: str,
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
        self.description = where
        self.is_foreign = servers is None
        self.hash_seed = None if servers is None else processes.of_started()

        try:
            with engine_errors():
                self.sensors, self.actuators = pool.wait_for_server(sizes=steers_agents(experiment))
        except RunError as error:
            self.check()
            hint = near_names.suggest_title(experiment.simulation)
            if isinstance(error.__cause__, _engine.NoServerError):
                hint = hint or _advice(experiment)
            raise RunError(f"{error}{self._metrics_hint() or hint}") from error

    def about(
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
        """Return None: servers evaluate."""

    def ahead(self, architecture: dict[str, Any]) -> _engine.Pool | None:
        """Return the pool; None where the experiment has its own fitness, or modules in Python."""
        return None if self._expression is not None or is_in_python(architecture) else self._pool

    def end_ahead(self) -> None:
        """Take the pool back."""
        self._pool.take_back()

    def count_failed(self, results: Results) -> None:
        """Do nothing: the pool counts."""

    def _listen(self) -> None:
        """Have the pool's reports go to those who want them; warnings are needed for their times."""
        on_status = None if self._servers is None else self._servers.on_status

        def tell(report: Report) -> None:
            told = cast("dict[str, Any]", report)
            if on_status is not None and told["event"] == "status":
                on_status(told["status"])
            if reports.wanted():
                reports.tell(report)

        self._pool.listen(tell, warnings_only=on_status is None and reports.only_warnings())

    def journal(self, attempts: Iterable[AttemptFields], warnings: Iterable[WarningFields]) -> Journal:
        """Return the journal of what a pool has evaluated, with the times at which it warned."""
        journal = Journal.of(attempts, warnings)
        self._code_failures.note(journal)
        warning = self._missing_audits.note(journal)
        if warning is not None:
            reports.tell({"event": "warning", "message": warning})
        return journal

    def failure_of(self, reason: str, /) -> SimulationError | None:
        """Return what the simulation's code failed with on servers, for a reason of a journal."""
        return self._code_failures.of(reason)

    def usage(self) -> str:
        """Return what was used of servers elsewhere."""
        return "" if self._servers is None else self._servers.usage

    def server_use(self) -> ServerUses:
        """Return the use of the servers of each launcher so far."""
        return {} if self._servers is None else self._servers.use

    def incidents(self) -> dict[str, int]:
        """Return what the pool counted."""
        counts: dict[str, int] = {**self._pool.counts()}  # type: ignore[dict-item] # all of them are int
        if self._servers is not None:
            counts["restarts"] = self._servers.restarts - self._restarts
        counts["failed"] = counts.get("failed", 0) + self._without_value
        return {name: count for name, count in counts.items() if count}

    def log_to(self, folder: Path) -> None:
        """Write what started servers print to a file in a run's folder."""
        if self._servers is not None:
            self._servers.log_to(folder / OUTPUT)

    def post_evaluates(self) -> None:
        """Say that what follows belongs to no generation, in servers.log and to watchers."""
        self._pool.about(self._run, purpose="post-evaluation")

    def _valued(self, results: Results, numbers: Sequence[int]) -> Results:
        """Apply the experiment's fitness, and count the episodes for which it has no value."""
        judged = apply_expression(self._expression, results, numbers)
        self._without_value += len(judged.journal.warnings) - len(results.journal.warnings)
        return judged

    def _metrics_hint(self) -> str:
        """A name that servers announce, close to a misspelt one."""
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
        """Return the results, NaN where it failed, and what the pool did for them."""
        if on_results is not None:
            if meanwhile is not None:
                meanwhile()
            return self._as_they_come(controllers, seeds, on_progress, on_results)

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
        results = Results(fitness, metrics, self.journal(attempts, warnings))
        return self._valued(results, range(len(fitness)))

    def _as_they_come(
        self, controllers: Controllers, seeds: Sequence[int], on_progress: Progress, on_results: OnResults
    ) -> Results:
        """Evaluate as `evaluate`; the results of each candidate are told when it has been evaluated.

        All but the first `FIRST` candidates wait until one of these has succeeded, or all have been
        evaluated: servers that each of them takes down would be started again for every other one as well.
        Candidates are told again where a server turns out to be wrong.
        """
        count, weights = controllers.weights.shape
        first = Controllers(controllers.architecture, controllers.weights[:FIRST])
        others = np.ascontiguousarray(controllers.weights[FIRST:])
        told = set[int]()
        fitness = np.full((count, len(seeds)), np.nan)
        metrics = np.full((count, len(seeds), len(self.metrics)), np.nan)
        journal = Journal()
        no_more = np.empty((0, weights), dtype=np.float32)

        def feed(candidates: Sequence[int], results: Results) -> NDArray[np.float32]:
            nonlocal others
            rows = list(candidates)
            fitness[rows], metrics[rows] = results.fitness, results.metrics
            journal.extend(results.journal)
            on_results(candidates, results)
            told.update(rows)
            if len(others) and (len(told) == len(first.weights) or np.isfinite(results.fitness).any()):
                more, others = others, no_more
                return more
            return no_more

        def progress(done: int, _: int, waiting_for: str) -> None:
            on_progress(done, count * len(seeds), waiting_for)

        self._stream(first, seeds, feed, progress, revised=True)
        return Results(fitness, metrics, journal)

    def repeat(
        self, controllers: Controllers, evaluations: Sequence[AuditedEpisode], on_progress: Progress
    ) -> tuple[Results, list[int | None]]:
        """Repeat single evaluations, each on another server than before where there is one."""
        seeds = list(dict.fromkeys(evaluation.seed for evaluation in evaluations))
        columns = {seed: index for index, seed in enumerate(seeds)}
        places = [(evaluation.candidate, columns[evaluation.seed]) for evaluation in evaluations]
        only = [(*place, evaluation.before) for place, evaluation in zip(places, evaluations, strict=True)]
        others = len(controllers.weights) * len(seeds) - len(set(places))

        def progress(done: int, total: int, waiting_for: str) -> None:
            self.check()
            on_progress(done - others, total - others, waiting_for)

        with engine_errors():
            fitness, metrics, attempts, _ = self._pool.evaluate(
                with_digests(controllers.architecture),
                controllers.weights,
                seeds,
                progress,
                only=only,
            )
        self.check()
        servers = {
            (attempt["candidate"], attempt["episode"]): attempt["server"]
            for attempt in attempts
            if attempt["outcome"] == "done"
        }
        rows, episodes = (list(part) for part in zip(*places, strict=True))
        found = Results(
            fitness[rows, episodes][:, np.newaxis], metrics[rows, episodes][:, np.newaxis], Journal()
        )
        results = apply_expression(self._expression, found, range(len(evaluations)))
        return results, [servers.get(place) for place in places]

    def tolerance(self, servers: AbstractSet[int | None]) -> float | None:
        """Return how far results of these servers may differ, as they declare it."""
        declared = {server: (kind, margin) for server, kind, margin in self._pool.determinism()}
        return tolerance_of(declared[server] for server in servers if server in declared)

    def stream(
        self, controllers: Controllers, seeds: Sequence[int], feed: Feed, on_progress: Progress
    ) -> None:
        """Evaluate on the servers that there are; each gets another candidate as soon as it has done one."""
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
        """Evaluate as `stream`; revised: candidates are fed again where a server turns out to be wrong."""

        def take(
            candidates: list[int],
            fitness: NDArray[np.float64],
            metrics: NDArray[np.float64],
            attempts: list[AttemptFields],
            warnings: list[WarningFields],
        ) -> NDArray[np.float32] | None:
            self.check()
            results = Results(fitness, metrics, self.journal(attempts, warnings))
            return feed(candidates, self._valued(results, candidates))

        def progress(done: int, total: int, waiting_for: str) -> None:
            self.check()
            on_progress(done, total, waiting_for)

        with engine_errors():
            architecture = with_digests(controllers.architecture)
            self._pool.stream(architecture, controllers.weights, list(seeds), take, progress, revised=revised)

    def check(self) -> None:
        """Log servers that have been given up; raise RunError when none is left."""
        if self._servers is not None:
            self._servers.check()


def _advice(experiment: Experiment) -> str:
    """Return how a server of the experiment's simulation is started, where there is none."""
    served = experiment.simulation
    if is_command(served):
        served = "EXPERIMENT.yaml" if experiment.path is None else str(experiment.path)
    elif not catalogue.is_local(served):
        return (
            f"; start a server that offers {served!r} on this broker, or name a launcher that does under "
            "`servers:` in the experiment; a server that runs, but does not announce itself, answers only if "
            "it has the title, the dimensions and the max_agents that are required"
        )
    return f"; start one with: swarmwright serve {shlex.quote(served)}"
