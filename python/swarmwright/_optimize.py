"""Starting an optimization, and going on with one."""

import dataclasses
import threading
from contextlib import ExitStack, suppress
from pathlib import Path

from swarmwright._backend import Backend, Progress, Servers, open_backend
from swarmwright._errors import InputError, RunError
from swarmwright._experiment import Experiment
from swarmwright._folders import default_folder, is_run, remove_run
from swarmwright._loop import Generation, Loop, OnGeneration, new_loop
from swarmwright._plot import prepare
from swarmwright._run import Run
from swarmwright._store import StoreReader, StoreWriter
from swarmwright._store._writer import check_folder

__all__ = ["Generation", "optimize", "resume"]


class InterruptedAtEnd(KeyboardInterrupt):
    """Ctrl-C while the picture was drawn: of the run nothing else is missing."""

    def __init__(self, run: Run) -> None:
        super().__init__()
        self.run = run


def optimize(
    experiment: Experiment | str | Path,
    on_generation: OnGeneration | None = None,
    *,
    on_progress: Progress | None = None,
    broker: str | None = None,
    servers: Servers | None = None,
    seed: int | None = None,
    out: str | Path | None = None,
    wait: float | None = None,
) -> Run:
    """Evolve a controller; return the run, whose folder holds everything.

    Without a broker (here or in the experiment) an embedded one is started, with servers; with one, the
    servers found there are used. Every generation is stored before the next is asked for, so that `resume`
    can go on after whatever happens. Ctrl-C ends the run early: the results of all finished generations are
    kept, and the run that is returned has `interrupted` set. Before the first generation is finished there is
    nothing to keep: KeyboardInterrupt is raised, and no run folder is left.

    Args:
        experiment: what to do, or the path of its file.
        on_generation: called after each generation; returning False ends the run.
        on_progress: called about ten times a second with (episodes done, episodes of this generation, what is
            waited for).
        broker: URL of a broker, instead of the experiment's.
        servers: instead of the experiment's: a number, "auto" or "local". A number given together with a
            broker is started on that broker.
        seed: instead of the experiment's.
        out: folder for the results, new or empty; default runs/<name>-<seed>, with a number behind it if that
            exists.
        wait: seconds to wait for a broker that does not answer, instead of `timeouts.connect`.

    Raises:
        InputError: the experiment cannot be run as it is, or the folder holds something.
        RunError: no broker, no fitting server, every candidate of a generation failed, or the disk is full.
    """
    if not isinstance(experiment, Experiment):
        experiment = Experiment.load(experiment)
    if seed is not None:
        experiment = experiment.replace(seed=seed)
    if out is not None:
        check_folder(Path(out))
    _ = experiment.first_seed  # complain before anything is started
    with open_backend(experiment, broker=broker, servers=servers, wait=wait) as backend:
        folder = default_folder(experiment) if out is None else Path(out)
        # They are 0 where nobody said them and nobody needs to know.
        resolved = dataclasses.replace(
            experiment, sensors=backend.sensors or None, actuators=backend.actuators or None
        )
        try:
            with StoreWriter.create(folder, resolved, metrics=backend.metrics) as store:
                _run(resolved, store, None, backend, on_generation, on_progress)
        except KeyboardInterrupt:
            if folder.exists() and not (is_run(folder) and StoreReader(folder).history()):
                remove_run(folder)
            raise
    return _finished(folder)


def resume(
    run: Run | str | Path,
    on_generation: OnGeneration | None = None,
    *,
    generations: int | None = None,
    on_progress: Progress | None = None,
    broker: str | None = None,
    servers: Servers | None = None,
    wait: float | None = None,
) -> Run:
    """Go on with a run that was interrupted, killed, or failed, to the very result of an undisturbed one.

    What is stored is not evaluated again. A generation that was under way is evaluated anew. The result is
    that of an undisturbed run to the bit, whoever evaluates now. A run that is finished is returned as it is.

    Args:
        run: the run, or its folder.
        on_generation: as in `optimize`; called for the new generations only.
        generations: a larger budget than the experiment's, also for a finished run.
        on_progress: as in `optimize`.
        broker: as in `optimize`.
        servers: as in `optimize`.
        wait: as in `optimize`.

    Raises:
        InputError: there is no such run, its store is damaged or of another version, another process works on
            it, or fewer generations are asked for than there are.
        RunError: as in `optimize`; or the method, with the versions installed here, does not come to the same
            candidates again.
    """
    folder = run.path if isinstance(run, Run) else Path(run)
    experiment = Run.open(folder).experiment
    with ExitStack() as stack:
        store = stack.enter_context(StoreWriter.resume(folder))
        reader = StoreReader(folder)
        if generations is not None:
            experiment = _with_budget(experiment, generations)
        loop = new_loop(experiment, experiment.representation(), store)
        loop.replay(reader)
        if loop.done:
            if reader.sessions()[-1].outcome not in {"done", "stopped"}:
                # It ended between its last generation and its end: that is all there is to mend.
                store.begin("nothing was left to evaluate", loop.libraries)
                store.conclude("done")
            store.save_best(experiment.representation())
            return _finished(folder)
        backend = stack.enter_context(open_backend(experiment, broker=broker, servers=servers, wait=wait))
        if generations is not None:
            store.replace_experiment(experiment)
        _run(experiment, store, loop, backend, on_generation, on_progress)
    return _finished(folder)


def _run(
    experiment: Experiment,
    store: StoreWriter,
    loop: Loop | None,
    backend: Backend,
    on_generation: OnGeneration | None,
    on_progress: Progress | None,
) -> None:
    representation = experiment.representation(backend.sensors, backend.actuators)
    loop = loop or new_loop(experiment, representation, store)
    store.begin(backend.description, loop.libraries)
    # What draws the plot is loaded while the simulations run.
    threading.Thread(target=prepare, daemon=True).start()
    try:
        store.conclude(loop.run(backend, on_generation, on_progress))
    except BaseException:
        with suppress(RunError):  # what broke the run says more than what follows from it
            store.save_best(representation)
        raise
    finally:
        store.incidents(backend.incidents())
    store.save_best(representation)


def _with_budget(experiment: Experiment, generations: int) -> Experiment:
    if generations < experiment.generations:
        raise InputError(
            f"generations: {generations} is less than the experiment's {experiment.generations}; "
            "a run can be prolonged, not cut"
        )
    return experiment.replace(method={"generations": generations})


def _finished(folder: Path) -> Run:
    run = Run.open(folder)
    try:
        run.plot()
    except KeyboardInterrupt as interrupt:
        raise InterruptedAtEnd(run) from interrupt
    return run
