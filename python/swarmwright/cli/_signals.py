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


_arrived: list[type[KeyboardInterrupt]] = []


def _interrupt(number: int, _frame: FrameType | None) -> None:
    ending = KeyboardInterrupt if number == signal.SIGINT else Terminated
    _arrived.append(ending)
    raise ending


def check() -> None:
    """Raise again what a signal raised that somebody swallowed, as C code below Python at times does."""
    if _arrived:
        raise _arrived[-1]


@contextmanager
def terminate_like_interrupt() -> Iterator[None]:
    """Within this block SIGTERM and a hung-up terminal raise `Terminated`, so that every `finally` runs.

    SIGINT raises KeyboardInterrupt, as ever.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    _arrived.clear()
    # Shells let what they start in the background ignore SIGINT; whoever sends it all the same means it.
    # SIGHUP stays ignored under nohup.
    signals = [signal.SIGINT, signal.SIGTERM]
    if signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:
        signals.append(signal.SIGHUP)
    before = [signal.signal(number, _interrupt) for number in signals]
    try:
        yield
    finally:
        for number, handler in zip(signals, before, strict=True):
            signal.signal(number, handler or signal.SIG_DFL)
