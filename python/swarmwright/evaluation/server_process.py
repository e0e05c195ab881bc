"""One simulation server in a process of its own, for a run's own servers and for `swarmwright serve`.

Arguments: a file descriptor, to which events go as JSON lines, then the arguments of `_engine.serve` as a
JSON object, where a simulation in Python is named by its class, `wait`, seconds for a broker that does not
answer, `files`, path -> SHA-256, which the source of the class must have: all servers of a run compute the
same, `visual`, whether a command is to show its episodes, `progress`, the descriptor of a file in which it
says what it computes, and `marked`, whether what it prints is to say for which candidate.

Events are what `_engine.serve` reports, {"event": "waiting", "server", "message"} while no broker answers,
{"event": "failure", "server", "message", "traceback"} when the code of a simulation in Python fails, and
{"event": "error", "message"} when the server does. Standard input is a pipe from the parent: when it closes
the parent is done or gone, however it ended, and so is this process.
"""

import faulthandler
import json
import os
import signal
import sys
import threading
from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import Any

from swarmwright import _engine
from swarmwright.broker.waiting import patiently
from swarmwright.core.errors import SwarmwrightError, engine_errors
from swarmwright.simulations import catalogue
from swarmwright.supervision.marked_output import mark_output
from swarmwright.supervision.process import STACK_SIGNAL

GRACE = 2.0
"""Seconds for disconnecting from the broker."""


def _end_with_parent() -> None:
    try:
        while os.read(0, 1):
            pass
    finally:
        os.kill(os.getpid(), signal.SIGINT)
        threading.Event().wait(GRACE)
        os._exit(0)


def _simulation(name: str, files: dict[str, str], failed: Callable[[str, str], None], *, visual: bool) -> Any:  # noqa: ANN401 - as the engine takes it
    """Return what `_engine.serve` takes: the title of a built-in simulation, or a host of a user's class."""
    if name in catalogue.titles():
        return name
    from swarmwright.simulations import loading  # noqa: PLC0415 - only for simulations in Python
    from swarmwright.simulations.hosts import hosted  # noqa: PLC0415 - only for simulations in Python
    from swarmwright.user_code.changes import check_unchanged  # noqa: PLC0415 - only for simulations in Python

    loading.serving = True
    kind = loading.load(name)
    check_unchanged(files)
    if visual and hasattr(kind, "runVisual"):  # of a command
        kind.visual = True  # type: ignore[union-attr] # a CommandSimulation, which is above this
    return hosted(kind, failed)


def _prepare(settings: dict[str, Any]) -> None:
    """Have crashes and hangs leave a stack, and what is printed marks."""
    faulthandler.enable(2)
    faulthandler.register(STACK_SIGNAL, 2)
    progress = settings.pop("progress", None)
    if progress is not None:
        settings["progress"] = f"/dev/fd/{progress}"
        if settings.pop("marked", False):
            mark_output(progress)


def main() -> int:
    """Serve until the parent ends; return 0, or the exit status of what went wrong."""
    # The parent may have been started with SIGINT ignored, as shells do in the background.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        # It may end at any time, also before this process serves.
        threading.Thread(target=_end_with_parent, daemon=True).start()
        return _serve(int(sys.argv[1]), json.loads(sys.argv[2]))
    except KeyboardInterrupt:
        return 0


def _serve(events: int, settings: dict[str, Any]) -> int:
    """Serve; events go to the file descriptor `events`; return the exit status of what went wrong."""

    def report(event: Mapping[str, Any]) -> None:
        # The pipe is closed: the parent is ending, or gone, which `_end_with_parent` notices.
        with suppress(OSError):
            os.write(events, f"{json.dumps(event)}\n".encode())

    _prepare(settings)

    def failed(reason: str, traceback: str) -> None:
        report({"event": "failure", "server": settings["id"], "message": reason, "traceback": traceback})
        sys.stderr.write(f"{traceback or reason}\n")

    def waiting(line: str) -> None:
        report({"event": "waiting", "server": settings["id"], "message": line})

    try:
        with engine_errors():
            name, files = settings.pop("simulation"), settings.pop("files", {})
            simulation = _simulation(name, files, failed, visual=settings.pop("visual", False))
            wait = settings.pop("wait", 0.0)
            patiently(lambda: _engine.serve(simulation, **settings, on_event=report), wait, waiting)
    except SwarmwrightError as error:
        report({"event": "error", "message": str(error)})
        sys.stderr.write(f"{error}\n")
        return error.exit_status
    return 0


if __name__ == "__main__":
    status = main()
    sys.stdout.flush()
    sys.stderr.flush()
    # Not `sys.exit`: another thread may be within the code of a simulation, which an interpreter that is
    # being taken down would end in the middle, and the process with it.
    os._exit(status)
