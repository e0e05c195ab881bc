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
    finished,
    finished_run,
    reason,
)
from swarmwright.analysis.sweep.variants import Variant
from swarmwright.analysis.sweep.workers import SideBySide
from swarmwright.analysis.sweep_folders import as_missing, as_unreadable
from swarmwright.common.errors import InputError, PlugInError
from swarmwright.common.files import write_whole
from swarmwright.common.plug_in_code import report_failures
from swarmwright.experiment.derived import with_environment
from swarmwright.experiment.experiment import ELSEWHERE, Experiment
from swarmwright.experiment.launcher_entries import written
from swarmwright.methods import METHODS
from swarmwright.runs import picture
from swarmwright.runs.run import Run
from swarmwright.runs.store import FILE as STORE
from swarmwright.runs.store.folder import SWEEP
from swarmwright.servers.broker.credentials import load_from_keyring
from swarmwright.servers.evaluation import here
from swarmwright.servers.evaluation.base import BROKERLESS, Servers, resolve_servers
from swarmwright.servers.supervision.local_servers import automatic_count, count_processors
from swarmwright.simulations import catalogue

_LISTEN = 1.0
"""Seconds for servers on a broker to say that they are there."""
_ASSUMED_POPULATION = 50
"""Candidates of a generation where their number depends on what only a server knows."""


