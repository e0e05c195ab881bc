"""Starting an optimization, and going on with one."""

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
from swarmwright.experiment.checks import setting_warnings
from swarmwright.experiment.derived import (
    has_python_modules,
    place_of,
    reports_slow,
    steers_agents,
)
from swarmwright.experiment.experiment import Experiment, checked_again, experiment_of
from swarmwright.runs import picture
from swarmwright.runs.code import Continuation, continuation, copy_of, parts_of
from swarmwright.runs.folders import check_names, default_folder, is_replaceable, is_run, remove_run
from swarmwright.runs.optimization.audit import audit
from swarmwright.runs.optimization.generation import Generation, OnGeneration
from swarmwright.runs.optimization.generational import Generational
from swarmwright.runs.optimization.hash_seeds import warn_of_hash_seed
from swarmwright.runs.optimization.loop import Loop
from swarmwright.runs.optimization.memory import check_memory, stored
from swarmwright.runs.optimization.notebook_progress import shown
from swarmwright.runs.optimization.resuming import Resumption, StrayedError, prolonged
from swarmwright.runs.optimization.steady_state import SteadyState
from swarmwright.runs.optimization.two_simulations import TwoSimulations, open_simulations
from swarmwright.runs.run import Run, written_run
from swarmwright.runs.store import StoreReader, StoreWriter
from swarmwright.runs.store.folder import check_folder
from swarmwright.runs.store.lock import MovedError
from swarmwright.runs.transfer import at_end
from swarmwright.runs.validation import validate
from swarmwright.servers.evaluation.base import BROKERLESS, Backend, Progress, Servers, resolve_servers
from swarmwright.servers.rows import NOTHING_LEFT
from swarmwright.simulations import catalogue
from swarmwright.simulations.user_code.in_process import fingerprints, warn_of_edits
from swarmwright.simulations.user_code.parts import SECTIONS, distributions

__all__ = ["Generation", "optimize", "resume"]

_by_caller: ContextVar[bool] = ContextVar("_by_caller", default=False)


class InterruptedWithResults(KeyboardInterrupt):
    """Ctrl-C a second time, before the end was in order: finished generations are kept in `folder`."""

    def __init__(self, folder: Path) -> None:
        kept = f"{folder}: finished generations are kept"
        super().__init__(f"{kept}, and swarmwright.resume({str(folder)!r}) goes on")
        self.folder = folder


