"""How a sweep's progress is shown: bars on a terminal, plain lines when piped."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from swarmwright.cli._output import Output
from swarmwright.cli._progress import PATIENCE_S
from swarmwright.common.formatting import counted, duration

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
    named = "; ".join(_words(one) for one in running[:_NAMED])
    more = f"; and {len(running) - _NAMED} more" if len(running) > _NAMED else ""
    return f"{_head(status)}; under way: {named}{more}"


def _head(status: "Status") -> str:
    failed = f", {status.failures} failed" if status.failures else ""
    elsewhere = f", {status.elsewhere} left to other processes" if status.elsewhere else ""
    left = status.seconds_left()
    time_left = "" if left is None else f", {duration(left)} left"
    return f"{status.finished} of {status.total} runs done{failed}{elsewhere}{time_left}"


def _words(one: "UnderWay") -> str:
    if one.generation is None:
        return one.words
    failed = one.generation.failed_so_far
    lost = f", {counted(failed, 'evaluation')} failed" if failed else ""
    return f"{one.words}, best {one.generation.best_so_far:.6g}{lost}"


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
        whole = status.finished + status.failures + status.elsewhere + sum(one.share for one in running)
        yield _bar(Text(_head(status), style="bold"), whole / max(status.total, 1))
        for one in running[:_SHOWN]:
            yield _bar(text(f"  {_words(one)}"), one.share)
            if one.waiting_for and time.monotonic() - max(one.heard, one.begun) >= PATIENCE_S:
                waiting = text(f"    {one.waiting_for}", "yellow")
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
