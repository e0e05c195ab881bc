"""The process of a simulation server."""

import json
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import Any

from swarmwright.common import processes
from swarmwright.servers.supervision.progress import Progress
from swarmwright.servers.supervision.server_exit import ServerExit, split_output

LAST_LINES = 20
"""Output lines before the stack to show of an ended server."""
_KEPT_LINES = 200
"""Output lines kept of a server."""
_LONGEST_LINE_BYTES = 1 << 16

GRACE_S = 5.0
"""Seconds for servers to disconnect before they are killed."""
_STACK_S = 0.5
"""Seconds for a hanging server to write its stack before it is killed."""

STACK_SIGNAL = signal.SIGUSR1
"""Signal on which a server writes the stacks of its threads."""


class Process:
    """A process that runs `server_process`.

    Args:
        settings: see `server_process`.
        draws: whether it shares this process's standard output.
        on_event: called with its reports, on another thread.
        on_line: called with (identifier, line) of its output, on another thread; returns the line as text.
        on_end: called on another thread when it has probably ended.
        environment: further variables.
    """

    def __init__(
        self,
        settings: Mapping[str, Any],
        *,
        draws: bool,
        on_event: Callable[["Process", dict[str, Any]], None],
        on_line: Callable[[int, bytes], str],
        on_end: Callable[[], None],
        environment: Mapping[str, str],
    ) -> None:
        self.identifier = int(settings["id"])
        self.ready = False
        self.hung: str | None = None
        """Why its supervisor ended it."""
        self.recycled = False
        """Whether the process was asked to end because it has reached its quota."""
        self.started = time.monotonic()
        self.progress = Progress()
        self._lines: deque[str] = deque(maxlen=_KEPT_LINES)
        self._spoke = 0.0
        self.silent = False
        """Whether its output is closed."""
        self._on_event, self._on_line, self._on_end = on_event, on_line, on_end
        events, writing = os.pipe()
        try:
            self.process = subprocess.Popen(
                [
                    sys.executable,
                    "-P",
                    "-m",
                    "swarmwright.servers.evaluation.server_process",
                    str(writing),
                    json.dumps({**settings, "progress": self.progress.file, "marked": not draws}),
                ],
                stdin=subprocess.PIPE,
                stdout=None if draws else subprocess.PIPE,
                stderr=subprocess.PIPE if draws else subprocess.STDOUT,
                pass_fds=[writing, self.progress.file],
                # The width matters for drawing.
                env={
                    **os.environ,
                    **processes.hash_seed_variables(),
                    "COLUMNS": str(shutil.get_terminal_size().columns),
                    **environment,
                },
                process_group=0,  # Ctrl-C reaches only the parent, which then ends its servers in order
            )
        except BaseException:
            os.close(events)
            self.progress.close()
            raise
        finally:
            os.close(writing)
        self.pid = self.process.pid
        self._threads = [
            threading.Thread(target=self._read_output, daemon=True),
            threading.Thread(target=self._read_events, args=(events,), daemon=True),
        ]
        for thread in self._threads:
            thread.start()

    @property
    def lines(self) -> tuple[str, ...]:
        """Its last output lines."""
        return tuple(self._lines)

    def _read_output(self) -> None:
        stream = self.process.stdout or self.process.stderr
        assert stream is not None
        with stream, suppress(OSError, ValueError):
            while line := stream.readline(_LONGEST_LINE_BYTES):
                self._lines.append(self._on_line(self.identifier, line))
                self._spoke = time.monotonic()
        self.silent = True
        self._on_end()

    def _read_events(self, events: int) -> None:
        with os.fdopen(events, encoding="utf-8", errors="replace") as stream:
            for line in stream:
                try:
                    report = json.loads(line)
                except ValueError:
                    continue  # cut off in the middle by the end of the process
                self.ready = self.ready or report.get("event") == "ready"
                self._on_event(self, report)
        self._on_end()

    def end(self) -> ServerExit | None:
        """Return how it ended, None while it runs; kill its remaining children."""
        if self.process.returncode is None:
            try:
                ended = os.waitid(os.P_PID, self.pid, os.WEXITED | os.WNOHANG | os.WNOWAIT)
            except ChildProcessError:
                ended = None
            if ended is None:
                return None
            # Until its status is read, its id is not reused.
            self._kill_group()
            self.process.wait()
        for thread in self._threads:
            thread.join(1.0)
        lines, stack = split_output([line for line in tuple(self._lines) if line])
        return ServerExit(
            self.identifier, self.pid, self.process.returncode, self.hung, lines[-LAST_LINES:], stack
        )

    def end_hung(self, reason: str) -> None:
        """Let a hanging process write its stack, then kill it."""
        self.hung = reason
        began = time.monotonic()
        with suppress(ProcessLookupError):
            self.process.send_signal(STACK_SIGNAL)
        while time.monotonic() - began < _STACK_S:
            time.sleep(0.02)
            if self._spoke > began and time.monotonic() - self._spoke > 0.1:
                break
        self._kill_group()
        with suppress(ProcessLookupError):
            self.process.kill()

    def recycle(self) -> None:
        """Ask it to end after its current work."""
        self.recycled = True
        with suppress(ProcessLookupError):
            self.process.send_signal(signal.SIGTERM)

    def _kill_group(self) -> None:
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(self.pid, signal.SIGKILL)

    def dismiss(self) -> None:
        """Ask it to end."""
        if self.process.stdin is not None and not self.process.stdin.closed:
            with suppress(OSError):
                self.process.stdin.close()

    def close(self) -> None:
        """Wait for its end and release its resources."""
        self.dismiss()
        try:
            self.process.wait(GRACE_S)
        except subprocess.TimeoutExpired:
            self._kill_group()
            self.process.kill()
            self.process.wait()
        for thread in self._threads:
            thread.join(GRACE_S)
        self.progress.close()
