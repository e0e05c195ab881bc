"""Start and resume an optimization."""

import dataclasses
import logging
import shlex
import sqlite3
import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from contextvars import ContextVar
from os import PathLike
from pathlib import Path
from typing import Any, NoReturn, SupportsIndex

import numpy as np

from swarmwright.common.arguments import check_arguments, path_of
from swarmwright.common.errors import InputError, PlugInError, RunError, with_message
from swarmwright.common.plug_in_code import report_failures
from swarmwright.common.processes import StablePath, use_threads
from swarmwright.common.simulation_names import is_python
from swarmwright.common.warn_once import warn_once
from swarmwright.controllers import Representation
from swarmwright.experiment.checks import find_setting_warnings
from swarmwright.experiment.derived import (
    has_python_modules,
    place_of,
    reports_slow,
    steers_agents,
)
from swarmwright.experiment.experiment import Experiment, as_experiment, check_again
from swarmwright.methods.rankings.tournament import TournamentOptions
from swarmwright.runs import picture
from swarmwright.runs.code import Continuation, collect_code, find_copy, plan_continuation
from swarmwright.runs.folders import check_names, default_folder, is_replaceable, is_run, remove_run
from swarmwright.runs.matches import column_names
from swarmwright.runs.optimization.audit import audit
from swarmwright.runs.optimization.competing import Competing
from swarmwright.runs.optimization.generation import Generation, OnGeneration
from swarmwright.runs.optimization.generational import Generational
from swarmwright.runs.optimization.hash_seeds import warn_of_hash_seed
from swarmwright.runs.optimization.loop import Loop, Strategy
from swarmwright.runs.optimization.memory import check_memory, estimate_stored_bytes
from swarmwright.runs.optimization.notebook_progress import show_progress
from swarmwright.runs.optimization.resuming import DivergedError, Resumption, extend_experiment
from swarmwright.runs.optimization.steady_state import SteadyState
from swarmwright.runs.optimization.two_simulations import TwoSimulations, open_simulations
from swarmwright.runs.run import Run, open_written_run
from swarmwright.runs.store import StoreReader, StoreWriter
from swarmwright.runs.store.folder import check_folder
from swarmwright.runs.store.lock import MovedError
from swarmwright.runs.transfer import at_end
from swarmwright.runs.validation import validate
from swarmwright.servers.evaluation.base import BROKERLESS, Backend, Progress, Servers, resolve_servers
from swarmwright.servers.rows import NOTHING_LEFT
from swarmwright.simulations import catalogue
from swarmwright.simulations.user_code.changes import fingerprints, warn_of_edits
from swarmwright.simulations.user_code.parts import SECTIONS, distributions

__all__ = ["Generation", "optimize", "resume"]

_caller_reports: ContextVar[bool] = ContextVar("_caller_reports", default=False)


class InterruptedWithResults(KeyboardInterrupt):
    """A second Ctrl-C before the run had ended cleanly; finished generations are kept in `folder`."""

    def __init__(self, folder: Path) -> None:
        resume = f"swarmwright.resume({str(folder)!r})"
        super().__init__(f"{folder}: finished generations are kept; continue with {resume}")
        self.folder = folder


@contextmanager
def leave_reports_to_caller() -> Iterator[None]:
    """Leave the report of interrupted runs to the caller, such as the command line, within this block."""
    token = _caller_reports.set(True)
    try:
        yield
    finally:
        _caller_reports.reset(token)


