"""Signals that end a command."""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

INTERRUPTED = 130
"""Exit status of a command that was interrupted, its results kept."""


class Terminated(KeyboardInterrupt):
    """SIGTERM or SIGHUP arrived; handled like Ctrl-C wherever nobody asks which of them it was."""


def _terminate(_signal: int, _frame: FrameType | None) -> None:
    raise Terminated


@contextmanager
def terminate_like_interrupt() -> Iterator[None]:
    """Within this block SIGTERM and a hung-up terminal raise `Terminated`, so that every `finally` runs."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    # Shells let what they start in the background ignore SIGINT; whoever sends it all the same means it.
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    # SIGHUP stays ignored under nohup.
    signals = [s for s in (signal.SIGTERM, signal.SIGHUP) if signal.getsignal(s) is signal.SIG_DFL]
    for number in signals:
        signal.signal(number, _terminate)
    try:
        yield
    finally:
        for number in signals:
            signal.signal(number, signal.SIG_DFL)
