"""Runs of a sweep: which are left to do, and the brokers and servers that they share."""

import dataclasses
import json
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

from swarmwright.analysis.sweep.file import Sweep
from swarmwright.analysis.sweep.variants import Variant, comparable
from swarmwright.analysis.sweep_folders import names_of
from swarmwright.common.errors import InputError, SwarmwrightError
from swarmwright.common.files import read_contents
from swarmwright.common.json_text import loads
from swarmwright.experiment.budget import LIMITS
from swarmwright.experiment.document import AUTO, Validate
from swarmwright.experiment.experiment import Experiment
from swarmwright.experiment.launcher_entries import Entries
from swarmwright.runs.code import check_trusted, describe_code_changes
from swarmwright.runs.edits import differences
from swarmwright.runs.optimization.generation import Generation, OnGeneration
from swarmwright.runs.optimization.optimize import adopt_budget, leave_reports_to_caller, optimize, resume
from swarmwright.runs.optimization.resuming import NothingLeftError, extend_experiment
from swarmwright.runs.run import Run
from swarmwright.runs.store import FILE
from swarmwright.runs.store.folder import SWEEP, build_missing_store_error, check_folder
from swarmwright.runs.store.lock import is_locked
from swarmwright.runs.transfer import at_end
from swarmwright.runs.validation import is_due
from swarmwright.servers.evaluation import opening
from swarmwright.servers.evaluation.base import BROKERLESS, Progress, ServerChoice, Servers, resolve_servers
from swarmwright.servers.supervision.local_servers import LocalServers
from swarmwright.simulations import catalogue


class UnreadableRunError(InputError):
    """A run of a sweep that is there and cannot be read or used: it is damaged, or lacks a plug-in here."""


class BusyRunError(UnreadableRunError):
    """Another process works on a run of a sweep."""

    def __init__(self, folder: Path) -> None:
        super().__init__(f"{folder}: another process is writing this run; wait for it or stop it")


@contextmanager
def readable(folder: Path) -> Iterator[None]:
    """Within the block, a run is read: what is wrong with it concerns no other run."""
    try:
        yield
    except InputError as error:
        raise UnreadableRunError(
            f"{error}; when the folder {folder} is deleted, the same sweep repeats this run alone"
        ) from error


def _check_new(folder: Path) -> None:
    """Raise unless a run can be begun in a folder without a store, as `Task.found` says."""
    try:
        check_folder(folder)
    except InputError:
        if is_locked(folder):
            raise BusyRunError(folder) from None
        if not folder.is_dir() or not any(folder.iterdir()):
            raise  # no right to write, or the path is too long: other runs fail as well
        with readable(folder):
            raise build_missing_store_error(folder) from None


