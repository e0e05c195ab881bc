"""Shared part of `optimize` and `resume`: progress and results."""

import math
import shlex
import shutil
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from swarmwright.cli._observing import ObserverOptions, observe_run
from swarmwright.cli._output import STDOUT, Output, complain
from swarmwright.cli._progress import Progress, progress
from swarmwright.cli._runs import extra_lines, failure_lines
from swarmwright.cli._signals import INTERRUPTED, check
from swarmwright.cli._validation import (
    explain_missing_validation,
    transfer_of,
    unseen_facts,
    validation_facts,
    validation_lines,
)
from swarmwright.common.errors import RunError
from swarmwright.common.formatting import format_duration, format_rate

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


class Work(Protocol):
    """Runs an experiment, calling these functions after each generation and within it."""

    def __call__(self, *, on_generation: "OnGeneration", on_progress: "OnProgress") -> "Run":
        """Return the run."""


def evolve(
    output: Output,
    experiment: "Experiment",
    work: Work,
    *,
    observing: ObserverOptions,
    broker: str | None = None,
    prefix: str | None = None,
) -> int:
    """Do the work, show progress and results, and return the exit status.

    Args:
        output: where to show them.
        experiment: the experiment to run.
        work: runs the experiment.
        observing: where to report progress besides the output.
        broker: the run's broker, if it may differ from the experiment's.
        prefix: topic prefix, if it differs from the experiment's.
    """
    from swarmwright.runs.optimization.optimize import InterruptedWithResults, leave_reports_to_caller

    where = _resume_options(experiment, broker, prefix)
    try:
        with leave_reports_to_caller():
            run, reader = _run(output, experiment, work, observing)
            if reader.lost is not None:
                return _report_lost_output(reader.lost, run, where)
            return _conclude(output, run, broker, where)
    except InterruptedWithResults as interrupt:
        # On standard error, in place of the results.
        complain(
            f"interrupted; the results so far are kept. Continue with:\n{_resume(interrupt.folder, where)}"
        )
        return INTERRUPTED


def _run(
    output: Output,
    experiment: "Experiment",
    work: Work,
    observing: ObserverOptions,
) -> "tuple[Run, Reader]":
    """Do the work and show its progress; return the run, and whether the output was read to the end."""
    from swarmwright.runs.optimization.optimize import InterruptedWithResults

    reader = Reader()
    with ExitStack() as stack:
        observer = stack.enter_context(observe_run(output, observing))
        observer.log_start(experiment)
        watchers = [stack.enter_context(callback) for callback in _watchers(experiment, observing)]
        shown = stack.enter_context(progress(output, experiment.budget))

        def tell(generation: "Generation") -> bool:
            observer.log_generation(generation)
            for watcher in watchers:
                watcher(generation)
            return reader.show(shown, generation)

        try:
            run = work(on_generation=tell, on_progress=partial(reader.evaluating, shown))
        finally:
            reader.finish(shown)
        try:
            observer.log_end(run)
            for watcher in watchers:
                watcher.conclude(run)
            stack.close()
        except KeyboardInterrupt:
            raise InterruptedWithResults(run.path) from None
    return run, reader


def _resume_options(experiment: "Experiment", broker: str | None, prefix: str | None) -> str:
    """Return the options that `resume` needs to continue on the same broker, each after a space."""
    options = []
    if broker is not None and broker != experiment.broker:
        options += ["--broker", broker]
    if prefix is not None:
        options += ["--prefix", prefix]
    return "".join(f" {shlex.quote(word)}" for word in options)


def _resume(folder: Path, where: str) -> str:
    """Return the command that continues a run; `where` comes from `_resume_options`."""
    return f"{program()} resume {shlex.quote(str(folder))}{where}"


def _report_lost_output(error: OSError, run: "Run", where: str) -> int:
    """Report why nothing more was printed and how to continue; return the exit status."""
    closed = isinstance(error, BrokenPipeError)
    why = "was closed by its reader" if closed else f"cannot be written: {error.strerror}"
    if run.interrupted:
        end = (
            f"so the run ended early; the results so far are kept. Continue with:\n{_resume(run.path, where)}"
        )
    else:
        folder = shlex.quote(str(run.path))
        end = f"but the run is complete. See the results with:\n{program()} runs show {folder}"
    with suppress(OSError):
        complain(f"{STDOUT} {why}, {end}")
    return INTERRUPTED if closed else RunError.exit_status


def _watchers(experiment: "Experiment", observing: ObserverOptions) -> "Iterator[Callback]":
    from swarmwright.runs import callbacks

    if observing.tensorboard is not None:
        yield callbacks.TensorBoard(observing.tensorboard, experiment)
    if observing.mlflow is not None:
        yield callbacks.MLflow(observing.mlflow, experiment)


