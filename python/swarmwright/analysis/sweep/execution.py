"""Execution of a sweep's runs, sequentially or in parallel, with progress reports."""

import logging
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace

from swarmwright.analysis.left_out import LeftOut
from swarmwright.analysis.sweep import record
from swarmwright.analysis.sweep.file import Sweep
from swarmwright.analysis.sweep.jobs import shares
from swarmwright.analysis.sweep.run import BusyRunError, Executor, Task, UnreadableRunError, reason
from swarmwright.analysis.sweep_folders import as_missing, as_unreadable
from swarmwright.common.errors import InputError
from swarmwright.runs import picture
from swarmwright.runs.optimization.generation import Generation
from swarmwright.runs.run import Run
from swarmwright.runs.store import FILE as STORE
from swarmwright.servers.evaluation.base import HERE, Servers


class Listener:
    """Receives the progress of a sweep; the base class ignores it."""

    def found(self, task: Task, run: Run) -> None:
        """A run was finished before."""

    def finished_elsewhere(self, task: Task, run: Run) -> None:
        """Another process has finished a run since the sweep was started, before its turn here."""

    def planned(self, runs: int, jobs: int) -> None:
        """So many runs are to be done, so many at a time."""

    def begun(self, task: Task) -> None:
        """A run begins, or goes on."""

    def generation(self, task: Task, generation: Generation) -> None:
        """A run has evaluated a generation."""

    def evaluating(self, task: Task, done: int, total: int, waiting_for: str) -> None:
        """Within a generation; see `swarmwright.optimize`."""

    def ended(self, task: Task, run: Run) -> None:
        """A run is finished."""

    def failed(self, task: Task, message: str) -> None:
        """A run failed; the others go on."""

    def busy(self, task: Task) -> None:
        """Another process works on a run, which is left to it."""

    def tick(self) -> None:
        """Some time has passed, a quarter of a second or less."""


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
            replace(one, label=task.variant.label, seed=task.seed)
            for one in unreadable
            for task in self.tasks
            if task.folder == one.path
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
    before = [_finished_run(task) for task in tasks]  # report errors before anything is started
    try:
        record.write(sweep, tasks)
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
    experiments = [one.experiment for one in sweep.variants]
    if broker is None and servers not in HERE and experiments[0].servers not in HERE:
        broker = experiments[0].broker
    try:
        parts = shares(experiments, len(left), jobs, broker=broker, servers=servers) if left else []
        noting.planned(len(left), len(parts))
        if len(parts) > 1:
            from swarmwright.analysis.sweep.workers import SideBySide  # noqa: PLC0415 - it imports this module

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


def finished(task: Task) -> Run | None:
    """Return a run that another process has finished meanwhile; None for one that it has not."""
    with suppress(InputError):  # reported when it is done here, or it remains what it was
        run = _finished_run(task)
        return run if isinstance(run, Run) else None
    return None


def _finished_run(task: Task) -> Run | UnreadableRunError | None:
    """Return a run that is finished, or why it cannot be read; None for what is left to do."""
    try:
        run = task.found()
        if run is None:
            return None
    except UnreadableRunError as error:
        return error
    try:
        return run if task.is_finished(run) else None
    except InputError as error:  # such as a plug-in that is not installed: the run itself is whole
        return UnreadableRunError(str(error))


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