@dataclass(frozen=True, eq=False)
class Task:
    """One run of a sweep."""

    variant: Variant
    seed: int
    folder: Path

    @property
    def experiment(self) -> Experiment:
        """As it is run."""
        return self.variant.experiment.replace(seed=self.seed)

    def found(self) -> Run | None:
        """Return the run that is there already, finished or not; None when there is none.

        Raises UnreadableRunError when the run is damaged or the folder is not that of a run, BusyRunError
        when another process works on it, InputError when it is a run of another experiment, or the folder
        cannot be made.
        """
        if not (self.folder / FILE).exists():
            _check_new(self.folder)
            return None
        with readable(self.folder):
            run = Run.open(self.folder)
            _ = run.sessions
        differing = differences(comparable(run.experiment), comparable(self.experiment))
        if differing:
            raise InputError(
                f"{self.folder}: holds a run of another experiment: {', '.join(map(str, differing))}; name "
                "another folder for the results (out)"
            )
        changed = describe_code_changes(run, self.experiment)
        if changed is not None:
            raise InputError(
                f"{changed}\nRuns of different code cannot be compared. Restore what was edited, or name "
                "another folder for the results (out)"
            )
        if run.state == "running":
            raise BusyRunError(self.folder)
        budget = self.budget_settings(run)
        if budget:
            try:
                extend_experiment(run, run.experiment, budget, {})
            except InputError as error:
                raise InputError(
                    f"{self.folder}: {error}; name another folder for the results (out)"
                ) from error
        if run.state != "done" or self.settings(run):
            check_trusted(run)  # workers, which continue it, cannot ask
        return run

    def is_finished(self, run: Run) -> bool:
        """Return whether nothing is left to do of the run that is there, its validation included.

        Raises InputError where a plug-in that it needs is not installed.
        """
        if run.interrupted or run.validation_is_due or run.transfer_is_due:
            return False
        return not self.settings(run)

    def settings(self, run: Run) -> list[str]:
        """Return the settings with which the run that is there goes on to be what the sweep asks for."""
        return [*self.budget_settings(run), *self.validation_settings(run)]

    def budget_settings(self, run: Run) -> list[str]:
        """Return the settings with which the run that is there goes on to the limits of the sweep.

        Empty where it has these.
        """
        wanted, has = vars(self.experiment.budget), vars(run.experiment.budget)
        return [
            f"method.{limit}={json.dumps(wanted[limit])}" for limit in LIMITS if wanted[limit] != has[limit]
        ]

    def validation_settings(self, run: Run) -> list[str]:
        """Return the settings with which the run that is there goes on to have the sweep's `validate`.

        Empty where that is the same, or the run is finished and has as many held-out episodes and candidates:
        a validation is not replaced by one with fewer episodes or candidates: the larger numbers are taken.
        """
        wanted, has = self.experiment.validate, run.experiment.validate
        goes_on = bool(self.budget_settings(run))
        if wanted == has or (run.state == "stopped" and not goes_on):
            return []
        if goes_on:
            wanted = _no_smaller(wanted, run)
        elif not run.interrupted:
            more = _asks_for_more(wanted, run)
            wanted = _no_smaller(wanted, run)
            asked = dataclasses.replace(run.experiment, validate=wanted)
            transfers = wanted.transfers and at_end.is_due(asked, run._store)
            if not transfers and not (more and is_due(asked, run._store, changed=True)):
                return []
        experiment = dataclasses.replace(self.experiment, validate=wanted)
        return [f"validate={json.dumps(experiment.to_mapping()['validate'])}"]


def _asks_for_more(wanted: Validate, run: Run) -> bool:
    """Return whether a validation has more episodes or candidates than that of a run, or other seeds."""
    if wanted.episodes == 0:
        return False
    asks, has = run.validation, run.experiment.validate
    if asks is None:
        return True
    if wanted.episodes == AUTO:
        return False
    return (
        wanted.episodes > len(asks.best.seeds)
        or wanted.candidates > has.candidates
        or (wanted.seed is not None and wanted.seed != has.seed)
    )


def _no_smaller(wanted: Validate, run: Run) -> Validate:
    """Return a validation with at least as many episodes and candidates as a run has been validated with."""
    found, has = run.validation, run.experiment.validate
    if found is None:
        return wanted
    if wanted.episodes in {0, AUTO}:
        return wanted.model_copy(
            update={"episodes": has.episodes, "candidates": has.candidates, "seed": has.seed}
        )
    return wanted.model_copy(
        update={
            "episodes": max(wanted.episodes, len(found.best.seeds)),
            "candidates": max(wanted.candidates, len(found.candidates)),
        }
    )


def _with_longer_runs(sweep: Sweep, folders: Sequence[str]) -> list[str]:
    """Return folders of variants, with those of runs that a variant without any goes on with.

    Where the sweep file was edited to have larger limits, the folders of its runs are named after the smaller
    ones.

    folders: of each variant, without the seed.
    """
    new = [
        not any((sweep.out / f"{folder}-{seed}" / FILE).exists() for seed in sweep.seeds)
        for folder in folders
    ]
    found = _shorter_runs(sweep, set(folders)) if any(new) else []
    chosen = list(folders)
    for place, variant in enumerate(sweep.variants):
        for earlier in found if new[place] else ():
            name, experiment = earlier
            if comparable(experiment) == {**comparable(variant.experiment), "seed": experiment.seed} and all(
                limit is None or (before is not None and limit >= before)
                for limit, before in zip(
                    vars(variant.experiment.budget).values(), vars(experiment.budget).values(), strict=True
                )
            ):
                chosen[place] = name
                found.remove(earlier)
                break
    return chosen


