"""Runs of a sweep: the remaining work, and the brokers and servers that they share."""

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
    """A run of a sweep cannot be read or used: it is damaged, or a plug-in is not installed."""


class BusyRunError(UnreadableRunError):
    """Another process works on a run of a sweep."""

    def __init__(self, folder: Path) -> None:
        super().__init__(f"{folder}: another process is writing this run; wait for it or stop it")


@contextmanager
def readable(folder: Path) -> Iterator[None]:
    """Raise UnreadableRunError for problems of a run within the block, which do not affect other runs."""
    try:
        yield
    except InputError as error:
        raise UnreadableRunError(
            f"{error}; delete the folder {folder} to repeat only this run in the same sweep"
        ) from error


def _check_new(folder: Path) -> None:
    """Raise unless a run can begin in a folder without a store, as `Task.open_run` documents."""
    try:
        check_folder(folder)
    except InputError:
        if is_locked(folder):
            raise BusyRunError(folder) from None
        if not folder.is_dir() or not any(folder.iterdir()):
            raise  # not writable, or the path is too long: other runs would fail as well
        with readable(folder):
            raise build_missing_store_error(folder) from None


@dataclass(frozen=True, eq=False)
class Task:
    """A run of a sweep."""

    variant: Variant
    seed: int
    folder: Path

    @property
    def experiment(self) -> Experiment:
        """The experiment with the seed of the run."""
        return self.variant.experiment.replace(seed=self.seed)

    def open_run(self) -> Run | None:
        """Return the existing run, finished or not; None if there is none.

        Raises UnreadableRunError when the run is damaged or the folder is not a run folder, BusyRunError when
        another process works on it, InputError when it is a run of another experiment, or the folder cannot
        be created.
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
                f"{self.folder}: holds a run of another experiment: {', '.join(map(str, differing))}; choose "
                "another folder for the results (out)"
            )
        changed = describe_code_changes(run, self.experiment)
        if changed is not None:
            raise InputError(
                f"{changed}\nRuns of different code cannot be compared. Restore the original code, or choose "
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
                    f"{self.folder}: {error}; choose another folder for the results (out)"
                ) from error
        if run.state != "done" or self.settings(run):
            check_trusted(run)  # the workers that continue it cannot ask the user
        return run

    def is_finished(self, run: Run) -> bool:
        """Return whether nothing is left to do for an existing run, including its validation.

        Raises InputError when a plug-in that it needs is not installed.
        """
        if run.interrupted or run.validation_is_due or run.transfer_is_due:
            return False
        return not self.settings(run)

    def settings(self, run: Run) -> list[str]:
        """Return the settings for resuming an existing run as the sweep requires it."""
        return [*self.budget_settings(run), *self.validation_settings(run)]

    def budget_settings(self, run: Run) -> list[str]:
        """Return the settings for resuming a run to the limits of the sweep; empty if it has them."""
        new, old = vars(self.experiment.budget), vars(run.experiment.budget)
        return [f"method.{limit}={json.dumps(new[limit])}" for limit in LIMITS if new[limit] != old[limit]]

    def validation_settings(self, run: Run) -> list[str]:
        """Return the settings for resuming an existing run with the sweep's `validate`.

        Empty if it is the same, or if a finished run has as many held-out episodes and candidates. The larger
        numbers of episodes and candidates are used, since a validation is not replaced by a smaller one.
        """
        options, old = self.experiment.validate, run.experiment.validate
        is_prolonged = bool(self.budget_settings(run))
        if options == old or (run.state == "stopped" and not is_prolonged):
            return []
        if is_prolonged:
            options = _enlarge_validation(options, run)
        elif not run.interrupted:
            is_larger = _is_larger_validation(options, run)
            options = _enlarge_validation(options, run)
            changed = dataclasses.replace(run.experiment, validate=options)
            transfers = options.transfers and at_end.is_due(changed, run._store)
            if not transfers and not (is_larger and is_due(changed, run._store, changed=True)):
                return []
        experiment = dataclasses.replace(self.experiment, validate=options)
        return [f"validate={json.dumps(experiment.to_mapping()['validate'])}"]


def _is_larger_validation(options: Validate, run: Run) -> bool:
    """Return whether options have more episodes or candidates than a run's validation, or other seeds."""
    if options.episodes == 0:
        return False
    validation, old = run.validation, run.experiment.validate
    if validation is None:
        return True
    if options.episodes == AUTO:
        return False
    return (
        options.episodes > len(validation.best.seeds)
        or options.candidates > old.candidates
        or (options.seed is not None and options.seed != old.seed)
    )


def _enlarge_validation(options: Validate, run: Run) -> Validate:
    """Return options with at least as many episodes and candidates as a run's validation."""
    validation, old = run.validation, run.experiment.validate
    if validation is None:
        return options
    if options.episodes in {0, AUTO}:
        return options.model_copy(
            update={"episodes": old.episodes, "candidates": old.candidates, "seed": old.seed}
        )
    return options.model_copy(
        update={
            "episodes": max(options.episodes, len(validation.best.seeds)),
            "candidates": max(options.candidates, len(validation.candidates)),
        }
    )