@contextmanager
def reported_by_caller() -> Iterator[None]:
    """Within this block the caller says itself which runs were interrupted, such as the command line."""
    token = _by_caller.set(True)
    try:
        yield
    finally:
        _by_caller.reset(token)


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
    """Evolve a controller; return the run, whose folder holds everything.

    Without a broker (here or in the experiment) an embedded one is started, with servers; with one, the
    servers found there are used. Ctrl-C ends the run early: the results of all finished generations are kept,
    a warning is logged, and the run that is returned has the state "interrupted". A loop over seeds checks
    that: `if run.state == "interrupted": break`. Before the first generation is finished there is nothing to
    keep: KeyboardInterrupt is raised, and no run folder is left.

    With `on_generation` each generation is stored before it is reported, so that `resume` can continue after
    any failure. Without it, storing is quicker and may come later: generations that follow each other faster
    are stored together every 20 ms, and those of the first second of a new run at the end of that second. A
    process that is killed loses what was not stored yet.

    Args:
        experiment: what to do, the path of its file, or a mapping with the keys of one.
        on_generation: called after each generation; False ends the run, True and None do not.
        on_progress: called about ten times a second with (episodes done, episodes of this generation, what is
            waited for).
        broker: URL of a broker, instead of the experiment's.
        servers: instead of the experiment's: a number (1 to 1024), "auto", "local", "in-process", launchers
            with numbers such as "slurm:4", or a mapping as in the file. Servers given together with a broker
            are started on that broker.
        seed: instead of the experiment's.
        out: folder for the results, new or empty, or with nothing but a run that has no finished generation,
            which is replaced; default runs/<name>-<seed>, to which a number is appended if it exists.
        wait: seconds to wait for a broker that does not answer, instead of `timeouts.connect`.
        progress: show how far it is, below the cell of a notebook or else on standard error; default: in a
            notebook.

    Raises:
        InputError: the experiment cannot be run as it is, the folder holds something, or `on_generation`
            returned something else.
        SimulationError: every candidate of a generation failed, the last in the code of the simulation.
        PlugInError: the code of a method, representation or ranking failed.
        RunError: no broker, no fitting server, every candidate of a generation failed for another reason, or
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
        experiment = checked_again(experiment_of(experiment))
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
    for text in setting_warnings(experiment):
        warn_once(text)
    folder: StablePath | None = None
    asked = None if out is None else StablePath(Path(out))
    try:
        with report_failures(), shown(progress, on_generation, on_progress) as (on_generation, on_progress):
            with open_simulations(experiment, broker=broker, servers=servers, wait=wait) as backend:
                resolved = experiment
                if steers_agents(experiment):
                    resolved = dataclasses.replace(
                        experiment, sensors=backend.sensors, actuators=backend.actuators
                    )
                representation = experiment.representation(backend.sensors, backend.actuators)
                check_memory(experiment, representation)
                code = parts_of(experiment)
                warn_of_edits(code)
                size = stored(resolved, representation)
                folder = asked or StablePath(default_folder(experiment))
                if is_replaceable(folder.path):
                    logging.getLogger("swarmwright").warning(
                        "%s: held a run without any finished generation, which is replaced", folder.path
                    )
                    remove_run(folder.path)
                with (
                    StoreWriter.create(
                        folder.absolute, resolved, backend.metrics, code, size, _channels(resolved)
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
    return _finished(folder.path)


def _check_construction(experiment: Experiment, servers: Servers | None) -> None:
    """Raise InputError where an environment that servers make here cannot be made with the parameters.

    Each server would refuse it, after seconds.
    """
    wanted = resolve_servers(experiment, servers)
    here = isinstance(wanted, int) or wanted in ("auto", *BROKERLESS)
    if (
        here
        and (experiment.broker is None or wanted in BROKERLESS)
        and catalogue.is_local(experiment.simulation)
    ):
        problem = catalogue.construction_problem(experiment.simulation, experiment.parameters)
        if problem is not None:
            raise InputError(f"{place_of(experiment, 'parameters')}{problem}")


def _channels(experiment: Experiment) -> dict[str, Any] | None:
    """Return what is known here of sensors and actuators, for exports where the simulation is not."""
    if not steers_agents(experiment) or not catalogue.has_description(experiment.simulation):
        return None
    try:
        return catalogue.channels(experiment.simulation, experiment.parameters)
    except Exception:  # noqa: BLE001 - of the simulation's code, which may run on its servers only
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
    """Go on with a run that was interrupted, killed, or failed, with the same result as an undisturbed one.

    What is stored is not evaluated again. A generation that was under way is evaluated anew. The result is
    bit-identical to that of an undisturbed run, on any servers. A run that is finished is returned as it is.
    Ctrl-C ends it as in `optimize`.

    The source of a simulation or a plug-in that has changed since the run was begun is refused, with the
    difference, unless that is accepted; so is an edited experiment.yaml, but for the keys that say where and
    how it is computed, which are taken from the file.

    Args:
        run: the run, or its folder.
        on_generation: as in `optimize`; called for the new generations only.
        generations: a larger budget than the experiment's, also for a finished run.
        evaluations: the same.
        seconds: the same.
        settings: other values of what says where it is evaluated, and of the method's budget, see
            `Experiment.load`: `timeouts.step=5`, `method.evaluations=10000`.
        on_progress: as in `optimize`.
        broker: as in `optimize`.
        servers: as in `optimize`.
        wait: as in `optimize`.
        progress: as in `optimize`.
        accept_changed_code: go on with changed code, which is noted in the run and copied.
        simulation: a class, or `FILE:Class`, instead of the run's; what is another code needs
            `accept_changed_code`.
        trust: as in `Run.open`.

    Raises:
        InputError: there is no such run, its store is damaged or of another version, another process works on
            it, fewer generations are asked for than there are, another limit than the one that is raised
            ends it, or its code or its experiment.yaml was changed.
        RunError: as in `optimize`; or the method, with the versions installed here or with changed code that
            was accepted, does not come to the same candidates again.

    Examples:
        >>> run = swarmwright.resume("result", generations=5, servers="in-process")
        >>> run.generations
        5

    See also: `optimize`, to start a run.
    """
    folder = run.path if isinstance(run, Run) else path_of("run", run, "a run folder")
    run = Run.open(folder, trust=trust)
    try:
        with shown(progress, on_generation, on_progress) as (on_generation, on_progress):
            _continue(
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
    return _finished(run.path)


def _continue(
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
    """Go on with a run; see `resume`, and `open_simulations` for `where`."""
    with ExitStack() as stack:
        store = stack.enter_context(StoreWriter.resume(run.path.absolute()))
        stack.enter_context(report_failures())  # within the store, which keeps the message
        reader = StoreReader(run.path)
        wanted = Resumption.of(run, reader, settings, budget)
        if wanted.has_all_generations and not wanted.validation_is_due:
            # Without the method, which need not come to the same candidates any more.
            _close(run, store, wanted)
            return
        code = _code(run, wanted.experiment, accept_changed_code, simulation)
        try:
            loop = _replayed(wanted.experiment, store, reader, code)
        except Exception:
            if isinstance(code, InputError):
                # A user who resumes a run with edited code is told so, rather than what follows from it.
                raise code from None
            raise
        wanted.check_goes_on(run, loop.ended)
        if loop.done and not wanted.validation_is_due:
            if not wanted.had_ended:
                # It was killed between its last generation and its end: only the end is missing.
                store.begin(NOTHING_LEFT, loop.libraries)
                store.conclude("done")
                store.note_ended(loop.ended)
            _close(run, store, wanted)
            return
        if isinstance(code, InputError):
            raise code
        experiment, notes = code.experiment, wanted.notes
        for note in notes:
            warn_once(f"{run.path}: goes on with {note}")
        if any(getattr(experiment, name) != getattr(wanted.experiment, name) for name in SECTIONS):
            # Other files of plug-ins.
            _require_same_bounds(run, wanted.experiment, experiment)
            loop = _replayed(experiment, store, reader, code)
        notes = [*notes, *code.notes]
        earlier = reader.server_use()
        backend = stack.enter_context(open_simulations(experiment, earlier=earlier, **where))
        warn_of_edits(code.used)
        store.follow_use(earlier, backend.server_use)
        copy = code.copy
        if copy is None and code.used:
            copy = store.keep_code(code.version, code.used)
        if notes or wanted.experiment != run.experiment:
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
    """Store a larger budget in a run of which it leaves nothing to evaluate.

    Args:
        folder: of the run.
        settings: with its limits, as in `resume`.

    Raises InputError as `resume`.
    """
    with StoreWriter.resume(folder.absolute()) as store:
        run = Run.open(folder)
        store.replace_experiment(prolonged(run, run.experiment, settings, {}), copy_of(run))


def _hash_seed(experiment: Experiment, backend: Backend) -> str | None:
    """Return Python's hash seed where episodes are evaluated by code in Python; None if it is not known."""
    in_python = is_python(experiment.simulation) or has_python_modules(experiment)
    return backend.hash_seed if in_python else None


