"""One simulation server in a process of its own, for a run's own servers and for `swarmwright serve`.

Arguments: a file descriptor, to which events go as JSON lines, then the arguments of `_engine.serve` as a
JSON object, where a simulation in Python is named by its class, `wait`, seconds for a broker that does not
answer, `files`, path -> SHA-256, which the source of the class must have: all servers of a run compute the
same, `modules`, names of the behaviours and conditions in Python that it has, `visual`, whether a command is
to show its episodes, `progress`, the descriptor of a file in which it says what it computes, `grace`, seconds
for which it may go on with a request when SIGTERM arrives, and `marked`, whether what it prints is to say for
which candidate.

Events are what `_engine.serve` reports, {"event": "waiting", "server", "message"} while no broker answers,
{"event": "failure", "server", "message", "traceback"} when the code of a simulation in Python fails,
{"event": "warning", "server", "message"} for what the library warns of, and {"event": "error", "message"}
when the server fails. Standard input is a pipe from the parent: when it closes
the parent is done or gone, however it ended, and so is this process; for simulations it is empty. On
SIGTERM, which schedulers send to all processes of a job that they preempt, the request under way, or the
episode that is stepped, is finished; then the process leaves the broker and ends by this signal. A second
SIGTERM ends it at once.
"""

import faulthandler
import json
import logging
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import Any

from swarmwright import _engine
from swarmwright.common.errors import SwarmwrightError, engine_errors
from swarmwright.servers.broker.waiting import connect_with_retries
from swarmwright.servers.supervision.marked_output import mark_output
from swarmwright.servers.supervision.process import STACK_SIGNAL
from swarmwright.servers.supervision.progress import Sample
from swarmwright.simulations import catalogue

DISCONNECT_S = 2.0
"""Seconds for disconnecting from the broker."""
PREEMPTION_GRACE_S = 3.0
"""Seconds for finishing a request or an episode on SIGTERM, unless `grace` says otherwise."""
_POLL_S = 0.01
"""Seconds between two checks whether what was computed has ended."""


def _take_standard_input() -> int:
    """Return a descriptor of the pipe from the parent; standard input becomes empty.

    A simulation that reads standard input, or starts a program that does, would wait for the parent's end.
    """
    pipe = os.dup(0)  # not inherited by programs
    empty = os.open(os.devnull, os.O_RDONLY)
    os.dup2(empty, 0)
    os.close(empty)
    return pipe


def _end_with_parent(pipe: int, preemption: Callable[[], "_Preemption | None"]) -> None:
    try:
        while os.read(pipe, 1):
            pass
    finally:
        leaving = preemption()
        if leaving is not None:
            leaving.leave_stepped_episodes()
        os.kill(os.getpid(), signal.SIGINT)
        threading.Event().wait(DISCONNECT_S)
        os._exit(0)


class _Preemption:
    """Ends this process in an orderly way on SIGTERM."""

    def __init__(self, settings: Mapping[str, Any]) -> None:
        self.has_come = False
        self._server, self._broker = int(settings["id"]), str(settings["broker"])
        self._prefix = str(settings.get("prefix", ""))
        self._progress: int | None = settings.get("progress")
        self._grace = float(settings.get("grace", PREEMPTION_GRACE_S))
        signal.signal(signal.SIGTERM, self._begin)

    def _begin(self, _number: int, _frame: object) -> None:
        self.has_come = True
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        threading.Thread(target=self._end, daemon=True).start()

    def _end(self) -> None:
        """Wait for the end of what is computed, then interrupt the main thread, which disconnects."""
        deadline = time.monotonic() + self._grace
        before = self._sample()
        while self._sample().goes_on_with(before) and time.monotonic() <= deadline:
            time.sleep(_POLL_S)
        if before.is_stepped or self._sample().is_stepped:
            self._leave()  # the next episode has begun already
            self.finish()
        os.kill(os.getpid(), signal.SIGINT)
        threading.Event().wait(DISCONNECT_S)
        self.finish()

    def leave_stepped_episodes(self) -> None:
        """Leave the broker where episodes are stepped, before an interrupt; a broker may be gone."""
        if self._sample().is_stepped:
            leaving = threading.Thread(target=self._leave, daemon=True)
            leaving.start()
            leaving.join(DISCONNECT_S)

    def _leave(self) -> None:
        """Remove the server's presence.

        An interrupt is raised in the simulation's code and counts as a failure of the episode that is
        stepped, and a server that is lost counts against it, too. The episodes of one that has left are given
        to others.
        """
        with suppress(SwarmwrightError), engine_errors():
            _engine.forget(self._broker, [self._server], prefix=self._prefix)

    def _sample(self) -> Sample:
        return Sample() if self._progress is None else Sample.read(self._progress)

    @staticmethod
    def finish() -> None:
        """End by the signal: a process that waits for this one sees why it has ended."""
        os.kill(os.getpid(), signal.SIGTERM)


