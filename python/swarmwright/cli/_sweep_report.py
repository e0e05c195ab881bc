"""Progress and report of a sweep on the command line."""

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from swarmwright import Generation, Run
from swarmwright.analysis.sweep import Task
from swarmwright.analysis.sweep.remaining import Status
from swarmwright.cli._observing import ToolObserver
from swarmwright.cli._output import Output
from swarmwright.cli._progress import PATIENCE_S
from swarmwright.cli._signals import check
from swarmwright.cli._validation import unseen_facts, with_error
from swarmwright.common.formatting import format_count, format_duration
from swarmwright.runs.callbacks import TensorBoard

if TYPE_CHECKING:
    from rich.console import Console, ConsoleOptions, RenderResult
    from rich.table import Table

    from swarmwright.analysis.sweep.remaining import ActiveRun, Status


LINE_INTERVAL_S = 30.0
"""Seconds between two plain lines on progress."""
_NAMED = 4
"""Largest number of runs in a plain line."""
_SHOWN = 8
"""Largest number of progress bars of runs."""


class PlainStatus:
    """A line every LINE_INTERVAL_S."""

    def __init__(self, output: Output, status: "Status") -> None:
        self._output = output
        self._status = status
        self._last_line = time.monotonic()

    def tick(self) -> None:
        """Print a line if it is due."""
        now = time.monotonic()
        if now - self._last_line >= LINE_INTERVAL_S and self._status.active_runs:
            self._last_line = now
            self._output.text(format_status(self._status))


def format_status(status: "Status") -> str:
    """Return a line on the progress of a sweep."""
    running = list(status.active_runs.values())
    named = "; ".join(_format_run(run) for run in running[:_NAMED])
    more = f"; and {len(running) - _NAMED} more" if len(running) > _NAMED else ""
    return f"{_format_totals(status)}; under way: {named}{more}"


def _format_totals(status: "Status") -> str:
    failed = f", {status.failures} failed" if status.failures else ""
    elsewhere = f", {status.elsewhere} left to other processes" if status.elsewhere else ""
    left = status.seconds_left()
    time_left = "" if left is None else f", {format_duration(left)} left"
    return f"{status.finished} of {status.total} runs done{failed}{elsewhere}{time_left}"


def _format_run(run: "ActiveRun") -> str:
    if run.generation is None:
        return run.words
    failed = run.generation.failed_so_far
    lost = f", {format_count(failed, 'evaluation')} failed" if failed else ""
    return f"{run.words}, best {run.generation.best_so_far:.6g}{lost}"


class BarStatus:
    """Bars for the sweep and for each current run, redrawn in place by `rich`."""

    def __init__(self, status: "Status") -> None:
        self._status = status

    def tick(self) -> None:
        """Do nothing: rich redraws the bars."""

    def __rich_console__(self, console: "Console", options: "ConsoleOptions") -> "RenderResult":
        """Draw lines that fit any width."""
        from rich.text import Text

        from swarmwright.cli._console import text, waiting

        status = self._status
        running = list(status.active_runs.values())
        whole = status.finished + status.failures + status.elsewhere + sum(run.share for run in running)
        yield _bar(Text(_format_totals(status), style="bold"), whole / max(status.total, 1))
        for run in running[:_SHOWN]:
            yield _bar(text(f"  {_format_run(run)}"), run.share)
            if run.waiting_for and time.monotonic() - max(run.report_time, run.start) >= PATIENCE_S:
                yield waiting(f"    {run.waiting_for}")
        if len(running) > _SHOWN:
            yield Text(f"  and {len(running) - _SHOWN} more")


def _bar(text: Any, share: float) -> "Table":  # noqa: ANN401 - rich's text
    from rich.table import Table

    from swarmwright.cli._console import bar

    row = Table.grid(padding=(0, 1), expand=True)
    row.add_column(no_wrap=True, overflow="ellipsis", ratio=3)
    row.add_column(ratio=1)
    row.add_row(text, bar(share))
    return row


@contextmanager
def show_status(output: Output, status: "Status") -> "Iterator[PlainStatus | BarStatus]":
    """Show the status during a `with` block, on a terminal with bars."""
    if not output.terminal:
        yield PlainStatus(output, status)
        return
    from rich.live import Live

    bars: Any = BarStatus(status)
    with Live(bars, console=output.console(), refresh_per_second=4, transient=True):
        yield bars


