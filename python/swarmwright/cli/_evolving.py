"""What `optimize` and `resume` have in common: showing how it goes, and what came out."""

import shlex
import shutil
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from swarmwright.cli._observing import Observing, observed
from swarmwright.cli._output import STDOUT, Output, complain
from swarmwright.cli._progress import Progress, progress
from swarmwright.cli._runs import failure_lines, saved_lines
from swarmwright.cli._signals import INTERRUPTED, check
from swarmwright.cli._validation import (
    not_validated,
    transfer_of,
    unseen_facts,
    validation_facts,
    validation_lines,
)
from swarmwright.common.errors import RunError
from swarmwright.common.formatting import duration, rate

if TYPE_CHECKING:
    from swarmwright import Experiment, Generation, Run
    from swarmwright.runs.callbacks import Callback
    from swarmwright.runs.optimization.generation import OnGeneration
    from swarmwright.servers.evaluation.base import Progress as OnProgress

FILES = {
    "best.json": "the best controller",
    "fitness.png": "fitness over generations, a plot",
    "run.sqlite": "every evaluation: genome, seeds, fitness, server, errors",
    "experiment.yaml": "the experiment with every default written out",
    "code": "a copy of the source of its simulation and plug-ins",
    "servers.log": "what the simulation servers printed",
}


def watch_options(command: Any) -> Any:  # noqa: ANN401 - click's decorators
    """`--tensorboard DIR` and `--mlflow URI`: who else is told how it goes."""
    tensorboard = click.option(
        "--tensorboard",
        type=click.Path(path_type=Path, file_okay=False),
        metavar="DIR",
        help="Write the statistics of each generation to this TensorBoard folder.",
    )
    mlflow = click.option(
        "--mlflow",
        metavar="URI",
        help="Log to a new run of this MLflow tracking server (http://..) or database (sqlite:///..).",
    )
    return tensorboard(mlflow(command))


def evolve(
    output: Output,
    experiment: "Experiment",
    work: "Callable[[OnGeneration, OnProgress], Run]",
    *,
    tensorboard: Path | None,
    mlflow: str | None,
    observing: Observing,
    broker: str | None = None,
    prefix: str | None = None,
) -> int:
    """Do the work, show how it goes and what came out; the exit status.

    Args:
        output: where it is shown.
        experiment: as it is run.
        work: gets what is called after each generation, and what is called within.
        tensorboard: folder for TensorBoard, if wanted.
        mlflow: MLflow's tracking server, if wanted.
        observing: log and figures for programs, if wanted.
        broker: that of the run, where the experiment need not name it.
        prefix: of topics, where the run's experiment has another one.
    """
    from swarmwright.runs.optimization.optimize import InterruptedWithResults, reported_by_caller

    where = _where(experiment, broker, prefix)
    try:
        with reported_by_caller():
            return _evolve(
                output,
                experiment,
                work,
                tensorboard=tensorboard,
                mlflow=mlflow,
                observing=observing,
                broker=broker,
                where=where,
            )
    except InterruptedWithResults as interrupt:
        # On standard error: what was going to be printed of the results is not.
        complain(f"interrupted; the results so far are kept. Go on with:\n{_resume(interrupt.folder, where)}")
        return INTERRUPTED


def _evolve(
    output: Output,
    experiment: "Experiment",
    work: "Callable[[OnGeneration, OnProgress], Run]",
    *,
    tensorboard: Path | None,
    mlflow: str | None,
    observing: Observing,
    broker: str | None,
    where: str,
) -> int:
    from swarmwright.runs.optimization.optimize import InterruptedWithResults

    reader = Reader()
    with ExitStack() as stack:
        observer = stack.enter_context(observed(output, observing))
        observer.started(experiment)
        watchers = [stack.enter_context(callback) for callback in _watchers(experiment, tensorboard, mlflow)]
        shown = stack.enter_context(progress(output, experiment.budget))

        def tell(generation: "Generation") -> bool:
            observer.generation(generation)
            for watcher in watchers:
                watcher(generation)
            return reader.show(shown, generation)

        try:
            run = work(tell, partial(reader.evaluating, shown))
        finally:
            reader.ended(shown)
        try:
            observer.ended(run)
            for watcher in watchers:
                watcher.conclude(run)
            stack.close()
        except KeyboardInterrupt:
            raise InterruptedWithResults(run.path) from None
    if reader.lost is not None:
        return _without_output(reader.lost, run, where)
    try:
        _conclude(output, run, broker, where)
    except BrokenPipeError:
        raise
    except OSError as error:
        if error.filename != STDOUT:
            raise
        return _without_output(error, run, where)
    return INTERRUPTED if run.interrupted else 0


