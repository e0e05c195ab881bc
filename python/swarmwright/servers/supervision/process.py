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
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Self

from swarmwright.common import processes
from swarmwright.servers.supervision.output import Progress, Sample
from swarmwright.servers.supervision.server_exit import ServerExit, split_output

if TYPE_CHECKING:
    from swarmwright.experiment.document import Timeouts

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


FIRST_PAUSE_S = 0.1
"""Seconds before a restart; doubled with each consecutive end without a finished evaluation."""
LONGEST_PAUSE_S = 5.0
LONGEST_PAUSE_AT_WORK_S = 1.0
"""The same for servers that ended during an evaluation, where the pool counts ends per candidate."""

MAX_STARTS = 5
"""Consecutive failed starts until a server is given up; twice as many idle ends."""


START_S = 30.0
"""Minimum of the time limit for a start, seconds."""


@dataclass(frozen=True)
class Limits:
    """Time limits of servers, seconds."""

    start: float = START_S
    """Until it is on the broker, including the imports of a simulation."""
    step: float | None = None
    """For a step of an offloaded evaluation; None for no limit."""
    episode: float | None = None
    """For an evaluation; None for no limit."""

    @classmethod
    def from_timeouts(cls, timeouts: "Timeouts") -> Self:
        """Return the limits of an experiment."""
        return cls(max(START_S, timeouts.discovery), timeouts.step, timeouts.episode)


@dataclass
class SupervisedServer:
    """A server's settings, its current process and its history."""

    settings: Mapping[str, Any]
    """Arguments of the server's process."""
    quota: int
    """Evaluations after which its process is replaced; 0 for never."""
    process: Process | None = None
    restart_at: float | None = None
    """When to restart it (monotonic seconds)."""
    was_ready: bool = False
    """Whether any of its processes has been ready."""
    failed_starts: int = 0
    """Consecutive starts that did not become ready."""
    fruitless: int = 0
    """Consecutive ends of idle processes without a finished evaluation."""
    ends: int = 0
    """Consecutive ends without a finished evaluation."""
    sample: Sample = field(default_factory=Sample)
    """Last progress of its process."""
    since: float = 0.0
    """When that sample first appeared (monotonic seconds)."""
    episode_since: float = 0.0
    """When its current episode first appeared (monotonic seconds)."""
    last: ServerExit | None = None
    """How its last process ended."""
    is_given_up: bool = False
    """Whether the server will not be restarted."""
    has_left: bool = False
    """Whether the server left for good because another server has its id."""

    def is_to_be_replaced(self, process: Process) -> bool:
        """Whether its process has reached its quota and must be replaced."""
        if not self.quota or process.recycled or process.hung is not None:
            return False
        return process.progress.read().ended >= self.quota

    def find_hang(self, process: Process, now: float, limits: Limits) -> str | None:
        """Return why its process hangs, or None."""
        if not process.ready:
            most = limits.start + float(self.settings.get("wait", 0.0))
            late = self.was_ready and now - process.started > most
            return f"did not start within {most:g} s" if late else None
        sample = process.progress.read()
        if sample != self.sample:
            if (sample.position, sample.ended) != (self.sample.position, self.sample.ended):
                self.episode_since = now
            self.sample, self.since = sample, now
        if not sample.candidates:
            return None
        if limits.step is not None and now - self.since > limits.step:
            return f"made no step for {limits.step:g} s"
        if (
            limits.episode is not None
            and sample.episode is not None
            and now - self.episode_since > limits.episode
        ):
            return f"was at one episode for {limits.episode:g} s"
        return None

    def compute_pause(self, process: Process, server_exit: ServerExit, sample: Sample) -> float | None:
        """Return the seconds before a restart after an end; None for no restart."""
        # A server that was never ready fails permanently, unless a user or a scheduler ended it.
        if self.has_left or not (self.was_ready or server_exit.is_external):
            return None
        self.failed_starts = 0 if process.ready else self.failed_starts + 1
        self.ends = 0 if sample.ended else self.ends + 1
        wasted = not sample.ended and not sample.is_at_work and not server_exit.is_external
        self.fruitless = self.fruitless + 1 if wasted else 0
        if self.failed_starts >= MAX_STARTS or self.fruitless >= 2 * MAX_STARTS:
            return None
        longest = LONGEST_PAUSE_AT_WORK_S if sample.is_at_work else LONGEST_PAUSE_S
        return min(FIRST_PAUSE_S * 2.0 ** max(self.ends - 1, 0), longest)


def stagger_quotas(servers: int, recycle: int) -> list[int]:
    """Return staggered quotas for the first processes of servers that start together.

    Servers share the work evenly, so with equal quotas all would restart at the same time.
    """
    return [-(-recycle * (index + 1) // servers) for index in range(servers)]
