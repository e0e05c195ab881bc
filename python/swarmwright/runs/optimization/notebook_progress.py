"""The progress of an optimization in a notebook."""

from collections.abc import Iterator
from contextlib import contextmanager

from swarmwright.common.formatting import format_duration
from swarmwright.common.html import Text, is_notebook
from swarmwright.runs.optimization.generation import Generation, OnGeneration
from swarmwright.servers.evaluation.base import Progress

Callbacks = tuple[OnGeneration | None, Progress | None]


@contextmanager
def show_progress(
    enabled: bool | None, on_generation: OnGeneration | None, on_progress: Progress | None
) -> Iterator[Callbacks]:
    """Yield callbacks that show the progress of an optimization and call the given callbacks.

    wanted: whether to show it; None means only in a notebook.
    """
    if not (is_notebook() if enabled is None else enabled):
        yield on_generation, on_progress
        return
    text = Text()
    last: Generation | None = None

    def generation(now: Generation) -> bool | None:
        nonlocal last
        last = now
        text.show(format_line(now), at_once=now.generation + 1 == now.generations)
        return None if on_generation is None else on_generation(now)

    def progress(done: int, total: int, waiting_for: str) -> None:
        where = "" if last is None else f"{format_line(last)}; "
        waits = f"; {waiting_for}" if waiting_for else ""
        text.show(f"{where}{done:,} of {total:,} episodes{waits}")
        if on_progress is not None:
            on_progress(done, total, waiting_for)

    try:
        yield generation, progress
    finally:
        if last is not None:
            text.show(format_line(last), at_once=True)
        text.close()


def format_line(now: Generation) -> str:
    """Format the progress of an optimization on a line."""
    whole = "" if now.generations is None else f" of {now.generations}"
    return (
        f"{now.generation + 1}{whole} generations  best {now.best_so_far:.6g}  "
        f"mean {now.mean:.6g}  {now.evaluations:,} evaluations  {format_duration(now.seconds_left)} left"
    )
