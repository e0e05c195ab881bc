"""One simulation server in a process of its own, for a run's own servers and for `swarmwright serve`.

Arguments: a file descriptor for events as JSON lines, then a JSON object with the arguments of
`_engine.serve`, where a Python simulation is named by its class, and further keys:

- `wait`: seconds to wait for a broker that does not answer
- `files`: path -> required SHA-256 of the source, so that all servers of a run compute the same
- `modules`: names of the Python behaviours and conditions to offer
- `visual`: whether a command shows its episodes
- `progress`: descriptor of a file for the current work
- `grace`: seconds to finish a request after SIGTERM
- `marked`: whether output lines name their candidate

Events are those of `_engine.serve`; {"event": "waiting", "server", "message"} while no broker answers;
{"event": "failure", "server", "message", "traceback"} if the code of a Python simulation fails; {"event":
"warning", "server", "message"} for warnings of the library; {"event": "error", "message"} if the server
fails.

Standard input is a pipe from the parent; when it closes, this process ends. On SIGTERM, which schedulers send
to preempted jobs, the process finishes the current request or stepped episode, leaves the broker and ends by
this signal; a second SIGTERM ends it at once.
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
from swarmwright.servers.supervision.output import Sample, mark_output
from swarmwright.servers.supervision.process import STACK_SIGNAL
from swarmwright.simulations import catalogue

DISCONNECT_S = 2.0
"""Seconds for disconnecting from the broker."""
PREEMPTION_GRACE_S = 3.0
"""Default of `grace`: seconds to finish a request or an episode after SIGTERM."""
_POLL_S = 0.01
"""Seconds between checks for the end of the current work."""


def _take_standard_input() -> int:
    """Return a descriptor of the pipe from the parent, and make standard input empty.

    Otherwise a simulation that reads standard input would wait until the parent ends.
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
    """Handler that ends this process cleanly on SIGTERM."""

    def __init__(self, settings: Mapping[str, Any]) -> None:
        self.has_begun = False
        self._server, self._broker = int(settings["id"]), str(settings["broker"])
        self._prefix = str(settings.get("prefix", ""))
        self._progress: int | None = settings.get("progress")
        self._grace = float(settings.get("grace", PREEMPTION_GRACE_S))
        signal.signal(signal.SIGTERM, self._begin)

    def _begin(self, _number: int, _frame: object) -> None:
        self.has_begun = True
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        threading.Thread(target=self._end, daemon=True).start()

    def _end(self) -> None:
        """Wait for the end of the current work, then interrupt the main thread, which disconnects."""
        deadline = time.monotonic() + self._grace
        before = self._sample()
        while self._sample().continues(before) and time.monotonic() <= deadline:
            time.sleep(_POLL_S)
        # Before anything else: the next episode may have begun already, or begin now.
        self._leave()
        if before.is_stepped or self._sample().is_stepped:
            self.finish()
        os.kill(os.getpid(), signal.SIGINT)
        threading.Event().wait(DISCONNECT_S)
        self.finish()

    def leave_stepped_episodes(self) -> None:
        """Leave the broker before an interrupt if episodes are being stepped."""
        if self._sample().is_stepped:
            leaving = threading.Thread(target=self._leave, daemon=True)
            leaving.start()
            leaving.join(DISCONNECT_S)

    def _leave(self) -> None:
        """Remove the server's presence.

        An interrupt in the simulation's code, or a lost server, would count as a failure of the stepped
        episode. Episodes of a server that has left go to other servers.
        """
        with suppress(SwarmwrightError), engine_errors():
            _engine.forget(self._broker, [self._server], prefix=self._prefix)

    def _sample(self) -> Sample:
        return Sample() if self._progress is None else Sample.read(self._progress)

    @staticmethod
    def finish() -> None:
        """End by the signal, so that a waiting parent sees the cause."""
        os.kill(os.getpid(), signal.SIGTERM)


def _load_simulation(
    name: str, files: dict[str, str], on_failure: Callable[[str, str], None], *, visual: bool
) -> Any:  # noqa: ANN401 - as the engine takes it
    """Return the title of a built-in simulation or a host of a user's class, for `_engine.serve`."""
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
    return make_host(kind, on_failure)


def _load_modules(names: list[str], simulation: Any, on_failure: Callable[[str, str], None]) -> Any:  # noqa: ANN401 - as the engine takes it
    """Load the Python behaviours and conditions of this server."""
    from swarmwright.servers.evaluation.served_modules import ServedModules  # noqa: PLC0415 - NumPy, only for such servers
    from swarmwright.simulations import loading  # noqa: PLC0415 - as above

    loading.serving = True
    return ServedModules(names, simulation, on_failure)


def _prepare(settings: dict[str, Any]) -> None:
    """Set up stack traces for crashes and hangs, and the marking of output."""
    faulthandler.enable(2)
    faulthandler.register(STACK_SIGNAL, 2)
    progress = settings.pop("progress", None)
    if progress is not None:
        settings["progress"] = f"/dev/fd/{progress}"
        if settings.pop("marked", False):
            mark_output(progress)


def main() -> int:
    """Serve until the parent ends; return 0 or the exit status of an error."""
    # The parent may have been started with SIGINT ignored, as shells do in the background.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    preemption: _Preemption | None = None
    try:
        # The parent may end at any time, also before this process serves.
        arguments = (_take_standard_input(), lambda: preemption)
        threading.Thread(target=_end_with_parent, args=arguments, daemon=True).start()
        settings = json.loads(sys.argv[2])
        preemption = _Preemption(settings)
        settings.pop("grace", None)
        return _serve(int(sys.argv[1]), settings)
    except KeyboardInterrupt:
        if preemption is not None and preemption.has_begun:
            preemption.finish()
        return 0


class _Warnings(logging.Handler):
    """Logging handler that reports and prints warnings."""

    def __init__(self, server: int, report: Callable[[Mapping[str, Any]], None]) -> None:
        super().__init__(logging.WARNING)
        self._server, self._report = server, report

    def emit(self, record: logging.LogRecord) -> None:
        """Report and print a warning."""
        self._report({"event": "warning", "server": self._server, "message": record.getMessage()})
        sys.stderr.write(f"{record.getMessage()}\n")


def _serve(events: int, settings: dict[str, Any]) -> int:
    """Serve, write events to the file descriptor `events`, and return the exit status."""

    def report(event: Mapping[str, Any]) -> None:
        # A closed pipe means that the parent ends, which `_end_with_parent` handles.
        with suppress(OSError):
            os.write(events, f"{json.dumps(event)}\n".encode())

    logging.getLogger("swarmwright").addHandler(_Warnings(settings["id"], report))
    _prepare(settings)

    def report_failure(reason: str, traceback: str) -> None:
        report({"event": "failure", "server": settings["id"], "message": reason, "traceback": traceback})
        sys.stderr.write(f"{traceback or reason}\n")

    def report_waiting(line: str) -> None:
        report({"event": "waiting", "server": settings["id"], "message": line})

    try:
        with engine_errors():
            name, files = settings.pop("simulation"), settings.pop("files", {})
            simulation = _load_simulation(name, files, report_failure, visual=settings.pop("visual", False))
            names = settings.pop("modules", [])
            if names:
                settings["modules"] = _load_modules(names, simulation, report_failure)
            wait = settings.pop("wait", 0.0)
            connect_with_retries(
                lambda: _engine.serve(simulation, **settings, on_event=report), wait, report_waiting
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
    # Not `sys.exit`: finalizing the interpreter could crash a thread that still runs a simulation's code.
    os._exit(status)
