"""Execution of a sweep's runs, sequentially or in parallel, with progress reports."""

import json
import logging
import os
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import Any

from swarmwright import _engine
from swarmwright.analysis.episodes import LeftOut
from swarmwright.analysis.sweep.file import Sweep
from swarmwright.analysis.sweep.recorded import with_names
from swarmwright.analysis.sweep.run import (
    BusyRunError,
    Executor,
    Listener,
    Task,
    UnreadableRunError,
    open_finished,
    open_if_finished,
    reason,
)
from swarmwright.analysis.sweep.variants import Variant
from swarmwright.analysis.sweep.workers import WorkerPool
from swarmwright.analysis.sweep_folders import exclude_missing, exclude_unreadable
from swarmwright.common.errors import InputError, PlugInError
from swarmwright.common.files import write_whole
from swarmwright.common.plug_in_code import report_failures
from swarmwright.experiment.derived import with_environment
from swarmwright.experiment.experiment import KEYS_OUTSIDE_RECORD, Experiment
from swarmwright.experiment.launcher_entries import to_file_value
from swarmwright.methods import METHODS
from swarmwright.runs import picture
from swarmwright.runs.run import Run
from swarmwright.runs.store import FILE as STORE
from swarmwright.runs.store.folder import SWEEP
from swarmwright.servers.broker.credentials import load_from_keyring
from swarmwright.servers.evaluation import opening
from swarmwright.servers.evaluation.base import BROKERLESS, Servers, resolve_servers
from swarmwright.servers.supervision.local_servers import automatic_count, count_processors
from swarmwright.simulations import catalogue

_DISCOVERY_S = 1.0
"""Seconds to wait for the presence of servers on a broker."""
_ASSUMED_POPULATION = 50
"""Candidates per generation, if their number depends on sizes that only a server knows."""