@check_arguments
def optimize(
    experiment: Experiment | Mapping[str, Any] | str | PathLike[str],
    on_generation: OnGeneration | None = None,
    *,
    on_progress: Progress | None = None,
    broker: str | None = None,
    servers: Servers | None = None,
    seed: SupportsIndex | None = None,
    out: str | PathLike[str] | None = None,
    wait: float | None = None,
    progress: bool | None = None,
) -> Run:
    """Evolve a controller and return the run, whose folder holds all results.

    If neither the call nor the experiment names a broker, an embedded broker is started, with servers;
    otherwise the servers on that broker are used. Ctrl-C ends the run early: the results of all finished
    generations are kept, a warning is logged, and the returned run has the state "interrupted". Check it in a
    loop over seeds: `if run.state == "interrupted": break`. If no generation is finished yet,
    KeyboardInterrupt is raised and the run folder is removed.

    With `on_generation`, each generation is stored before the callback is called, so that `resume` can
    continue after any failure. Without it, storing is faster but delayed: generations in quick succession are
    stored together every 20 ms, and those of the first second of a new run at the end of that second. A
    process that is killed loses the generations that are not stored yet.

    Args:
        experiment: an experiment, the path of its file, or a mapping with the keys of such a file.
        on_generation: called after each generation; the run ends when it returns False.
        on_progress: called about ten times a second with (episodes done, episodes of this generation, reason
            for waiting).
        broker: URL of a broker; overrides the experiment's.
        servers: overrides the experiment's: a number (1 to 1024), "auto", "local", "in-process", launchers
            with numbers such as "slurm:4", or a mapping as in the file. With a broker, these servers are
            started on that broker.
        seed: overrides the experiment's.
        out: folder for the results: new, empty, or holding only a run without a finished generation, which is
            replaced. Default: runs/<name>-<seed>, with a number appended if it exists.
        wait: seconds to wait for a broker that does not answer; overrides `timeouts.connect`.
        progress: show the progress, below the notebook cell or else on standard error. Default: only in a
            notebook.

    Raises:
        InputError: the experiment is invalid, the folder is not empty, or `on_generation` returned something
            other than True, False or None.
        SimulationError: every candidate of a generation failed, the last in the code of the simulation.
        PlugInError: the code of a method, representation or ranking failed.
        RunError: no broker, no suitable server, every candidate of a generation failed for another reason, or
            the disk is full.

    Examples:
        >>> import swarmwright
        >>> experiment = {"simulation": "minisim", "method": {"population": 10, "generations": 3}}
        >>> run = swarmwright.optimize(experiment, servers="in-process", seed=1, out="runs/first")
        >>> run.state, run.generations
        ('done', 3)

    See also: `resume`, to continue a run; `sweep`, to repeat it with other seeds and settings;
    `evaluate`, for optimizers of your own.
    """
    if isinstance(experiment, str | PathLike):
        experiment = Experiment.load(experiment)
    else:
        experiment = check_again(as_experiment(experiment))
    if seed is not None:
        experiment = experiment.replace(seed=seed)
    if out is not None and not is_replaceable(path_of("out", out, "a folder for the results")):
        check_folder(Path(out))
    check_names(experiment)
    _ = experiment.first_seed  # report errors before anything is started
    at_end.check(experiment, broker)
    at_end.allow(experiment)
    if broker is None:
        _check_construction(experiment, servers)
    for text in find_setting_warnings(experiment):
        warn_once(text)
    folder: StablePath | None = None
    requested = None if out is None else StablePath(Path(out))
    try:
        with (
            report_failures(),
            show_progress(progress, on_generation, on_progress) as (on_generation, on_progress),
        ):
            with open_simulations(experiment, broker=broker, servers=servers, wait=wait) as backend:
                resolved = experiment
                if steers_agents(experiment):
                    resolved = dataclasses.replace(
                        experiment, sensors=backend.sensors, actuators=backend.actuators
                    )
                representation = experiment.representation(backend.sensors, backend.actuators)
                check_memory(experiment, representation)
                code = collect_code(experiment)
                warn_of_edits(code)
                size = estimate_stored_bytes(resolved, representation)
                folder = requested or StablePath(default_folder(experiment))
                if is_replaceable(folder.path):
                    logging.getLogger("swarmwright").warning(
                        "%s: replacing a run without finished generations", folder.path
                    )
                    remove_run(folder.path)
                with (
                    StoreWriter.create(
                        folder.absolute,
                        resolved,
                        _record_metrics(resolved, backend),
                        code,
                        size,
                        _channels(resolved),
                    ) as store,
                    report_failures(),
                ):
                    loop = _new_loop(resolved, representation, store)
                    libraries = (*loop.libraries, *distributions(code))
                    store.follow_use({}, backend.server_use)
                    store.begin(
                        backend.description,
                        libraries,
                        1 if code else None,
                        classes=fingerprints(experiment.simulation),
                        hash_seed=_hash_seed(resolved, backend),
                    )
                    _run(resolved, store, loop, backend, on_generation, on_progress)
            _transfer(experiment, folder.path, on_progress, broker=broker, servers=servers)
    except KeyboardInterrupt:
        if folder is not None and folder.path.exists():
            if _holds_results(folder.path):
                raise InterruptedWithResults(folder.path) from None
            remove_run(folder.path)
        raise
    except RunError as error:
        _fail(error, None if folder is None else folder.path)
    return _load_finished_run(folder.path)


def _check_construction(experiment: Experiment, servers: Servers | None) -> None:
    """Raise InputError if local servers could not construct the environment with its parameters.

    Otherwise each server would fail after some seconds.
    """
    servers = resolve_servers(experiment, servers)
    is_local = isinstance(servers, int) or servers in ("auto", *BROKERLESS)
    if (
        is_local
        and (experiment.broker is None or servers in BROKERLESS)
        and catalogue.is_local(experiment.simulation)
    ):
        problem = catalogue.construction_problem(experiment.simulation, experiment.parameters)
        if problem is not None:
            raise InputError(f"{place_of(experiment, 'parameters')}{problem}")