def _reuse_shorter_runs(sweep: Sweep, folders: Sequence[str]) -> list[str]:
    """Return the folders of variants; those of shorter runs for variants that can continue them.

    If the limits in a sweep file are raised, the folders of its runs have the names of the smaller limits.

    folders: folders of each variant, without the seed.
    """
    new = [
        not any((sweep.out / f"{folder}-{seed}" / FILE).exists() for seed in sweep.seeds)
        for folder in folders
    ]
    shorter_runs = _find_shorter_runs(sweep, set(folders)) if any(new) else []
    chosen = list(folders)
    for index, variant in enumerate(sweep.variants):
        for earlier in shorter_runs if new[index] else ():
            name, experiment = earlier
            if comparable(experiment) == {**comparable(variant.experiment), "seed": experiment.seed} and all(
                limit is None or (before is not None and limit >= before)
                for limit, before in zip(
                    vars(variant.experiment.budget).values(), vars(experiment.budget).values(), strict=True
                )
            ):
                chosen[index] = name
                shorter_runs.remove(earlier)
                break
    return chosen


def _find_shorter_runs(sweep: Sweep, excluded: Collection[str]) -> list[tuple[str, Experiment]]:
    """Return folders of an earlier version of the sweep file, without the seed, and their experiments.

    excluded: folders of present variants.
    """
    file = sweep.out / SWEEP
    shorter_runs = []
    # Without a valid record, the runs may be of another sweep.
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
                if name not in excluded and (sweep.out / folder / FILE).exists():
                    shorter_runs.append((name, Run.open(sweep.out / folder).experiment))
                    break
    return shorter_runs


def list_tasks(sweep: Sweep) -> list[Task]:
    """Return all runs: every variant with the first seed, then with the next seed.

    So an interrupted sweep has about the same number of runs of each variant.
    """
    alike = {_identify(member.experiment): member.alike for member in sweep.variants if member.alike}
    existing = {name: _find_existing(sweep, name, alike) for name in set(alike.values())}
    folders = _reuse_shorter_runs(sweep, [_choose_folder(variant, existing) for variant in sweep.variants])
    return [
        Task(variant, seed, sweep.out / f"{folder}-{seed}")
        for seed in sweep.seeds
        for variant, folder in zip(sweep.variants, folders, strict=True)
    ]


def _choose_folder(variant: Variant, existing: Mapping[str, str | None]) -> str:
    """Return the name of a variant's folders, without the seed.

    If several variants would have the same name, the variant with existing runs keeps it, since variants may
    have been inserted before it.

    existing: the results of `_find_existing` for these names.
    """
    if not variant.alike:
        return variant.folder
    owner = existing[variant.alike]
    if owner == _identify(variant.experiment):
        return variant.alike
    return variant.folder if owner is None else variant.apart


def _find_existing(sweep: Sweep, name: str, identities: Collection[str]) -> str | None:
    """Return the identity of the variant that has runs in the folders of a name; None if there is none."""
    folders = (sweep.out / f"{name}-{seed}" for seed in sweep.seeds)
    folder = next((path for path in folders if (path / FILE).exists()), None)
    if folder is not None:
        with suppress(InputError):  # a damaged run
            identity = _identify(Run.open(folder).experiment)
            return identity if identity in identities else None
    return None


def _identify(experiment: Experiment) -> str:
    """Return a text that identifies the variant of an experiment."""
    values = {**comparable(experiment), "seed": None, "budget": vars(experiment.budget)}
    return json.dumps(values, sort_keys=True)


def reason(error: Exception) -> str:
    """Describe why a run failed, with the class of an error that is not for users."""
    return str(error) if isinstance(error, SwarmwrightError) else f"{type(error).__name__}: {error}"


def _check_titles(sweep: Sweep) -> None:
    """Raise InputError if simulations have the same title, so that their servers are indistinguishable."""
    titles: dict[str, str] = {}
    for simulation in dict.fromkeys(variant.experiment.simulation for variant in sweep.variants):
        title = catalogue.title(simulation)
        first = titles.setdefault(title, simulation)
        if first != simulation:
            raise InputError(
                f"the simulations {first} and {simulation} have the same title {title!r} on the broker, so "
                "their servers cannot be distinguished; give the classes different titles, or omit the broker"
            )


