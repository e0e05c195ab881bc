"""SIGHUP: `swarmwright broker` reads its files again."""

import logging
import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from swarmwright.cli._log import Log
from swarmwright.cli._output import Output

if TYPE_CHECKING:
    from types import FrameType

    from swarmwright import _engine

_LOGGER = logging.getLogger("swarmwright.servers.broker")


@contextmanager
def hangups() -> Iterator[threading.Event]:
    """An event that is set at every SIGHUP within the block.

    Except where the terminal has closed: that ends the broker, because Ctrl-C could no longer stop it.
    """
    arrived = threading.Event()
    had_terminal = _has_terminal()
    before = signal.getsignal(signal.SIGHUP)

    def note(number: int, frame: "FrameType | None") -> None:
        if had_terminal and not _has_terminal() and callable(before):
            before(number, frame)
        else:
            arrived.set()

    if threading.current_thread() is not threading.main_thread():
        yield arrived
        return
    signal.signal(signal.SIGHUP, note)
    try:
        yield arrived
    finally:
        signal.signal(signal.SIGHUP, before)


def _has_terminal() -> bool:
    try:
        os.close(os.open("/dev/tty", os.O_RDWR | os.O_NOCTTY))
    except OSError:
        return False
    return True


def reload(broker: "_engine.Broker", output: Output, lines: Log) -> None:
    """Have the broker read its files again; an unusable one is reported, and changes nothing."""
    from swarmwright import _engine

    try:
        broker.reload()
    except _engine.EngineError as error:
        _LOGGER.warning("nothing has changed: %s", error)
        output.json({"event": "reload_failed", "message": str(error)})
    else:
        output.text("Passwords, access rules and certificate were read again")
        output.json({"event": "reloaded"})
        lines.write("info", "reloaded")