def _where(experiment: "Experiment", broker: str | None, prefix: str | None) -> str:
    """The options of `resume` without which a run would go on elsewhere, each with a space before it."""
    options = []
    if broker is not None and broker != experiment.broker:
        options += ["--broker", broker]
    if prefix is not None:
        options += ["--prefix", prefix]
    return "".join(f" {shlex.quote(word)}" for word in options)


def _resume(folder: Path, where: str) -> str:
    """The command that continues a run; `where` as `_where` returns it."""
    return f"{program()} resume {shlex.quote(str(folder))}{where}"


def _without_output(error: OSError, run: "Run", where: str) -> int:
    """Say why nothing more was printed, and how to go on; the exit status."""
    closed = isinstance(error, BrokenPipeError)
    why = "was closed by its reader" if closed else f"cannot be written: {error.strerror}"
    if run.interrupted:
        end = f"so the run ended early; the results so far are kept. Go on with:\n{_resume(run.path, where)}"
    else:
        folder = shlex.quote(str(run.path))
        end = f"but the run is complete. See what came out with:\n{program()} runs show {folder}"
    with suppress(OSError):
        complain(f"{STDOUT} {why}, {end}")
    return INTERRUPTED if closed else RunError.exit_status


def _watchers(experiment: "Experiment", tensorboard: Path | None, mlflow: str | None) -> "Iterator[Callback]":
    from swarmwright.runs import callbacks

    if tensorboard is not None:
        yield callbacks.TensorBoard(tensorboard, experiment)
    if mlflow is not None:
        yield callbacks.MLflow(mlflow, experiment)


class Reader:
    """The reader of the output; once gone (`| head`, a full disk), the run ends with its results kept."""

    def __init__(self) -> None:
        self.lost: OSError | None = None
        """Why nothing more can be printed."""

    def show(self, progress: Progress, generation: "Generation") -> bool:
        """Show a generation. Raises KeyboardInterrupt when nothing can be shown: the run is not complete."""
        check()
        self._write(lambda: progress.generation(generation))
        if self.lost is not None:
            raise KeyboardInterrupt
        return True

    def evaluating(self, progress: Progress, done: int, total: int, waiting_for: str) -> None:
        """Show how far a generation is; when the output is closed, the run ends after it."""
        self._write(lambda: progress.evaluating(done, total, waiting_for))

    def ended(self, progress: Progress) -> None:
        """Show the last generation where the output is still open."""
        self._write(progress.ended)

    def _write(self, show: Callable[[], None]) -> None:
        if self.lost is not None:
            return
        try:
            show()
        except OSError as error:
            if not (isinstance(error, BrokenPipeError) or error.filename == STDOUT):
                raise
            self.lost = error