class Report(Status):
    """Reports the end of each run and the progress of the others.

    Parallel runs end in any order; their messages come in the order of the tasks, for reproducible output.
    """

    def __init__(
        self, output: Output, observer: ToolObserver, tasks: Sequence[Task], tensorboard: Path | None = None
    ) -> None:
        super().__init__(len(tasks))
        self.begin(tasks)
        self._output = output
        self._observer = observer
        self._tasks = list(tasks)
        self._ready: dict[Task, Callable[[], None]] = {}
        self._said = 0
        self._tensorboard = tensorboard
        self._writers: dict[Task, TensorBoard] = {}
        self._tick: Callable[[], None] = PlainStatus(output, self).tick

    @contextmanager
    def show(self) -> Iterator[None]:
        """Show the progress during a `with` block."""
        try:
            with show_status(self._output, self) as status:
                self._tick = status.tick
                yield
        finally:
            for task in list(self._writers):
                self._close(task)

    def on_already_finished(self, task: Task, run: Run) -> None:
        """Report that a run was finished before."""
        super().on_already_finished(task, run)
        self._say(task, lambda: self._print_end(task, run, "was finished before"))

    def on_finished_elsewhere(self, task: Task, run: Run) -> None:
        """Report that another process finished a run."""
        super().on_finished_elsewhere(task, run)
        self._say(task, lambda: self._print_end(task, run, "finished by another process"))

    def on_begin(self, task: Task) -> None:
        """Log the start of a run."""
        super().on_begin(task)
        self._observer.log_start(task.experiment)
        if self._tensorboard is not None:
            self._writers[task] = TensorBoard(self._tensorboard / task.folder.name, task.experiment)

    def generation(self, task: Task, generation: Generation) -> None:
        """Log a generation and show it."""
        check()
        super().generation(task, generation)
        self._observer.log_generation(generation)
        if task in self._writers:
            self._writers[task](generation)
        self._tick()

    def evaluating(self, task: Task, done: int, total: int, waiting_for: str) -> None:
        """Show the progress of a generation."""
        super().evaluating(task, done, total, waiting_for)
        self._tick()

    def on_end(self, task: Task, run: Run) -> None:
        """Log and report the results of a run."""
        super().on_end(task, run)
        self._observer.log_end(run)
        if task in self._writers:
            self._writers[task].conclude(run)
            self._close(task)
        self._say(task, lambda: self._print_end(task, run, f"{run.seconds:.1f} s"))

    def on_failure(self, task: Task, message: str) -> None:
        """Log and report the failure of a run."""
        super().on_failure(task, message)
        self._close(task)
        self._observer.log.write("error", "run_failed", seed=task.seed, message=message)
        self._say(task, lambda: self._print_failure(task, message))

    def busy(self, task: Task) -> None:
        """Report that another process works on a run."""
        super().busy(task)
        self._close(task)
        self._say(task, lambda: self._print_busy(task))

    def tick(self) -> None:
        """Show the progress."""
        self._tick()

    def conclude(self) -> None:
        """Print messages that were held back for earlier runs, which have not ended."""
        for task in self._tasks[self._said :]:
            if task in self._ready:
                self._ready.pop(task)()

    def _close(self, task: Task) -> None:
        """Close the TensorBoard writer of a run that has ended."""
        writer = self._writers.pop(task, None)
        if writer is not None:
            writer.close()

    def _say(self, task: Task, say: Callable[[], None]) -> None:
        self._ready[task] = say
        while self._said < len(self._tasks) and self._tasks[self._said] in self._ready:
            self._ready.pop(self._tasks[self._said])()
            self._said += 1

    def _label_task(self, task: Task) -> str:
        return f"[{self._tasks.index(task) + 1}/{self.total}] {task.variant.label}, seed {task.seed}"

    def _print_end(self, task: Task, run: Run, how: str) -> None:
        best, unseen = run.history[-1].best_so_far, run.unseen
        held_out = ""
        if unseen is not None:
            lost = f", {unseen.failed_words}" if unseen.failed else ""
            held_out = (
                f" ({with_error(unseen.fitness.mean, unseen.fitness.standard_error)} on held-out seeds{lost})"
            )
        failed = f" of which {run.failed_evaluations:,} failed," if run.failed_evaluations else ""
        self._output.text(
            f"{self._label_task(task)}: best fitness {best + 0.0:.6g}{held_out}, {run.evaluations:,} "
            f"evaluations,{failed} {how}"
        )
        self._output.json(
            {
                "variant": task.variant.label, "seed": task.seed, "run": str(run.path), "fitness": best,
                "evaluations": run.evaluations, "failed": run.failed_evaluations,
            }
            | ({} if unseen is None else {"unseen": unseen_facts(unseen)})
        )  # fmt: skip

    def _print_failure(self, task: Task, message: str) -> None:
        self._output.item(f"{self._label_task(task)}: failed: {message}")
        self._output.json({"variant": task.variant.label, "seed": task.seed, "error": message})

    def _print_busy(self, task: Task) -> None:
        self._output.text(f"{self._label_task(task)}: left to another process")
        self._output.json({"variant": task.variant.label, "seed": task.seed, "state": "running"})