class Executor:
    """Brokers and servers for sequential runs of a sweep.

    A context manager, which stops them at its end.

    Args:
        sweep: the sweep.
        broker: use the servers on this broker.
        servers: as in `optimize`; overrides the experiments'.

    Raises:
        InputError, RunError: on entry, as `optimize`.
    """

    def __init__(self, sweep: Sweep, *, broker: str | None = None, servers: Servers | None = None) -> None:
        self._sweep = sweep
        self._broker = broker
        self._servers = servers
        self._started: list[LocalServers] = []
        self._addresses: dict[str, str] = {}
        self._local_servers: Servers = "local"
        self._launched: Entries | None = None
        self._stack = ExitStack()

    def __enter__(self) -> Self:
        first = self._sweep.variants[0].experiment
        servers = resolve_servers(first, self._servers)
        if self._broker is None and servers not in BROKERLESS:
            self._broker = first.broker
        if servers in BROKERLESS and self._broker is None:
            self._local_servers = servers
            return self
        if self._broker is not None:
            _check_titles(self._sweep)
        if isinstance(servers, tuple):
            self._launched = servers  # each run starts them, on this broker
            return self
        try:
            self._start(servers)
        except BaseException:
            self._stack.close()
            raise
        return self

    def _start(self, servers: ServerChoice) -> None:
        """Start servers for each simulation of the variants.

        Without a broker, each simulation gets its own: a run finds servers by the title of their simulation,
        which other versions of its code share.
        """
        experiments = {variant.experiment.simulation: variant.experiment for variant in self._sweep.variants}
        for experiment in experiments.values():
            same = (variant.experiment for variant in self._sweep.variants)
            modules = opening.modules_of(
                [similar for similar in same if similar.simulation == experiment.simulation]
            )
            address, local = opening.open_servers(
                self._stack, experiment, self._broker, servers, started=self._servers, modules=modules
            )
            self._addresses[experiment.simulation] = address
            if local is not None:
                self._started.append(local)

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def run(
        self, task: Task, on_generation: OnGeneration | None = None, on_progress: Progress | None = None
    ) -> Run:
        """Do a task, or the remaining part of it; return the run.

        Raises InputError and RunError as `optimize` and `resume`; BusyRunError when another process works on
        it; KeyboardInterrupt before the first generation.
        """
        for local in self._started:
            local.check()
        broker = self._addresses.get(task.experiment.simulation, self._broker)
        options: dict[str, Any] = {"broker": broker, "on_progress": on_progress, "progress": False}
        if self._launched is not None:
            options = {**options, "servers": self._launched}
        elif broker is None:
            options = {"servers": self._local_servers, "on_progress": on_progress, "progress": False}
        try:
            run = task.open_run()
            with leave_reports_to_caller():
                if run is not None:
                    return _resume(task, run, on_generation, options)
                return optimize(task.experiment, on_generation, out=task.folder, **options)
        except InputError as error:
            if is_locked(task.folder):  # another process has begun it meanwhile
                raise BusyRunError(task.folder) from error
            raise


def _resume(task: Task, run: Run, on_generation: OnGeneration | None, options: Mapping[str, Any]) -> Run:
    """Do the remaining part of a run, or only store a larger budget that allows no evaluation."""
    try:
        return resume(task.folder, on_generation, settings=task.settings(run), **options)
    except NothingLeftError:
        adopt_budget(task.folder, task.budget_settings(run))
    settings = task.settings(Run.open(task.folder))
    return resume(task.folder, on_generation, settings=settings, **options)


class Listener:
    """Receives the progress of a sweep; the base class ignores it."""

    def on_already_finished(self, task: Task, run: Run) -> None:
        """Handle a run that was finished before the sweep."""

    def on_finished_elsewhere(self, task: Task, run: Run) -> None:
        """Handle a run that another process has finished since the sweep began."""

    def on_plan(self, runs: int, jobs: int) -> None:
        """Handle the plan: the number of runs to do, and of parallel runs."""

    def on_begin(self, task: Task) -> None:
        """Handle a run that begins or resumes."""

    def generation(self, task: Task, generation: Generation) -> None:
        """Handle an evaluated generation of a run."""

    def evaluating(self, task: Task, done: int, total: int, waiting_for: str) -> None:
        """Handle the progress within a generation; see `swarmwright.optimize`."""

    def on_end(self, task: Task, run: Run) -> None:
        """Handle a finished run."""

    def on_failure(self, task: Task, message: str) -> None:
        """Handle a failed run; the others continue."""

    def busy(self, task: Task) -> None:
        """Handle a run that is left to another process."""

    def tick(self) -> None:
        """Handle the passing of time, called at least every quarter of a second."""


def open_finished(task: Task) -> Run | None:
    """Return a run that another process has finished meanwhile; None if it has not."""
    with suppress(InputError):  # reported later, when the run itself is done
        run = open_if_finished(task)
        return run if isinstance(run, Run) else None
    return None


def open_if_finished(task: Task) -> Run | UnreadableRunError | None:
    """Return a finished run, or the error of an unreadable run; None for a run to do."""
    try:
        run = task.open_run()
        if run is None:
            return None
    except UnreadableRunError as error:
        return error
    try:
        return run if task.is_finished(run) else None
    except InputError as error:  # for example, a plug-in is not installed; the run itself is intact
        return UnreadableRunError(str(error))