def _shorter_runs(sweep: Sweep, taken: Collection[str]) -> list[tuple[str, Experiment]]:
    """Return folders, without the seed, that an earlier version of the sweep file made, and what they hold.

    taken: folders of variants, which are left out.
    """
    file = sweep.out / SWEEP
    shorter_runs = []
    # Without a file or record, or with a damaged one, nothing says that the runs are of the same sweep.
    with suppress(InputError, ValueError, KeyError, TypeError):
        if sweep.file is None or not file.is_file():
            return []
        recorded = loads(read_contents(file))
        if recorded["file"] != str(sweep.file):
            return []
        for variant in recorded["variants"]:
            seeds = zip(names_of(variant["runs"]), recorded["seeds"], strict=True)
            for folder, seed in seeds:
                name = folder.removesuffix(f"-{seed}")
                if name not in taken and (sweep.out / folder / FILE).exists():
                    shorter_runs.append((name, Run.open(sweep.out / folder).experiment))
                    break
    return shorter_runs


def tasks(sweep: Sweep) -> list[Task]:
    """Return all runs: every variant with the first seed, then with the next one.

    A stopped sweep then has about equally many runs of each variant.
    """
    alike = {_identity(member.experiment): member.alike for member in sweep.variants if member.alike}
    there = {name: _existing(sweep, name, alike) for name in set(alike.values())}
    folders = _with_longer_runs(sweep, [_folder(variant, there) for variant in sweep.variants])
    return [
        Task(variant, seed, sweep.out / f"{folder}-{seed}")
        for seed in sweep.seeds
        for variant, folder in zip(sweep.variants, folders, strict=True)
    ]


def _folder(variant: Variant, there: Mapping[str, str | None]) -> str:
    """Return the name of a variant's folders, without the seed.

    Where several variants would have one name, it is that of the variant whose runs are there: variants of
    other grids may have come before this one.

    there: what `_existing` returns, for each of these names.
    """
    if not variant.alike:
        return variant.folder
    existing = there[variant.alike]
    if existing == _identity(variant.experiment):
        return variant.alike
    return variant.folder if existing is None else variant.apart


def _existing(sweep: Sweep, name: str, identities: Collection[str]) -> str | None:
    """Return which of these variants has runs in the folders of a name; None where none has."""
    folders = (sweep.out / f"{name}-{seed}" for seed in sweep.seeds)
    folder = next((path for path in folders if (path / FILE).exists()), None)
    if folder is not None:
        with suppress(InputError):  # of a run that is damaged
            identity = _identity(Run.open(folder).experiment)
            return identity if identity in identities else None
    return None


def _identity(experiment: Experiment) -> str:
    """Return what tells the runs of a variant from those of others, as text."""
    values = {**comparable(experiment), "seed": None, "budget": vars(experiment.budget)}
    return json.dumps(values, sort_keys=True)


def reason(error: Exception) -> str:
    """Return why a run failed, in words; with the name of the error if it has no message for users."""
    return str(error) if isinstance(error, SwarmwrightError) else f"{type(error).__name__}: {error}"


def _check_titles(sweep: Sweep) -> None:
    """Raise InputError where servers on one broker could not be told apart by their simulations' titles."""
    found: dict[str, str] = {}
    for simulation in dict.fromkeys(variant.experiment.simulation for variant in sweep.variants):
        title = catalogue.title(simulation)
        other = found.setdefault(title, simulation)
        if other != simulation:
            raise InputError(
                f"the simulations {other} and {simulation} are both called {title!r} on the broker, so that "
                "their servers cannot be told apart; give the classes different titles, or leave out the "
                "broker"
            )