def _close(run: Run, store: StoreWriter, wanted: Resumption) -> None:
    """Bring the files of a run of which nothing is left to evaluate up to date."""
    if wanted.has_other_validation:
        experiment = dataclasses.replace(run.experiment, validate=wanted.experiment.validate)
        store.replace_experiment(experiment, copy_of(run))
    store.save_best(wanted.experiment.representation())


def _code(
    run: Run, experiment: Experiment, accept_changed_code: bool, simulation: str | type | None
) -> Continuation | InputError:
    """Return the source with which a run goes on, or why it cannot: raised if anything is left to do."""
    check_memory(experiment, experiment.representation())
    try:
        return continuation(run, experiment, accept_changed_code=accept_changed_code, simulation=simulation)
    except InputError as error:
        return error


def _replayed(
    experiment: Experiment, store: StoreWriter, reader: StoreReader, code: Continuation | InputError
) -> Loop:
    """Return the loop where the store ends."""
    loop = _new_loop(experiment, experiment.representation(), store)
    loop.replay(reader, code.edited if isinstance(code, Continuation) else ())
    return loop


def _require_same_bounds(run: Run, before: Experiment, now: Experiment) -> None:
    """Raise InputError where plug-ins in files whose changed code was accepted have other parameters."""
    limits = zip(*(experiment.representation().bounds for experiment in (before, now)), strict=True)
    if not all(np.array_equal(one, other) for one, other in limits):
        raise InputError(
            f"{run.path}: its behaviours and conditions now have other parameters, or other ranges of these, "
            "so that its genomes mean other machines; start a new run"
        )


