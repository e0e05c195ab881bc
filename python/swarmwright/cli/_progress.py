"""Progress of an optimization: a bar on a terminal, plain lines when piped, JSON for programs."""

import math
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import fields
from typing import TYPE_CHECKING, Any, Protocol

from swarmwright.cli._output import Output
from swarmwright.common.formatting import format_duration, format_rate
from swarmwright.experiment.budget import Budget

if TYPE_CHECKING:
    from rich.console import Console, ConsoleOptions, RenderResult

    from swarmwright import Generation
    from swarmwright.servers.evaluation.base import Progress as EpisodeProgress

PATIENCE_S = 2.0
"""Seconds without a result after which the blocking server is shown."""
LINE_INTERVAL_S = 5.0
"""Seconds between two plain lines about generations, except for the first and the last."""


class Progress(Protocol):
    """Shows the progress of an optimization."""

    def generation(self, generation: "Generation") -> None:
        """Show an evaluated generation."""

    def evaluating(self, done: int, total: int, waiting_for: str) -> None:
        """Show the progress within a generation; called about ten times a second."""

    def finish(self) -> None:
        """Show the last generation."""


class Stall:
    """Detects that no result has arrived for a while."""

    def __init__(self) -> None:
        self._done: tuple[int, int] | None = None
        self._since = time.monotonic()
        self._said = 0.0

    def seconds(self, done: int, total: int) -> float:
        """Return the seconds since the numbers last changed; 0 if all results have arrived."""
        now = time.monotonic()
        if (done, total) != self._done or done >= total:
            self._done, self._since, self._said = (done, total), now, 0.0
        return now - self._since

    def line_due(self, done: int, total: int) -> float | None:
        """Return the seconds after PATIENCE_S and at every doubling; else None."""
        seconds = self.seconds(done, total)
        if seconds < max(PATIENCE_S, 2 * self._said):
            return None
        self._said = seconds
        return seconds


class JsonProgress:
    """An object per generation."""

    def __init__(self, output: Output) -> None:
        self._output = output

    def generation(self, generation: "Generation") -> None:
        """Print all numbers of the generation."""
        self._output.json({item.name: getattr(generation, item.name) for item in fields(generation)})

    def evaluating(self, done: int, total: int, waiting_for: str) -> None:
        """Do nothing: scripts read whole generations."""

    def finish(self) -> None:
        """Do nothing: every generation has been printed."""


class PlainProgress:
    """A line for the first and the last generation, and every few seconds in between."""

    def __init__(self, output: Output, budget: Budget) -> None:
        self._output = output
        self._budget = budget
        self._stall = Stall()
        self._skipped: Generation | None = None
        """The latest generation, if it was not printed."""
        self._due = -math.inf
        """Earliest time of the next line."""

    def generation(self, generation: "Generation") -> None:
        """Print a line if the last one was printed long enough ago."""
        self._skipped = generation
        if time.monotonic() >= self._due:
            self.finish()

    def finish(self) -> None:
        """Print the latest generation, unless it is printed already."""
        generation, self._skipped = self._skipped, None
        if generation is None:
            return
        self._due = time.monotonic() + LINE_INTERVAL_S
        from swarmwright.runs.optimization.generation import format_progress

        speed = f"{format_rate(generation.evaluations_per_second)}/s"
        if generation.budget != "evaluations":  # otherwise the progress shows their number
            speed = f"{generation.evaluations} evaluations ({speed})"
        self._output.text(
            f"{format_progress(self._budget, generation)}  best {generation.best_so_far:.6g}  "
            f"mean {generation.mean:.6g}  {speed}{_format_failed(generation)}  "
            f"{format_duration(generation.seconds_left)} left"
        )

    def evaluating(self, done: int, total: int, waiting_for: str) -> None:
        """Print a line if no result arrives for long."""
        seconds = self._stall.line_due(done, total)
        if seconds is not None:
            self.finish()
            self._output.text(f"{done} of {total} episodes; {_reason(waiting_for, seconds)}")