class Executor:
    """Brokers and servers for runs of a sweep, one after the other.

    A context manager: what it started ends with it.

    Args:
        sweep: whose runs.
        broker: use the servers on this broker.
        servers: as in `optimize`, instead of the experiments'.

    Raises:
        InputError, RunError: on entry, as `optimize`.
    """

    def __init__(self, sweep: Sweep, *, broker: str | None = None, servers: Servers | None = None) -> None:
        self._sweep = sweep
        self._broker = broker
        self._servers = servers
        self._started: list[LocalServers] = []
        self._addresses: dict[str, str] = {}
        self._here: Servers = "local"
        self._launched: Entries | None = None
        self._stack = ExitStack()

    def __enter__(self) -> Self:
        first = self._sweep.variants[0].experiment
        wanted = resolve_servers(first, self._servers)
        if self._broker is None and wanted not in BROKERLESS:
            self._broker = first.broker
        if wanted in BROKERLESS and self._broker is None:
            self._here = wanted
            return self
        if self._broker is not None:
            _check_titles(self._sweep)
        if isinstance(wanted, tuple):
            self._launched = wanted  # each run starts them, on this broker
            return self
        try:
            self._start(wanted)
        except BaseException:
            self._stack.close()
            raise
        return self

    def _start(self, wanted: ServerChoice) -> None:
        """Start servers for every simulation that there is among the variants.

        Each has a broker of its own, unless one is given: a run finds servers by the title of their
        simulation, which is that of other versions of its code as well.
        """
        experiments = {variant.experiment.simulation: variant.experiment for variant in self._sweep.variants}
        for experiment in experiments.values():
            same = (variant.experiment for variant in self._sweep.variants)
            modules = opening.modules_of(
                [similar for similar in same if similar.simulation == experiment.simulation]
            )
            address, local = opening.open_servers(
                self._stack, experiment, self._broker, wanted, started=self._servers, modules=modules
            )
            self._addresses[experiment.simulation] = address
            if local is not None:
                self._started.append(local)

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def run(
        self, task: Task, on_generation: OnGeneration | None = None, on_progress: Progress | None = None
    ) -> Run:
        """Do a task, or what is left of it; return the run.

        Raises InputError and RunError as `optimize` and `resume`; BusyRunError when another process works on
        it; KeyboardInterrupt before the first generation.
        """
        for local in self._started:
            local.check()
        broker = self._addresses.get(task.experiment.simulation, self._broker)
        where: dict[str, Any] = {"broker": broker, "on_progress": on_progress, "progress": False}
        if self._launched is not None:
            where = {**where, "servers": self._launched}
        elif broker is None:
            where = {"servers": self._here, "on_progress": on_progress, "progress": False}
        try:
            found = task.found()
            with leave_reports_to_caller():
                if found is not None:
                    return _go_on(task, found, on_generation, where)
                return optimize(task.experiment, on_generation, out=task.folder, **where)
        except InputError as error:
            if is_locked(task.folder):  # another process began it in the meantime
                raise BusyRunError(task.folder) from error
            raise


def _go_on(task: Task, run: Run, on_generation: OnGeneration | None, where: Mapping[str, Any]) -> Run:
    """Do what is left of a run; see `Executor.run`. A larger budget may leave nothing but what it is."""
    try:
        return resume(task.folder, on_generation, settings=task.settings(run), **where)
    except NothingLeftError:
        adopt_budget(task.folder, task.budget_settings(run))
    now = Run.open(task.folder)
    return resume(task.folder, on_generation, settings=task.settings(now), **where)


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


def finished(task: Task) -> Run | None:
    """Return a run that another process has finished meanwhile; None for one that it has not."""
    with suppress(InputError):  # reported when it is done here, or it remains what it was
        run = finished_run(task)
        return run if isinstance(run, Run) else None
    return None


def finished_run(task: Task) -> Run | UnreadableRunError | None:
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