def choose_servers(
    experiments: Sequence[Experiment],
    runs: int,
    jobs: int | None,
    *,
    broker: str | None,
    servers: Servers | None,
) -> list[Servers | None]:
    """Return the servers that each parallel run starts; None if it uses those on the broker.

    By default, there are as many parallel runs as can work without sharing a resource:

    - evaluated in this process: a run for each processor;
    - on servers that are started: a run for each server, with a separate broker;
    - on servers on a broker: as many runs as they can serve, if each uses as many as its generation has
      evaluations.

    Args:
        experiments: experiments of the variants.
        runs: number of runs to do.
        jobs: number of parallel runs.
        broker: of existing servers.
        servers: to start, in place of the first experiment's.

    Raises:
        InputError: there are fewer servers than parallel runs.
    """
    first = experiments[0]
    choice = resolve_servers(first, servers)
    if broker is None and choice == "auto" and opening.prefers_local(first):
        choice = "local"
    if any(experiment.simulation.startswith("__main__:") for experiment in experiments):
        jobs = 1  # the class is defined in this session and unknown to other processes
    most = max(runs, 1)
    if broker is None and choice in BROKERLESS:
        jobs = min(jobs or count_processors(), most)
        if choice == "in-process" or not all(
            opening.has_workers(experiment.simulation) for experiment in experiments
        ):
            return [choice] * jobs
        choice = max(count_processors(), jobs)  # for all runs together
    if isinstance(choice, tuple):  # sequential runs, each with all servers
        return [to_file_value(choice)]
    if broker is not None and not isinstance(servers, int):
        return [None] * min(jobs or _count_parallel_runs(experiments, broker), most)
    count = choice if isinstance(choice, int) else max(automatic_count(), jobs or 1)
    if jobs is None:
        jobs = count if broker is None else 1
    if jobs > count:
        raise InputError(
            f"jobs: {jobs} parallel runs need at least {jobs} servers, but only {count} would be started; "
            "use more servers or fewer jobs"
        )
    jobs = min(jobs, most)
    return [count // jobs + (index < count % jobs) for index in range(jobs)]


def _count_parallel_runs(experiments: Sequence[Experiment], broker: str) -> int:
    """Return how many runs the servers on a broker can serve in parallel."""
    load_from_keyring(broker)
    first = experiments[0]
    presences = _engine.servers(broker, prefix=with_environment(first).prefix, wait=_DISCOVERY_S)
    titles = {catalogue.title(experiment.simulation) for experiment in experiments}
    suitable = [
        presence
        for presence in presences
        if presence.get("state") != "lost" and titles <= set(presence.get("simulations") or ())
    ]
    return max(1, len(suitable) // max(_count_parallel_evaluations(experiment) for experiment in experiments))


def _count_parallel_evaluations(experiment: Experiment) -> int:
    """Return how many evaluations of a run can be made in parallel, each on another server."""
    options = experiment.method
    if options.operation == "steady_state":
        return int(options.in_flight) * experiment.ranking.episodes
    representation = candidates = None
    # InputError: only a server knows the numbers of sensors and actuators. Failures of plug-ins are reported
    # by the runs that use them.
    with suppress(InputError, PlugInError), report_failures():
        representation = experiment.representation()
    with suppress(InputError, PlugInError), report_failures():
        candidates = METHODS.get(options.kind).first_generation(options, representation)
    return (candidates or _ASSUMED_POPULATION) * experiment.ranking.episodes


_LEFT_OUT = (KEYS_OUTSIDE_RECORD - {"validate"}) | {"seed"}


def write(sweep: Sweep, tasks: Sequence[Task]) -> None:
    """Write the record of a sweep, unless it exists already.

    Raises InputError when it cannot be written.
    """
    file = sweep.out / SWEEP
    data = f"{json.dumps(_plain(sweep, tasks), default=str, ensure_ascii=False, indent=1)}\n".encode()
    try:
        if file.is_file() and file.read_bytes() == data:
            return
        sweep.out.mkdir(parents=True, exist_ok=True)
        write_whole(file, data)
    except OSError as error:
        raise InputError(f"{file}: cannot be written: {os.strerror(error.errno or 0)}") from error


def _plain(sweep: Sweep, tasks: Sequence[Task]) -> dict[str, Any]:
    experiments = [_record_variant(member) for member in sweep.variants]
    first = experiments[0]
    common = {
        key: value
        for key, value in first.items()
        if all(key in experiment and experiment[key] == value for experiment in experiments)
    }
    runs: dict[int, list[str]] = {}
    for task in tasks:
        runs.setdefault(id(task.variant), []).append(task.folder.name)
    return {
        "file": None if sweep.file is None else str(sweep.file),
        "settings": list(sweep.settings),
        "seeds": list(sweep.seeds),
        "experiment": common,
        "variants": [
            {
                "label": variant.label,
                "keys": list(variant.keys),
                "experiment": {key: value for key, value in experiment.items() if key not in common},
                "runs": runs.get(id(variant), []),
            }
            for variant, experiment in zip(sweep.variants, experiments, strict=True)
        ],
    }


def _record_variant(variant: Variant) -> dict[str, Any]:
    """Return the recorded values of a variant, with the original names of its code."""
    experiment = variant.experiment
    values = {key: value for key, value in experiment.to_mapping().items() if key not in _LEFT_OUT}
    return with_names(values, variant.names)


@dataclass
class Outcome:
    """The results of a sweep's runs."""

    tasks: Sequence[Task]
    runs: dict[Task, Run] = field(default_factory=dict)
    """Finished runs."""
    failures: dict[Task, str] = field(default_factory=dict)
    """Reasons of failed runs."""
    busy: list[Task] = field(default_factory=list)
    """Runs that another process works on and had not finished at the end."""
    interrupted: bool = False
    """Whether Ctrl-C ended it before all runs were done."""

    @property
    def finished(self) -> list[Run]:
        """Finished runs, in the order of the tasks."""
        return [self.runs[task] for task in self.tasks if task in self.runs]

    def open_runs(self) -> tuple[list[Run], list[LeftOut]]:
        """Return all readable runs, finished or not, and the others, as for `compare_opened`."""
        runs: list[Run] = []
        unreadable: list[LeftOut] = []
        for task in self.tasks:
            if task in self.runs:
                runs.append(self.runs[task])
            elif not (task.folder / STORE).exists():
                unreadable += exclude_missing([task.folder])
            else:
                try:
                    runs.append(Run.open(task.folder))
                except InputError as error:
                    unreadable.append(exclude_unreadable(task.folder, error))
        return runs, [
            replace(left_out_run, label=task.variant.label, seed=task.seed)
            for left_out_run in unreadable
            for task in self.tasks
            if task.folder == left_out_run.path
        ]


class _OutcomeListener(Listener):
    """Records the outcome, and forwards everything to another listener."""

    def __init__(self, outcome: Outcome, listener: Listener) -> None:
        self._outcome = outcome
        self._listener = listener
        self.on_begin = listener.on_begin  # type: ignore[method-assign] # forwarded unchanged
        self.generation = listener.generation  # type: ignore[method-assign]
        self.evaluating = listener.evaluating  # type: ignore[method-assign]
        self.on_plan = listener.on_plan  # type: ignore[method-assign]
        self.tick = listener.tick  # type: ignore[method-assign]

    def on_already_finished(self, task: Task, run: Run) -> None:
        self._outcome.runs[task] = run
        self._listener.on_already_finished(task, run)

    def on_finished_elsewhere(self, task: Task, run: Run) -> None:
        self._outcome.runs[task] = run
        self._listener.on_finished_elsewhere(task, run)

    def on_end(self, task: Task, run: Run) -> None:
        self._outcome.runs[task] = run
        self._listener.on_end(task, run)

    def on_failure(self, task: Task, message: str) -> None:
        self._outcome.failures[task] = message
        self._listener.on_failure(task, message)

    def busy(self, task: Task) -> None:
        self._outcome.busy.append(task)
        self._listener.busy(task)


def conduct(
    sweep: Sweep,
    tasks: Sequence[Task],
    listener: Listener,
    *,
    jobs: int | None = None,
    broker: str | None = None,
    servers: Servers | None = None,
) -> Outcome:
    """Do all unfinished runs of a sweep; return the outcome.

    A failed run does not stop the others. Ctrl-C does: then `interrupted` is set, and finished runs are kept.
    Runs that another process works on are left to it, and count if they are finished at the end.

    Args:
        sweep: the sweep.
        tasks: the runs, in the order in which they start.
        listener: receives the progress.
        jobs: number of parallel runs; default: see `choose_servers`.
        broker: as in `optimize`.
        servers: as in `optimize`, for all runs together.

    Raises:
        InputError: a folder holds something else, or there are fewer servers than jobs.
        RunError: no broker, or servers do not start.
    """
    outcome = Outcome(tasks)
    listener = _OutcomeListener(outcome, listener)
    before = [open_if_finished(task) for task in tasks]  # report errors before anything is started
    try:
        write(sweep, tasks)
    except InputError as error:  # a read-only folder: its finished runs can still be compared
        logging.getLogger("swarmwright").warning("%s", error)
    remaining = []
    for task, run in zip(tasks, before, strict=True):
        if isinstance(run, BusyRunError):
            listener.busy(task)
        elif isinstance(run, UnreadableRunError):
            listener.on_failure(task, str(run))
        elif run is not None:
            listener.on_already_finished(task, run)
            picture.draw_missing(task.folder)
        else:
            remaining.append(task)
    experiments = [variant.experiment for variant in sweep.variants]
    if broker is None and servers not in BROKERLESS and experiments[0].servers not in BROKERLESS:
        broker = experiments[0].broker
    try:
        parts = (
            choose_servers(experiments, len(remaining), jobs, broker=broker, servers=servers)
            if remaining
            else []
        )
        listener.on_plan(len(remaining), len(parts))
        if len(parts) > 1:
            WorkerPool(sweep.variants, broker=broker, servers=parts, listener=listener).run(remaining)
        elif remaining:
            outcome.interrupted = not _run_sequentially(sweep, remaining, listener, broker, parts[0])
    except KeyboardInterrupt:
        outcome.interrupted = True
    for task in list(outcome.busy):  # other processes may have finished them meanwhile
        run = open_finished(task)
        if run is not None:
            outcome.busy.remove(task)
            outcome.runs[task] = run
    return outcome


def _run_sequentially(
    sweep: Sweep, tasks: Sequence[Task], listener: Listener, broker: str | None, servers: Servers | None
) -> bool:
    """Do tasks in this process; return whether all were done."""
    with Executor(sweep, broker=broker, servers=servers) as executor:
        for task in tasks:
            finished_run = open_finished(task)
            if finished_run is not None:
                listener.on_finished_elsewhere(task, finished_run)
                continue
            listener.on_begin(task)
            try:
                run = executor.run(
                    task,
                    _callback_of_task(listener.generation, task),
                    _callback_of_task(listener.evaluating, task),
                )
            except BrokenPipeError:  # the listener's output pipe is closed
                raise
            except BusyRunError:
                listener.busy(task)
                continue
            except Exception as error:  # noqa: BLE001 - errors of plug-ins do not stop the other runs
                listener.on_failure(task, reason(error))
                continue
            if run.interrupted:
                return False
            listener.on_end(task, run)
            listener.tick()
    return True


def _callback_of_task(tell: Callable[..., None], task: Task) -> Callable[..., None]:
    """Return a callback for `optimize` that adds the task."""
    return lambda *values: tell(task, *values)
