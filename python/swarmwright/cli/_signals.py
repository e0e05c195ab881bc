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
"""Seconds after which a signal is repeated whose exception could not be caught."""


class Terminated(KeyboardInterrupt):
    """SIGTERM or SIGHUP arrived; handled like Ctrl-C unless the signal is distinguished."""


class _Arrived:
    """Signals that have arrived since the command began."""

    def __init__(self) -> None:
        self.begin()

    def begin(self) -> None:
        self.endings: list[type[KeyboardInterrupt]] = []
        self.lost: type[KeyboardInterrupt] | None = None
        """Raised within a callback of C code, which cannot pass it on; due once more."""
        self.again = False
        """The next signal is the repeated one."""


_state = _Arrived()


def _interrupt(number: int, _frame: FrameType | None) -> None:
    if _state.again:
        _state.again = False
        if _state.lost is None:
            return  # `check` was faster
    _state.lost = None
    ending = KeyboardInterrupt if number == signal.SIGINT else Terminated
    _state.endings.append(ending)
    raise ending


def check() -> None:
    """Raise a signal's exception again that was swallowed, as C code below Python may do."""
    if _state.endings:
        _state.lost = None
        raise _state.endings[-1]


def _lost(ending: type[KeyboardInterrupt]) -> None:
    """Repeat a signal after a moment, outside of the code in which its exception was lost."""
    _state.lost = ending
    number = signal.SIGTERM if issubclass(ending, Terminated) else signal.SIGINT

    def again() -> None:
        if _state.lost is not None:
            _state.again = True
            os.kill(os.getpid(), number)

    timer = threading.Timer(_RETRY_S, again)
    timer.daemon = True
    timer.start()


@contextmanager
def _found_again() -> Iterator[None]:
    """Within this block, an interrupt that C code would print and drop is not lost."""
    usual = sys.unraisablehook

    def hook(unraisable: "sys.UnraisableHookArgs") -> None:
        kind = unraisable.exc_type
        if issubclass(kind, KeyboardInterrupt):
            _lost(kind)
        else:
            usual(unraisable)

    sys.unraisablehook = hook
    try:
        yield
    finally:
        sys.unraisablehook = usual


@contextmanager
def terminate_like_interrupt() -> Iterator[None]:
    """Within this block SIGTERM and a hung-up terminal raise `Terminated`, so that every `finally` runs.

    SIGINT raises KeyboardInterrupt, as usual. Where it is raised in code that C calls back and that cannot
    pass it on, such as listeners of a run's progress, it is raised again a moment later.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    _state.begin()
    # Shells let background processes ignore SIGINT; one that is sent explicitly is meant.
    # SIGHUP stays ignored under nohup.
    signals = [signal.SIGINT, signal.SIGTERM]
    if signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:
        signals.append(signal.SIGHUP)
    before = [signal.signal(number, _interrupt) for number in signals]
    try:
        with _found_again():
            yield
    finally:
        for number, handler in zip(signals, before, strict=True):
            signal.signal(number, handler or signal.SIG_DFL)