def _simulation(name: str, files: dict[str, str], failed: Callable[[str, str], None], *, visual: bool) -> Any:  # noqa: ANN401 - as the engine takes it
    """Return what `_engine.serve` takes: the title of a built-in simulation, or a host of a user's class."""
    if name in catalogue.titles():
        return name
    from swarmwright.simulations import loading  # noqa: PLC0415 - only for simulations in Python
    from swarmwright.simulations.physics import make_host  # noqa: PLC0415 - only for simulations in Python
    from swarmwright.simulations.user_code.changes import check_unchanged  # noqa: PLC0415 - only for simulations in Python

    loading.serving = True
    kind = loading.load(name)
    check_unchanged(files)
    if visual and hasattr(kind, "runVisual"):  # of a command
        kind.visual = True  # type: ignore[union-attr] # a CommandSimulation, which is above this
    return make_host(kind, failed)


def _modules(names: list[str], simulation: Any, failed: Callable[[str, str], None]) -> Any:  # noqa: ANN401 - as the engine takes it
    """Return the behaviours and conditions in Python that this server has."""
    from swarmwright.servers.evaluation.served_modules import ServedModules  # noqa: PLC0415 - NumPy, only for such servers
    from swarmwright.simulations import loading  # noqa: PLC0415 - as above

    loading.serving = True
    return ServedModules(names, simulation, failed)


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
    preemption: _Preemption | None = None
    try:
        # It may end at any time, also before this process serves.
        arguments = (_take_standard_input(), lambda: preemption)
        threading.Thread(target=_end_with_parent, args=arguments, daemon=True).start()
        settings = json.loads(sys.argv[2])
        preemption = _Preemption(settings)
        settings.pop("grace", None)
        return _serve(int(sys.argv[1]), settings)
    except KeyboardInterrupt:
        if preemption is not None and preemption.has_come:
            preemption.finish()
        return 0


class _Warnings(logging.Handler):
    """Reports what the library warns of, beside printing it."""

    def __init__(self, server: int, report: Callable[[Mapping[str, Any]], None]) -> None:
        super().__init__(logging.WARNING)
        self._server, self._report = server, report

    def emit(self, record: logging.LogRecord) -> None:
        """Report and print a warning."""
        self._report({"event": "warning", "server": self._server, "message": record.getMessage()})
        sys.stderr.write(f"{record.getMessage()}\n")


def _serve(events: int, settings: dict[str, Any]) -> int:
    """Serve; events go to the file descriptor `events`; return the exit status of what went wrong."""

    def report(event: Mapping[str, Any]) -> None:
        # The pipe is closed: the parent is ending, or gone, which `_end_with_parent` notices.
        with suppress(OSError):
            os.write(events, f"{json.dumps(event)}\n".encode())

    logging.getLogger("swarmwright").addHandler(_Warnings(settings["id"], report))
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
            names = settings.pop("modules", [])
            if names:
                settings["modules"] = _modules(names, simulation, failed)
            wait = settings.pop("wait", 0.0)
            connect_with_retries(
                lambda: _engine.serve(simulation, **settings, on_event=report), wait, waiting
            )
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
