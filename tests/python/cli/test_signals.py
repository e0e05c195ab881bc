import contextlib
import os
import signal

import pytest

from swarmwright.cli._signals import Terminated, check, terminate_like_interrupt


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