class BarProgress:
    """A bar and the numbers of the last generation, redrawn in place by `rich`."""

    def __init__(self, budget: Budget) -> None:
        self._budget = budget
        self._last: Generation | None = None
        self._part = 0.0
        self._waiting = "looking for servers"
        self._stall = Stall()

    def generation(self, generation: "Generation") -> None:
        """Store the numbers for the next redraw."""
        self._last, self._part, self._waiting = generation, 0.0, ""

    def evaluating(self, done: int, total: int, waiting_for: str) -> None:
        """Store the progress and the blocking server for the next redraw."""
        self._part = done / total if total else 0.0
        seconds = self._stall.seconds(done, total)
        self._waiting = _reason(waiting_for, seconds) if seconds >= PATIENCE_S else ""

    def finish(self) -> None:
        """Do nothing: the bar shows the last generation."""

    def _completion(self) -> float:
        """Return the finished share of the run, including the current generation in part."""
        last = self._last
        if last is None:
            whole = self._budget.generations
            return 0.0 if whole is None else self._part / whole
        share = last.share / (last.generation + 1) if last.budget != "seconds" else 0.0
        return min(last.share + self._part * share, 1.0)

    def __rich_console__(self, console: "Console", options: "ConsoleOptions") -> "RenderResult":
        """Draw two lines that fit any width, and a third if a server is blocking."""
        from rich.table import Table
        from rich.text import Text

        from swarmwright.cli._console import bar, waiting
        from swarmwright.runs.optimization.generation import format_progress

        last = self._last
        done = format_progress(self._budget, last, short=options.max_width < 50)
        left = "" if last is None else f"{format_duration(last.seconds_left)} left"
        line = Table.grid(padding=(0, 1), expand=True)
        line.add_column(no_wrap=True)
        line.add_column(ratio=1)
        line.add_column(no_wrap=True)
        line.add_row(
            Text(done),
            bar(self._completion()),
            Text(left),
        )
        yield line
        if last is not None:
            numbers = Text(no_wrap=True, overflow="ellipsis")
            numbers.append("best ").append(f"{last.best_so_far:.6g}", style="bold green")
            numbers.append(f"  mean {last.mean:.6g}")
            if last.budget != "evaluations":  # otherwise the line above has their number
                numbers.append(f"  {last.evaluations} evaluations")
            numbers.append(f"  {format_rate(last.evaluations_per_second)}/s", style="cyan")
            numbers.append(_format_failed(last), style="yellow")
            yield numbers
        if self._waiting:
            yield waiting(self._waiting)


def _format_failed(generation: "Generation") -> str:
    """Return the number of failed evaluations, after a space; empty if none failed."""
    return f"  {generation.failed_so_far:,} failed" if generation.failed_so_far else ""


def _reason(waiting_for: str, seconds: float) -> str:
    return waiting_for or f"no result for {seconds:.0f} s"


@contextmanager
def progress(output: Output, budget: Budget) -> Iterator[Progress]:
    """Show the progress of a run with this budget during a `with` block."""
    if output.as_json:
        yield JsonProgress(output)
    elif not output.terminal:
        yield PlainProgress(output, budget)
    else:
        from rich.live import Live

        shown: Any = BarProgress(budget)
        with Live(shown, console=output.console(), refresh_per_second=8):
            yield shown


@contextmanager
def episodes(output: Output) -> "Iterator[EpisodeProgress | None]":
    """Show the number of finished episodes on a terminal during a `with` block; elsewhere nothing."""
    if output.as_json or not output.terminal:
        yield None
        return
    from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn
    from rich.progress import Progress as Bars

    columns = ("{task.description}", BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Bars(
        *columns, TextColumn("{task.fields[waiting]}"), console=output.console(), transient=True
    ) as bars:
        task = bars.add_task("episodes", total=None, waiting="")

        def on_progress(done: int, total: int, waiting_for: str) -> None:
            bars.update(task, completed=done, total=total, waiting=waiting_for)

        yield on_progress
