import contextlib
import os
import signal

import pytest

from swarmwright.cli import run
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