def _channels(experiment: Experiment) -> dict[str, Any] | None:
    """Return the sensors and actuators, for exports on machines without the simulation; None if unknown."""
    if not steers_agents(experiment) or not catalogue.has_description(experiment.simulation):
        return None
    try:
        return catalogue.channels(experiment.simulation, experiment.parameters)
    except Exception:  # noqa: BLE001 - the simulation's code may run only on its servers
        return None


@check_arguments
def resume(
    run: Run | str | PathLike[str],
    on_generation: OnGeneration | None = None,
    *,
    generations: int | None = None,
    evaluations: int | None = None,
    seconds: float | None = None,
    settings: Iterable[str] = (),
    on_progress: Progress | None = None,
    broker: str | None = None,
    servers: Servers | None = None,
    wait: float | None = None,
    progress: bool | None = None,
    accept_changed_code: bool = False,
    simulation: str | type | None = None,
    trust: bool = False,
) -> Run:
    """Continue a run that was interrupted, killed, or failed, as if it had never stopped.

    Stored generations are not evaluated again; a generation in progress is evaluated from its beginning. The
    result is bit-identical to that of an uninterrupted run, on any servers. A finished run is returned
    unchanged, unless its budget is raised. Ctrl-C ends it as in `optimize`.

    If the source of a simulation or a plug-in has changed since the run began, the run is refused with a
    diff, unless `accept_changed_code` is set. An edited experiment.yaml is refused as well, except for the
    keys that say where and how evaluations are computed, which are taken from the file.

    Args:
        run: the run, or its folder.
        on_generation: as in `optimize`; called only for new generations.
        generations: a larger limit than the experiment's, also for a finished run.
        evaluations: the same for evaluations.
        seconds: the same for seconds.
        settings: new values of keys that say where to evaluate, and of the method's budget, as in
            `Experiment.load`: `timeouts.step=5`, `method.evaluations=10000`.
        on_progress: as in `optimize`.
        broker: as in `optimize`.
        servers: as in `optimize`.
        wait: as in `optimize`.
        progress: as in `optimize`.
        accept_changed_code: continue with changed code, which is noted in the run and copied into it.
        simulation: a class, or `FILE:Class`, in place of the run's; different code requires
            `accept_changed_code`.
        trust: as in `Run.open`.

    Raises:
        InputError: the run does not exist, its store is damaged or of another version, another process works
            on it, a limit is below what the run has used, another limit than the raised one ends it, or its
            code or its experiment.yaml was changed.
        RunError: as in `optimize`; or the method does not reproduce the stored candidates with the installed
            versions or the accepted changes of code.

    Examples:
        >>> run = swarmwright.resume("result", generations=5, servers="in-process")
        >>> run.generations
        5

    See also: `optimize`, to start a run.
    """
    folder = run.path if isinstance(run, Run) else path_of("run", run, "a run folder")
    run = Run.open(folder, trust=trust)
    try:
        with show_progress(progress, on_generation, on_progress) as (on_generation, on_progress):
            _resume(
                run,
                on_generation,
                on_progress,
                settings=settings,
                budget={"generations": generations, "evaluations": evaluations, "seconds": seconds},
                accept_changed_code=accept_changed_code,
                simulation=simulation,
                where={"broker": broker, "servers": servers, "wait": wait},
            )
            _transfer(None, run.path, on_progress, broker=broker, servers=servers)
    except KeyboardInterrupt:
        raise InterruptedWithResults(run.path) from None
    except RunError as error:
        _fail(error, run.path)
    return _load_finished_run(run.path)