def shares(
    experiments: Sequence[Experiment],
    runs: int,
    jobs: int | None,
    *,
    broker: str | None,
    servers: Servers | None,
) -> list[Servers | None]:
    """Return for each run that goes on at a time which servers it starts; None: none, it uses the broker's.

    Without `jobs`, there are as many as can work in parallel without sharing a resource:

    - evaluated in this process: a run for each processor;
    - servers that are started: a run for each of them, with a separate broker;
    - servers on a broker: as many runs as they can serve, where each takes as many as its generation has
      evaluations.

    Args:
        experiments: of the variants.
        runs: that are to be done.
        jobs: how many at a time.
        broker: whose servers are used.
        servers: which are started, instead of the first experiment's.

    Raises:
        InputError: fewer servers are to be started than runs go on at a time.
    """
    first = experiments[0]
    wanted = resolve_servers(first, servers)
    if broker is None and wanted == "auto" and here.prefers_local(first):
        wanted = "local"
    if any(experiment.simulation.startswith("__main__:") for experiment in experiments):
        jobs = 1  # a class of this session, which no other process finds
    most = max(runs, 1)
    if broker is None and wanted in BROKERLESS:
        jobs = min(jobs or count_processors(), most)
        if wanted == "in-process" or not all(
            here.has_workers(experiment.simulation) for experiment in experiments
        ):
            return [wanted] * jobs
        wanted = max(count_processors(), jobs)  # all runs together, not each of them
    if isinstance(wanted, tuple):  # one run after the other has all of them
        return [written(wanted)]
    if broker is not None and not isinstance(servers, int):
        return [None] * min(jobs or _served(experiments, broker), most)
    count = wanted if isinstance(wanted, int) else max(automatic_count(), jobs or 1)
    if jobs is None:
        jobs = count if broker is None else 1
    if jobs > count:
        raise InputError(
            f"jobs: {jobs} runs at a time need as many servers, and {count} are to be started; give a larger "
            "number of servers, or fewer jobs"
        )
    jobs = min(jobs, most)
    return [count // jobs + (place < count % jobs) for place in range(jobs)]


def _served(experiments: Sequence[Experiment], broker: str) -> int:
    """Return how many runs the servers on a broker can serve at a time."""
    load_from_keyring(broker)
    first = experiments[0]
    found = _engine.servers(broker, prefix=with_environment(first).prefix, wait=_LISTEN)
    titles = {catalogue.title(experiment.simulation) for experiment in experiments}
    able = [
        presence
        for presence in found
        if presence.get("state") != "lost" and titles <= set(presence.get("simulations") or ())
    ]
    return max(1, len(able) // max(_at_a_time(experiment) for experiment in experiments))


def _at_a_time(experiment: Experiment) -> int:
    """Return how many evaluations of a run can be made at a time, each on another server."""
    options = experiment.method
    if options.operation == "steady_state":
        return int(options.in_flight) * experiment.ranking.episodes
    representation = candidates = None
    # InputError: where only a server knows the numbers of sensors and actuators. What fails in a plug-in is
    # reported by the runs that use it.
    with suppress(InputError, PlugInError), report_failures():
        representation = experiment.representation()
    with suppress(InputError, PlugInError), report_failures():
        candidates = METHODS.get(options.kind).first_generation(options, representation)
    return (candidates or _ASSUMED_POPULATION) * experiment.ranking.episodes


_LEFT_OUT = (ELSEWHERE - {"validate"}) | {"seed"}


def write(sweep: Sweep, tasks: Sequence[Task]) -> None:
    """Write the record, instead of that of an earlier sweep; nothing where it is there already.

    Raises InputError where it cannot be written.
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
    experiments = [_recorded_variant(member) for member in sweep.variants]
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


def _recorded_variant(variant: Variant) -> dict[str, Any]:
    """Return what the record has of a variant: a sweep that is repeated by it keeps the names of code."""
    experiment = variant.experiment
    kept = {key: value for key, value in experiment.to_mapping().items() if key not in _LEFT_OUT}
    return with_names(kept, variant.names)


@dataclass
class Outcome:
    """The results of a sweep's runs."""

    tasks: Sequence[Task]
    runs: dict[Task, Run] = field(default_factory=dict)
    """Finished ones."""
    failures: dict[Task, str] = field(default_factory=dict)
    """Why runs failed."""
    busy: list[Task] = field(default_factory=list)
    """Those that another process works on, and had not finished at the end."""
    interrupted: bool = False
    """Whether Ctrl-C ended it before all runs were done."""

    @property
    def finished(self) -> list[Run]:
        """Finished runs, in the order of the tasks."""
        return [self.runs[task] for task in self.tasks if task in self.runs]

    def compared(self) -> tuple[list[Run], list[LeftOut]]:
        """Return all runs that can be read, finished or not, and the others, as for `compare_opened`."""
        found: list[Run] = []
        unreadable: list[LeftOut] = []
        for task in self.tasks:
            if task in self.runs:
                found.append(self.runs[task])
            elif not (task.folder / STORE).exists():
                unreadable += as_missing([task.folder])
            else:
                try:
                    found.append(Run.open(task.folder))
                except InputError as error:
                    unreadable.append(as_unreadable(task.folder, error))
        return found, [
            replace(left_out_run, label=task.variant.label, seed=task.seed)
            for left_out_run in unreadable
            for task in self.tasks
            if task.folder == left_out_run.path
        ]


class _Noting(Listener):
    """Records the outcome, and forwards everything to another listener."""

    def __init__(self, outcome: Outcome, listener: Listener) -> None:
        self._outcome = outcome
        self._listener = listener
        self.begun = listener.begun  # type: ignore[method-assign] # passed on as it is
        self.generation = listener.generation  # type: ignore[method-assign]
        self.evaluating = listener.evaluating  # type: ignore[method-assign]
        self.planned = listener.planned  # type: ignore[method-assign]
        self.tick = listener.tick  # type: ignore[method-assign]

    def found(self, task: Task, run: Run) -> None:
        self._outcome.runs[task] = run
        self._listener.found(task, run)

    def finished_elsewhere(self, task: Task, run: Run) -> None:
        self._outcome.runs[task] = run
        self._listener.finished_elsewhere(task, run)

    def ended(self, task: Task, run: Run) -> None:
        self._outcome.runs[task] = run
        self._listener.ended(task, run)

    def failed(self, task: Task, message: str) -> None:
        self._outcome.failures[task] = message
        self._listener.failed(task, message)

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
    """Do all runs of a sweep that are not finished; return the outcome.

    A run that fails does not stop the others. Ctrl-C does; then `interrupted` is set, and what was finished
    is kept. A run that another process works on is left to it, and counts if it is finished at the end.

    Args:
        sweep: whose runs.
        tasks: the runs, in the order in which they are begun.
        listener: receives the progress.
        jobs: runs at a time; default: see `shares`.
        broker: as in `optimize`.
        servers: as in `optimize`, for all runs together.

    Raises:
        InputError: a folder holds something else, or there are fewer servers than jobs.
        RunError: no broker, or servers do not start.
    """
    outcome = Outcome(tasks)
    noting = _Noting(outcome, listener)
    before = [finished_run(task) for task in tasks]  # report errors before anything is started
    try:
        write(sweep, tasks)
    except InputError as error:  # a folder that may be read alone: finished runs are compared nevertheless
        logging.getLogger("swarmwright").warning("%s", error)
    left = []
    for task, run in zip(tasks, before, strict=True):
        if isinstance(run, BusyRunError):
            noting.busy(task)
        elif isinstance(run, UnreadableRunError):
            noting.failed(task, str(run))
        elif run is not None:
            noting.found(task, run)
            picture.draw_missing(task.folder)
        else:
            left.append(task)
    experiments = [variant.experiment for variant in sweep.variants]
    if broker is None and servers not in BROKERLESS and experiments[0].servers not in BROKERLESS:
        broker = experiments[0].broker
    try:
        parts = shares(experiments, len(left), jobs, broker=broker, servers=servers) if left else []
        noting.planned(len(left), len(parts))
        if len(parts) > 1:
            SideBySide(sweep.variants, broker=broker, servers=parts, listener=noting).run(left)
        elif left:
            outcome.interrupted = not _one_after_another(sweep, left, noting, broker, parts[0])
    except KeyboardInterrupt:
        outcome.interrupted = True
    _look_again(outcome)
    return outcome


def _look_again(outcome: Outcome) -> None:
    """Take over the runs that other processes have finished meanwhile."""
    for task in list(outcome.busy):
        run = finished(task)
        if run is not None:
            outcome.busy.remove(task)
            outcome.runs[task] = run


def _one_after_another(
    sweep: Sweep, tasks: Sequence[Task], listener: Listener, broker: str | None, servers: Servers | None
) -> bool:
    """Do tasks in this process; return whether all were done."""
    with Executor(sweep, broker=broker, servers=servers) as executor:
        for task in tasks:
            found = finished(task)
            if found is not None:
                listener.finished_elsewhere(task, found)
                continue
            listener.begun(task)
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
            except Exception as error:  # noqa: BLE001 - whatever a plug-in raises, the other runs go on
                listener.failed(task, reason(error))
                continue
            if run.interrupted:
                return False
            listener.ended(task, run)
            listener.tick()
    return True


def _callback_of_task(tell: Callable[..., None], task: Task) -> Callable[..., None]:
    """Return a callback of `optimize` that says which task it is of."""
    return lambda *values: tell(task, *values)
