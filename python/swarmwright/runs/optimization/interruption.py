"""What is said of a run that Ctrl-C has ended: once, by the function or by the program that calls it."""

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

from swarmwright.runs.run import Run

_by_caller: ContextVar[bool] = ContextVar("_by_caller", default=False)


@contextmanager
def reported_by_caller() -> Iterator[None]:
    """Within this block the caller says itself which runs were interrupted, such as the command line."""
    token = _by_caller.set(True)
    try:
        yield
    finally:
        _by_caller.reset(token)


def report_interruption(run: Run) -> None:
    """Log that Ctrl-C has ended a run: without that, a script goes on as if the run was complete."""
    if run.state == "interrupted" and not _by_caller.get():
        logging.getLogger("swarmwright").warning(
            "%s: interrupted after generation %d; finished generations are kept, and "
            "swarmwright.resume(%r) goes on",
            run.path, run.generations - 1, str(run.path),
        )  # fmt: skip