def _resume(
    run: Run,
    on_generation: OnGeneration | None,
    on_progress: Progress | None,
    *,
    settings: Iterable[str],
    budget: dict[str, Any],
    accept_changed_code: bool,
    simulation: str | type | None,
    where: dict[str, Any],
) -> None:
    """Continue a run; see `resume`, and `open_simulations` for `where`."""
    with ExitStack() as stack:
        store = stack.enter_context(StoreWriter.resume(run.path.absolute()))
        stack.enter_context(report_failures())  # inside the store, which records the message
        reader = StoreReader(run.path)
        plan = Resumption.of(run, reader, settings, budget)
        if plan.has_all_generations and not plan.validation_is_due:
            # Not replayed: the method need not reproduce the candidates.
            _update_finished_run(run, store, plan)
            return
        code = _load_code(run, plan.experiment, accept_changed_code, simulation)
        try:
            loop = _replay_loop(plan.experiment, store, reader, code)
        except Exception:
            if isinstance(code, InputError):
                # Report the edited code rather than its consequences.
                raise code from None
            raise
        plan.check_goes_on(run, loop.ended)
        if loop.done and not plan.validation_is_due:
            if not plan.had_ended:
                # The process was killed after the last generation: record the missing end.
                store.begin(NOTHING_LEFT, loop.libraries)
                store.conclude("done")
                store.note_ended(loop.ended)
            _update_finished_run(run, store, plan)
            return
        if isinstance(code, InputError):
            raise code
        experiment, notes = code.experiment, plan.notes
        for note in notes:
            warn_once(f"{run.path}: continuing with {note}")
        if any(getattr(experiment, name) != getattr(plan.experiment, name) for name in SECTIONS):
            # The plug-ins come from other files.
            _require_same_bounds(run, plan.experiment, experiment)
            loop = _replay_loop(experiment, store, reader, code)
        notes = [*notes, *code.notes]
        earlier = reader.server_use()
        backend = stack.enter_context(open_simulations(experiment, earlier=earlier, **where))
        warn_of_edits(code.used)
        store.follow_use(earlier, backend.server_use)
        copy = code.copy
        if copy is None and code.used:
            copy = store.keep_code(code.version, code.used)
        if notes or plan.experiment != run.experiment:
            store.replace_experiment(experiment, copy)
        libraries = (*loop.libraries, *distributions(code.used))
        store.begin(
            backend.description,
            libraries,
            None if copy is None else copy.version,
            notes,
            fingerprints(experiment.simulation),
            _hash_seed(experiment, backend),
        )
        _run(experiment, store, loop, backend, on_generation, on_progress)


def adopt_budget(folder: Path, settings: Iterable[str]) -> None:
    """Store a larger budget in a run that has nothing to evaluate with it.

    Args:
        folder: folder of the run.
        settings: the new limits, as in `resume`.

    Raises InputError as `resume`.
    """
    with StoreWriter.resume(folder.absolute()) as store:
        run = Run.open(folder)
        store.replace_experiment(extend_experiment(run, run.experiment, settings, {}), find_copy(run))


def _hash_seed(experiment: Experiment, backend: Backend) -> str | None:
    """Return Python's hash seed if Python code evaluates episodes; None if it is unknown."""
    in_python = is_python(experiment.simulation) or has_python_modules(experiment)
    return backend.hash_seed if in_python else None


def _update_finished_run(run: Run, store: StoreWriter, plan: Resumption) -> None:
    """Update the files of a run that has nothing left to evaluate."""
    if plan.has_other_validation:
        experiment = dataclasses.replace(run.experiment, validate=plan.experiment.validate)
        store.replace_experiment(experiment, find_copy(run))
    store.save_best(plan.experiment.representation())


def _load_code(
    run: Run, experiment: Experiment, accept_changed_code: bool, simulation: str | type | None
) -> Continuation | InputError:
    """Return the code to continue with, or the error to raise if anything is left to evaluate."""
    check_memory(experiment, experiment.representation())
    try:
        return plan_continuation(
            run, experiment, accept_changed_code=accept_changed_code, simulation=simulation
        )
    except InputError as error:
        return error


def _replay_loop(
    experiment: Experiment, store: StoreWriter, reader: StoreReader, code: Continuation | InputError
) -> Loop:
    """Return a loop in the state after the last stored generation."""
    loop = _new_loop(experiment, experiment.representation(), store)
    loop.replay(reader, code.edited if isinstance(code, Continuation) else ())
    return loop


def _require_same_bounds(run: Run, before: Experiment, after: Experiment) -> None:
    """Raise InputError if accepted changes of plug-ins changed their parameters."""
    limits = zip(*(experiment.representation().bounds for experiment in (before, after)), strict=True)
    if not all(np.array_equal(old, new) for old, new in limits):
        raise InputError(
            f"{run.path}: the parameters of its behaviours and conditions, or their ranges, have changed, so "
            "its genomes would encode different state machines; start a new run"
        )


def _holds_results(folder: Path) -> bool:
    """Return whether a generation was finished."""
    with suppress(InputError):
        return is_run(folder) and bool(StoreReader(folder).history())
    return False


def _fail(error: RunError, folder: Path | None) -> NoReturn:
    """Raise the error, with the command that resumes the run if results are kept."""
    hint = _describe_recovery(error, folder)
    if hint is None:
        raise error
    raise with_message(error, f"{error}; {hint}") from error.__cause__ or error


