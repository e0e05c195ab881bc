"""A sweep on the command line: its progress, and the report at its end."""

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
from swarmwright.common.formatting import counted, duration
from swarmwright.runs.callbacks import TensorBoard

if TYPE_CHECKING:
    from rich.console import Console, ConsoleOptions, RenderResult
    from rich.table import Table

    from swarmwright.analysis.sweep.remaining import Status, UnderWay


LINE_INTERVAL_S = 30.0
"""Seconds between two plain lines that say how far it is."""
_NAMED = 4
"""Runs that a plain line names."""
_SHOWN = 8
"""Runs that have a progress bar."""


class PlainStatus:
    """A line now and then."""

    def __init__(self, output: Output, status: "Status") -> None:
        self._output = output
        self._status = status
        self._told = time.monotonic()

    def tick(self) -> None:
        """Print a line when it is time."""
        now = time.monotonic()
        if now - self._told >= LINE_INTERVAL_S and self._status.under_way:
            self._told = now
            self._output.text(line(self._status))


def line(status: "Status") -> str:
    """Return how far a sweep is, in a line."""
    running = list(status.under_way.values())
    named = "; ".join(_words(run) for run in running[:_NAMED])
    more = f"; and {len(running) - _NAMED} more" if len(running) > _NAMED else ""
    return f"{_head(status)}; under way: {named}{more}"


def _head(status: "Status") -> str:
    failed = f", {status.failures} failed" if status.failures else ""
    elsewhere = f", {status.elsewhere} left to other processes" if status.elsewhere else ""
    left = status.seconds_left()
    time_left = "" if left is None else f", {duration(left)} left"
    return f"{status.finished} of {status.total} runs done{failed}{elsewhere}{time_left}"


def _words(run: "UnderWay") -> str:
    if run.generation is None:
        return run.words
    failed = run.generation.failed_so_far
    lost = f", {counted(failed, 'evaluation')} failed" if failed else ""
    return f"{run.words}, best {run.generation.best_so_far:.6g}{lost}"


class BarStatus:
    """A bar for the sweep and one for each run under way, redrawn in place by `rich`."""

    def __init__(self, status: "Status") -> None:
        self._status = status

    def tick(self) -> None:
        """Nothing: it is redrawn anyway."""

    def __rich_console__(self, console: "Console", options: "ConsoleOptions") -> "RenderResult":
        """Return lines that fit any width."""
        from rich.text import Text

        from swarmwright.cli._console import text

        status = self._status
        running = list(status.under_way.values())
        whole = status.finished + status.failures + status.elsewhere + sum(run.share for run in running)
        yield _bar(Text(_head(status), style="bold"), whole / max(status.total, 1))
        for run in running[:_SHOWN]:
            yield _bar(text(f"  {_words(run)}"), run.share)
            if run.waiting_for and time.monotonic() - max(run.heard, run.begun) >= PATIENCE_S:
                waiting = text(f"    {run.waiting_for}", "yellow")
                waiting.no_wrap, waiting.overflow = True, "ellipsis"
                yield waiting
        if len(running) > _SHOWN:
            yield Text(f"  and {len(running) - _SHOWN} more")


def _bar(text: Any, share: float) -> "Table":  # noqa: ANN401 - rich's text
    from rich.progress_bar import ProgressBar
    from rich.table import Table

    row = Table.grid(padding=(0, 1), expand=True)
    row.add_column(no_wrap=True, overflow="ellipsis", ratio=3)
    row.add_column(ratio=1)
    row.add_row(
        text,
        ProgressBar(
            total=1.0, completed=share, style="bright_black", complete_style="cyan", finished_style="green"
        ),
    )
    return row


@contextmanager
def shown(output: Output, status: "Status") -> "Iterator[PlainStatus | BarStatus]":
    """Show the status in the fitting way, for the time of a `with` block."""
    if not output.terminal:
        yield PlainStatus(output, status)
        return
    from rich.live import Live

    bars: Any = BarStatus(status)
    with Live(bars, console=output.console(), refresh_per_second=4, transient=True):
        yield bars