def _holds_results(folder: Path) -> bool:
    """Whether a generation was finished."""
    with suppress(InputError):
        return is_run(folder) and bool(StoreReader(folder).history())
    return False


def _fail(error: RunError, folder: Path | None) -> NoReturn:
    """Raise the error, with the command that resumes the run if any results are kept."""
    hint = _how_to_go_on(error, folder)
    if hint is None:
        raise error
    raise with_message(error, f"{error}; {hint}") from error.__cause__ or error


def _how_to_go_on(error: RunError, folder: Path | None) -> str | None:
    """Return what is kept of a run that failed, and how it goes on."""
    if folder is None or isinstance(error, MovedError) or not is_run(folder):
        return None
    resume = f"swarmwright resume {shlex.quote(str(folder))}"
    try:
        done = len(StoreReader(folder).history())
    except InputError:  # a reader writes, too: an index of the log, beside it
        return f"what was finished is kept: `{resume}` continues from there"
    if done and isinstance(error, StrayedError):
        return f"the results of {done} generation{'s' if done > 1 else ''} are kept"
    if done:
        kept = f"the results of {done} generation{'s' if done > 1 else ''} are kept, and"
        # Corrected code of a plug-in is not the code that the run began with.
        option = " --accept-changed-code" if isinstance(error, PlugInError) else ""
        return f"{kept} `{resume}{option}` continues from there"
    if isinstance(error.__cause__, sqlite3.Error | OSError):
        return f"no generation was finished: `{resume}` begins again"
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
    begun, before = time.monotonic(), loop.evaluations
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
        seconds = time.monotonic() - begun
        audited = audit(experiment, store.reader(), backend, on_progress, seconds, loop.evaluations - before)
        if audited is not None:
            store.note_audit(audited)
        if experiment.faults.audit != 0 and not (audited and audited["differ"]):
            warn_of_hash_seed(experiment, backend)
        _validate(experiment, store, backend, on_progress)


def _validate(
    experiment: Experiment, store: StoreWriter, backend: Backend, on_progress: Progress | None
) -> None:
    """Evaluate the best on held-out seeds where that is informative; the run is complete without it."""
    if isinstance(backend, TwoSimulations):
        backend = backend.slow if reports_slow(experiment) else backend.fast
    try:
        validate(experiment, store.reader(), backend, on_progress, store.note_validation)
    except RunError as error:
        logging.getLogger("swarmwright").warning(
            "the best was not evaluated on held-out seeds: %s; the run itself is finished, and "
            "`swarmwright resume %s` does it later",
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
    """Evaluate the best in other simulations where the experiment, or else that in the folder, says so."""
    if experiment is None or experiment.validate.transfers:
        at_end.transfer_at_end(folder, broker=broker, servers=servers, on_progress=on_progress)


def _finished(folder: Path) -> Run:
    run = written_run(folder)
    if run.generations:
        picture.draw_later(folder)
    _report_interruption(run)
    return run


def _report_interruption(run: Run) -> None:
    """Log that Ctrl-C has ended a run: without that, a script goes on as if the run was complete."""
    if run.state == "interrupted" and not _by_caller.get():
        logging.getLogger("swarmwright").warning(
            "%s: interrupted after generation %d; finished generations are kept, and "
            "swarmwright.resume(%r) goes on",
            run.path, run.generations - 1, str(run.path),
        )  # fmt: skip


def _new_loop(experiment: Experiment, representation: Representation, store: StoreWriter) -> Loop:
    """Return the loop for an experiment's operation."""
    strategy = SteadyState if experiment.method.operation == "steady_state" else Generational
    return Loop(experiment, representation, store, strategy)