def _conclude(output: Output, run: "Run", broker: str | None, where: str) -> None:
    """Say what came out, where everything is, and what to do next."""
    from swarmwright.runs import picture

    best = run.best
    unseen, validation, transfer = run.unseen, run.validation, transfer_of(run)
    output.json(
        {
            "best": {"fitness": best.fitness, "candidate": best.candidate, "generation": best.generation},
            "evaluations": run.evaluations,
            "generations": run.generations,
            "seconds": run.seconds,
            "run": str(run.path),
        }
        | ({"failed": run.failed_evaluations} if run.failed_evaluations else {})
        | ({"episodes_saved": run.episodes_saved} if run.episodes_saved else {})
        | ({} if unseen is None else {"unseen": unseen_facts(unseen)})
        | ({} if validation is None else {"validation": validation_facts(validation)})
        | ({} if transfer is None else {"transfer": transfer.to_mapping()})
    )
    if run.interrupted:
        output.text("Interrupted; the results so far are kept. Go on with:")
        output.text(f"  {_resume(run.path, where)}")
    whose = f"generation {best.generation}, candidate {best.candidate}, numbered from 0"
    output.text(f"Best fitness {best.fitness + 0.0:.6g} ({whose}).")
    for line in _validated(run):
        output.text(line)
    if transfer is not None:
        output.block(str(transfer))
    for line in saved_lines(run):
        output.text(line)
    values = best.controller.parameters
    if values:
        output.text(f"Its parameters: {', '.join(f'{name} {value}' for name, value in values.items())}.")
    for event in run.events():
        if event.kind == "incidents" and event.session == run.sessions[-1].session:
            output.item(f"Incidents: {event.text}.")
        if event.kind == "servers" and event.session == run.sessions[-1].session:
            output.text(f"Servers: {event.text}.")
    if run.ended is not None and (run.ended != "generations" or run.generations < run.experiment.generations):
        output.text(
            f"Ended since {run.experiment.budget.words(run.ended, run.generations, run.evaluations)}."
        )
    speed = rate(run.evaluations / max(run.seconds, 1e-3))
    output.text(f"{run.evaluations} evaluations in {duration(run.seconds)} ({speed} a second).")
    output.text()
    output.text(f"Everything is in {run.path}:")
    being_drawn = {picture.FILE} if picture.wanted() and run.history else set()
    for name, meaning in FILES.items():
        if name in being_drawn or (run.path / name).exists():
            output.text(f"  {name:<16} {meaning}")
    _hint(output, run, broker)


def _validated(run: "Run") -> Iterator[str]:
    """Yield lines on how far the fitness of a run can be trusted: held-out seeds, failed evaluations."""
    validation, missing = run.validation, not_validated(run)
    if validation is not None:
        yield from validation_lines(validation, run)
    if missing is not None:
        yield missing
    for line in failure_lines(run):
        yield f"{line} See why: {program()} runs show {shlex.quote(str(run.path))}"


def _hint(output: Output, run: "Run", broker: str | None) -> None:
    """Say how the best controller can be watched, where there is something to see."""
    from swarmwright import SwarmwrightError
    from swarmwright.simulations import catalogue

    simulation = run.experiment.simulation
    folder = shlex.quote(str(run.path))
    here = catalogue.is_local(simulation)
    if here:
        try:
            catalogue.choose_display(simulation)
        except SwarmwrightError:
            return  # it has nothing to show
    output.text()
    if here:
        output.text("See the best controller at work:")
        output.text(f"  {program()} replay {folder}")
        output.text(f"  {program()} replay {folder} --save best.html --open")
        return
    file = shlex.quote(str(run.path / "experiment.yaml"))
    where = shlex.quote(broker or run.experiment.broker or "URL")
    # What a server can show, and whether its simulation can be run here, is not known.
    output.text("See the best controller at work, if a server on the broker has scenes:")
    output.text(f"  {program()} replay {folder} --broker {where}")
    output.text("If a server draws on a display of its own:")
    output.text(f"  {program()} simulate {file} --controller {folder} --visual --broker {where}")
    output.text("If the simulation can be run here, by its class FILE:Class or as LIBRARY:ENVIRONMENT:")
    output.text(f"  {program()} replay {folder} --simulation NAME")


def program() -> str:
    """How this program is called from where the person is."""
    if shutil.which("swarmwright"):
        return "swarmwright"
    script = Path(sys.argv[0])
    if script.name != "swarmwright":
        return f"{shlex.quote(sys.executable)} -m swarmwright"
    return shlex.quote(str(script.relative_to(Path.cwd()) if script.is_relative_to(Path.cwd()) else script))