class Report(Status):
    """Says how each run ended, and shows how far the others are.

    Runs side by side end in any order; their messages come in the order of the tasks, so that the output is
    reproducible.
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
    def shown(self) -> Iterator[None]:
        """Show how far it is, for the time of a `with` block."""
        try:
            with shown(self._output, self) as status:
                self._tick = status.tick
                yield
        finally:
            for task in list(self._writers):
                self._close(task)

    def found(self, task: Task, run: Run) -> None:
        """Say that a run was finished before."""
        super().found(task, run)
        self._say(task, lambda: self._ended(task, run, "was finished before"))

    def finished_elsewhere(self, task: Task, run: Run) -> None:
        """Say that another process did it."""
        super().finished_elsewhere(task, run)
        self._say(task, lambda: self._ended(task, run, "finished by another process"))

    def begun(self, task: Task) -> None:
        """Tell programs that watch."""
        super().begun(task)
        self._observer.started(task.experiment)
        if self._tensorboard is not None:
            self._writers[task] = TensorBoard(self._tensorboard / task.folder.name, task.experiment)

    def generation(self, task: Task, generation: Generation) -> None:
        """Tell programs that watch, and show it."""
        check()
        super().generation(task, generation)
        self._observer.generation(generation)
        if task in self._writers:
            self._writers[task](generation)
        self._tick()

    def evaluating(self, task: Task, done: int, total: int, waiting_for: str) -> None:
        """Show it."""
        super().evaluating(task, done, total, waiting_for)
        self._tick()

    def ended(self, task: Task, run: Run) -> None:
        """Say what came out."""
        super().ended(task, run)
        self._observer.ended(run)
        if task in self._writers:
            self._writers[task].conclude(run)
            self._close(task)
        self._say(task, lambda: self._ended(task, run, f"{run.seconds:.1f} s"))

    def failed(self, task: Task, message: str) -> None:
        """Say why."""
        super().failed(task, message)
        self._close(task)
        self._observer.log.write("error", "run_failed", seed=task.seed, message=message)
        self._say(task, lambda: self._failed(task, message))

    def busy(self, task: Task) -> None:
        """Say that another process does it."""
        super().busy(task)
        self._close(task)
        self._say(task, lambda: self._busy(task))

    def tick(self) -> None:
        """Show how far it is."""
        self._tick()

    def conclude(self) -> None:
        """Print what was held back for runs that no longer end."""
        for task in self._tasks[self._said :]:
            if task in self._ready:
                self._ready.pop(task)()

    def _close(self, task: Task) -> None:
        """Write what is left for TensorBoard of a run that has ended."""
        writer = self._writers.pop(task, None)
        if writer is not None:
            writer.close()

    def _say(self, task: Task, say: Callable[[], None]) -> None:
        self._ready[task] = say
        while self._said < len(self._tasks) and self._tasks[self._said] in self._ready:
            self._ready.pop(self._tasks[self._said])()
            self._said += 1

    def _where(self, task: Task) -> str:
        return f"[{self._tasks.index(task) + 1}/{self.total}] {task.variant.label}, seed {task.seed}"

    def _ended(self, task: Task, run: Run, how: str) -> None:
        best, unseen = run.history[-1].best_so_far, run.unseen
        held_out = ""
        if unseen is not None:
            lost = f", {unseen.failed_words}" if unseen.failed else ""
            held_out = (
                f" ({with_error(unseen.fitness.mean, unseen.fitness.standard_error)} on held-out seeds{lost})"
            )
        failed = f" of which {run.failed_evaluations:,} failed," if run.failed_evaluations else ""
        self._output.text(
            f"{self._where(task)}: best fitness {best + 0.0:.6g}{held_out}, {run.evaluations:,} evaluations,"
            f"{failed} {how}"
        )
        self._output.json(
            {
                "variant": task.variant.label, "seed": task.seed, "run": str(run.path), "fitness": best,
                "evaluations": run.evaluations, "failed": run.failed_evaluations,
            }
            | ({} if unseen is None else {"unseen": unseen_facts(unseen)})
        )  # fmt: skip

    def _failed(self, task: Task, message: str) -> None:
        self._output.item(f"{self._where(task)}: failed: {message}")
        self._output.json({"variant": task.variant.label, "seed": task.seed, "error": message})

    def _busy(self, task: Task) -> None:
        self._output.text(f"{self._where(task)}: left to another process, which works on it")
        self._output.json({"variant": task.variant.label, "seed": task.seed, "state": "running"})