def _describe_recovery(error: RunError, folder: Path | None) -> str | None:
    """Return which results of a failed run are kept and how to continue it."""
    if folder is None or isinstance(error, MovedError) or not is_run(folder):
        return None
    resume = f"swarmwright resume {shlex.quote(str(folder))}"
    try:
        done = len(StoreReader(folder).history())
    except InputError:  # a reader writes, too: an index of the log, beside it
        return f"finished generations are kept; `{resume}` continues from there"
    if done and isinstance(error, DivergedError):
        return f"the results of {done} generation{'s' if done > 1 else ''} are kept"
    if done:
        results = f"the results of {done} generation{'s' if done > 1 else ''} are kept, and"
        # A fixed plug-in differs from the code that the run began with.
        option = " --accept-changed-code" if isinstance(error, PlugInError) else ""
        return f"{results} `{resume}{option}` continues from there"
    if isinstance(error.__cause__, sqlite3.Error | OSError):
        return f"no generation was finished; `{resume}` starts over"
    return None


def _run(
    experiment: Experiment,
    store: StoreWriter,
    loop: Loop,
    backend: Backend,
    on_generation: OnGeneration | None,
    on_progress: Progress | None,
) -> None:
    use_threads()
    representation = experiment.representation(backend.sensors, backend.actuators)
    backend.log_to(store.folder)
    start, evaluations_before = time.monotonic(), loop.evaluations
    try:
        store.conclude("done" if loop.done else loop.run(backend, on_generation, on_progress))
        if store.outcome == "done":
            store.note_ended(loop.ended)
    except BaseException:
        with suppress(Exception):  # the first error explains the later ones
            store.save_best(representation)
        raise
    finally:
        store.incidents(backend.incidents())
        store.usage(backend.usage())
    store.save_best(representation)
    if store.outcome != "interrupted":
        seconds = time.monotonic() - start
        audit_counts = audit(
            experiment, store.reader(), backend, on_progress, seconds, loop.evaluations - evaluations_before
        )
        if audit_counts is not None:
            store.note_audit(audit_counts)
        if experiment.faults.audit != 0 and not (audit_counts and audit_counts["differ"]):
            warn_of_hash_seed(experiment, backend)
        _validate(experiment, store, backend, on_progress)


def _validate(
    experiment: Experiment, store: StoreWriter, backend: Backend, on_progress: Progress | None
) -> None:
    """Validate the best candidates on held-out seeds if that is due; the run is complete without it."""
    if isinstance(backend, TwoSimulations):
        backend = backend.slow if reports_slow(experiment) else backend.fast
    try:
        validate(experiment, store.reader(), backend, on_progress, store.note_validation)
    except RunError as error:
        logging.getLogger("swarmwright").warning(
            "the best candidate was not evaluated on held-out seeds: %s; the run itself is finished, and "
            "`swarmwright resume %s` repeats the validation",
            error, store.folder,
        )  # fmt: skip


def _transfer(
    experiment: Experiment | None,
    folder: Path,
    on_progress: Progress | None,
    *,
    broker: str | None,
    servers: Servers | None,
) -> None:
    """Evaluate the best in other simulations if the experiment, or else the one in the folder, names some."""
    if experiment is None or experiment.validate.transfers:
        at_end.transfer_at_end(folder, broker=broker, servers=servers, on_progress=on_progress)


def _load_finished_run(folder: Path) -> Run:
    run = open_written_run(folder)
    if run.generations:
        picture.draw_later(folder)
    _report_interruption(run)
    return run


def _report_interruption(run: Run) -> None:
    """Log that Ctrl-C ended a run; otherwise a script would take the run for complete."""
    if run.state == "interrupted" and not _caller_reports.get():
        logging.getLogger("swarmwright").warning(
            "%s: interrupted after generation %d; finished generations are kept; continue with "
            "swarmwright.resume(%r)",
            run.path, run.generations - 1, str(run.path),
        )  # fmt: skip


def _new_loop(experiment: Experiment, representation: Representation, store: StoreWriter) -> Loop:
    """Create the loop for an experiment's mode of operation."""
    strategy: type[Strategy] = Generational
    if isinstance(experiment.ranking, TournamentOptions):
        strategy = Competing
    elif experiment.method.operation == "steady_state":
        strategy = SteadyState
    return Loop(experiment, representation, store, strategy)


def _record_metrics(experiment: Experiment, backend: Backend) -> tuple[str, ...]:
    """Return the names of the metrics in the record."""
    ranking = experiment.ranking
    columns = column_names(ranking) if isinstance(ranking, TournamentOptions) else ()
    return (*backend.metrics, *columns)
