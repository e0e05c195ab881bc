import contextlib
import os
import signal
import time

import pytest

from swarmwright.cli import _main, run
from swarmwright.cli._signals import Terminated, check, terminate_like_interrupt


def test_an_interrupt_that_somebody_wraps_is_no_fault(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def wrapped(*_: object) -> None:
        try:
            raise KeyboardInterrupt
        except KeyboardInterrupt as interrupt:
            raise RuntimeError("Error calling __set_name__") from interrupt

    monkeypatch.setattr("swarmwright.cli._main._invoke", wrapped)
    assert run([]) == 130
    assert capsys.readouterr().err == "swarmwright: interrupted\n"


@pytest.mark.parametrize(
    ("number", "ending"),
    [(signal.SIGINT, KeyboardInterrupt), (signal.SIGTERM, Terminated), (signal.SIGHUP, Terminated)],
)
def test_an_interrupt_that_somebody_swallows_is_not_lost(
    number: signal.Signals, ending: type[BaseException]
) -> None:
    before = signal.getsignal(number)
    with terminate_like_interrupt():
        check()
        with contextlib.suppress(KeyboardInterrupt):
            os.kill(os.getpid(), number)
        with pytest.raises(ending):
            check()
    assert signal.getsignal(number) is before


class _Ending:
    """Sends a signal where Python can pass no exception on: while C code drops an object."""

    def __init__(self, number: signal.Signals) -> None:
        self._number = number

    def __del__(self) -> None:
        os.kill(os.getpid(), self._number)
        time.sleep(0)  # where the signal is handled at the latest


@pytest.mark.parametrize(
    ("number", "ending"), [(signal.SIGINT, KeyboardInterrupt), (signal.SIGTERM, Terminated)]
)
def test_an_interrupt_that_cannot_be_passed_on_comes_again(
    number: signal.Signals, ending: type[BaseException], capfd: pytest.CaptureFixture[str]
) -> None:
    with terminate_like_interrupt():
        _Ending(number)
        with pytest.raises(ending):
            time.sleep(10)
    assert capfd.readouterr().err == ""


def test_an_interrupt_that_was_noticed_does_not_come_again() -> None:
    with terminate_like_interrupt():
        _Ending(signal.SIGINT)
        with pytest.raises(KeyboardInterrupt):
            check()
        time.sleep(0.2)


def test_a_chain_of_errors_that_leads_back_into_itself_ends() -> None:
    first, second = ValueError("a"), ValueError("b")
    first.__context__, second.__context__ = second, first
    assert not _main._is_interrupt(first)
    second.__context__ = KeyboardInterrupt()
    assert _main._is_interrupt(first)
