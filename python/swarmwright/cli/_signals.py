"""Signals that end a command."""

import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

INTERRUPTED = 130
"""Exit status of a command that was interrupted; finished generations, if any, are kept."""
_RETRY_S = 0.02
"""Seconds after which a signal is sent again if its exception was lost."""


class Terminated(KeyboardInterrupt):
    """SIGTERM or SIGHUP arrived; handled like Ctrl-C by default."""


class _SignalState:
    """Signals that have arrived since the command began."""

    def __init__(self) -> None:
        self.begin()

    def begin(self) -> None:
        self.endings: list[type[KeyboardInterrupt]] = []
        self.lost: type[KeyboardInterrupt] | None = None
        """An exception raised within a callback of C code and lost there, to be raised again."""
        self.is_repeated = False
        """Whether the next signal is a repetition."""


_state = _SignalState()


def _interrupt(number: int, _frame: FrameType | None) -> None:
    if _state.is_repeated:
        _state.is_repeated = False
        if _state.lost is None:
            return  # `check` was faster
    _state.lost = None
    ending = KeyboardInterrupt if number == signal.SIGINT else Terminated
    _state.endings.append(ending)
    raise ending


def check() -> None:
    """Raise the exception of an earlier signal again, in case C code has swallowed it."""
    if _state.endings:
        _state.lost = None
        raise _state.endings[-1]


def _resend_later(ending: type[KeyboardInterrupt]) -> None:
    """Send a signal again after a moment, outside of the code in which its exception was lost."""
    _state.lost = ending
    number = signal.SIGTERM if issubclass(ending, Terminated) else signal.SIGINT

    def resend() -> None:
        if _state.lost is not None:
            _state.is_repeated = True
            os.kill(os.getpid(), number)

    timer = threading.Timer(_RETRY_S, resend)
    timer.daemon = True
    timer.start()


@contextmanager
def _recover_lost_interrupts() -> Iterator[None]:
    """Resend interrupts that C code would print and drop."""
    usual = sys.unraisablehook

    def hook(unraisable: "sys.UnraisableHookArgs") -> None:
        kind = unraisable.exc_type
        if issubclass(kind, KeyboardInterrupt):
            _resend_later(kind)
        else:
            usual(unraisable)

    sys.unraisablehook = hook
    try:
        yield
    finally:
        sys.unraisablehook = usual


@contextmanager
def terminate_like_interrupt() -> Iterator[None]:
    """Raise `Terminated` on SIGTERM and a closed terminal within this block, so that every `finally` runs.

    SIGINT raises KeyboardInterrupt, as usual. If a callback of C code loses the exception, such as a listener
    to a run's progress, it is raised again a moment later.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    _state.begin()
    # Shells let background processes ignore SIGINT, but an explicit one should work.
    # SIGHUP stays ignored under nohup.
    signals = [signal.SIGINT, signal.SIGTERM]
    if signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:
        signals.append(signal.SIGHUP)
    before = [signal.signal(number, _interrupt) for number in signals]
    try:
        with _recover_lost_interrupts():
            yield
    finally:
        for number, handler in zip(signals, before, strict=True):
            signal.signal(number, handler or signal.SIG_DFL)