class Reader:
    """The reader of the output; without it (`| head`, a full disk), the run ends and keeps its results."""

    def __init__(self) -> None:
        self.lost: OSError | None = None
        """The error that ended the output, if any."""

    def show(self, progress: Progress, generation: "Generation") -> bool:
        """Show a generation. Raises KeyboardInterrupt if the output is gone: the run is not complete."""
        check()
        self._write(lambda: progress.generation(generation))
        if self.lost is not None:
            raise KeyboardInterrupt
        return True

    def evaluating(self, progress: Progress, done: int, total: int, waiting_for: str) -> None:
        """Show the progress of a generation; if the output is closed, the run ends after it."""
        self._write(lambda: progress.evaluating(done, total, waiting_for))

    def finish(self, progress: Progress) -> None:
        """Show the last generation if the output is still open."""
        self._write(progress.finish)

    def _write(self, show: Callable[[], None]) -> None:
        if self.lost is not None:
            return
        try:
            show()
        except OSError as error:
            if not (isinstance(error, BrokenPipeError) or error.filename == STDOUT):
                raise
            self.lost = error


def _conclude(output: Output, run: "Run", broker: str | None, where: str) -> int:
    """Print the results, or report why they cannot be printed; return the exit status."""
    try:
        _print_results(output, run, broker, where)
    except OSError as error:
        if isinstance(error, BrokenPipeError) or error.filename != STDOUT:
            raise
        return _report_lost_output(error, run, where)
    return INTERRUPTED if run.interrupted else 0


def _print_results(output: Output, run: "Run", broker: str | None, where: str) -> None:
    """Print the results, the location of the files, and the next steps."""
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
        output.text("Interrupted; the results so far are kept. Continue with:")
        output.text(f"  {_resume(run.path, where)}")
    _print_best(output, run)
    for line in _validation_lines(run):
        output.text(line)
    if transfer is not None:
        output.block(str(transfer))
    for line in extra_lines(run):
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
            "Ended because "
            f"{run.experiment.budget.describe_end(run.ended, run.generations, run.evaluations)}."
        )
    speed = format_rate(run.evaluations / max(run.seconds, 1e-3))
    output.text(f"{run.evaluations} evaluations in {format_duration(run.seconds)} ({speed} a second).")
    output.text()
    output.text(f"Everything is in {run.path}:")
    being_drawn = {picture.FILE} if picture.is_enabled() and run.history else set()
    for name, meaning in FILES.items():
        if name in being_drawn or (run.path / name).exists():
            output.text(f"  {name:<16} {meaning}")
    _hint(output, run, broker)


def _print_best(output: Output, run: "Run") -> None:
    """Print the fitness of the best, or the last match of the champions of a competition."""
    from swarmwright.runs.matches import describe_champions

    best, champions = run.best, describe_champions(run)
    if champions is None:
        label = f"generation {best.generation}, candidate {best.candidate}, numbered from 0"
        if math.isnan(best.fitness):
            output.text(f"Best candidate: {label}.")
        else:
            output.text(f"Best fitness {best.fitness + 0.0:.6g} ({label}).")
        return
    output.text(f"The champions of generation {best.generation} met: {champions}.")
    output.text(
        "Fitness depends on the opponents; to see whether a side has become better, run "
        f"{program()} progress {shlex.quote(str(run.path))}."
    )


def _validation_lines(run: "Run") -> Iterator[str]:
    """Yield lines on the reliability of the fitness: held-out seeds, failed evaluations."""
    validation, missing = run.validation, explain_missing_validation(run)
    if validation is not None:
        yield from validation_lines(validation, run)
    if missing is not None:
        yield missing
    for line in failure_lines(run):
        yield f"{line} See why: {program()} runs show {shlex.quote(str(run.path))}"


def _hint(output: Output, run: "Run", broker: str | None) -> None:
    """Print how to watch the best controller, if the simulation can be shown."""
    from swarmwright import SwarmwrightError
    from swarmwright.simulations import catalogue

    simulation = run.experiment.simulation
    folder = shlex.quote(str(run.path))
    is_local = catalogue.is_local(simulation)
    if is_local:
        try:
            catalogue.choose_display(simulation)
        except SwarmwrightError:
            return  # it has nothing to show
    output.text()
    if is_local:
        output.text("Watch the best controller:")
        output.text(f"  {program()} replay {folder}")
        output.text(f"  {program()} replay {folder} --save best.html --open")
        return
    file = shlex.quote(str(run.path / "experiment.yaml"))
    where = shlex.quote(broker or run.experiment.broker or "URL")
    # Whether a server sends scenes, and whether its simulation runs here, is unknown.
    output.text("Watch the best controller, if a server on the broker sends scenes:")
    output.text(f"  {program()} replay {folder} --broker {where}")
    output.text("If a server draws on its own display:")
    output.text(f"  {program()} simulate {file} --controller {folder} --visual --broker {where}")
    output.text("If the simulation runs on this machine, as FILE:Class or LIBRARY:ENVIRONMENT:")
    output.text(f"  {program()} replay {folder} --simulation NAME")


def program() -> str:
    """Return the command by which the user can call this program."""
    if shutil.which("swarmwright"):
        return "swarmwright"
    script = Path(sys.argv[0])
    if script.name != "swarmwright":
        return f"{shlex.quote(sys.executable)} -m swarmwright"
    return shlex.quote(str(script.relative_to(Path.cwd()) if script.is_relative_to(Path.cwd()) else script))
