"""Simulation servers that a run starts on this machine, each in its own process."""

import logging
import os
import queue
import time
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType, TracebackType
from typing import Any, Self

from swarmwright import _engine
from swarmwright.common.errors import RunError
from swarmwright.servers.rows import ServerUses
from swarmwright.servers.supervision import News, Output, ServerEnd, ServerEvent, Supervisor
from swarmwright.servers.supervision.process import Limits

_log = logging.getLogger("swarmwright")

_running: dict[str, "LocalServers"] = {}
"""Address of the broker -> servers of this process on it."""


def automatic_count() -> int:
    """Return the number of servers for this machine: one per processor, from 2 to 8."""
    return min(max(os.cpu_count() or 1, 2), 8)


def count_processors() -> int:
    """Return how many processors this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def find_running(broker: str) -> "LocalServers | None":
    """Return the servers that this process has started on a broker, or None."""
    return _running.get(broker)


class LocalServers:
    """Server processes for the duration of a `with` block; those that end or hang are restarted.

    Args:
        settings: arguments of `_engine.serve`, one mapping per server; a Python simulation by its class.
        visual: let the servers draw on this process's standard output.
        limits: their time limits.
        environment: further variables of the processes.

    Raises:
        RunError: on entry, if a server does not start; the message includes its last output.
    """

    def __init__(
        self,
        settings: list[dict[str, Any]],
        *,
        visual: bool = False,
        limits: Limits | None = None,
        environment: Mapping[str, str] = MappingProxyType({}),
    ) -> None:
        limits = limits or Limits()
        self._start = limits.start
        self._broker = str(settings[0]["broker"])
        self.output = Output()
        self._supervisor = Supervisor(
            settings,
            draws=visual,
            output=self.output,
            tell=self._handle_news,
            limits=limits,
            environment=environment,
        )
        self._started: queue.SimpleQueue[News] = queue.SimpleQueue()
        self._ready = False
        self._attached = False
        self._warned: set[int] = set()

    def __enter__(self) -> Self:
        try:
            self._supervisor.start()
            self._wait_until_ready()
        except BaseException:
            self.close()
            raise
        _running[self._broker] = self
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    @property
    def pids(self) -> list[int]:
        """Process ids of the running servers."""
        return self._supervisor.pids

    @property
    def count(self) -> int:
        """Number of servers, including those being restarted."""
        return len(self._supervisor.identifiers)

    @property
    def usage(self) -> str:
        """Empty, as processes of this machine are not counted."""
        return ""

    @property
    def use(self) -> ServerUses:
        """Empty, as processes of this machine are not counted."""
        return {}

    @property
    def on_status(self) -> None:
        """None, as their number does not depend on the work."""

    @property
    def restarts(self) -> int:
        """Number of restarted servers."""
        return self._supervisor.restarts

    def attach(self, pool: _engine.Pool) -> None:
        """Report the state of the servers to a pool, until `detach`."""
        self._supervisor.attach(pool.watch(self._supervisor.identifiers))
        self._attached = True

    def detach(self) -> None:
        """Stop reporting, because the pool is closed."""
        self._supervisor.attach(None)
        self._attached = False

    def log_to(self, file: Path) -> None:
        """Write the servers' output to a file, created with the first line."""
        self.output.log_to(file)

    def close(self) -> None:
        """End all servers: ask all to end, wait for each, then kill."""
        if _running.get(self._broker) is self:
            del _running[self._broker]
        self._supervisor.stop()
        self.output.close()

    def check(self) -> None:
        """Log servers given up since the last check; raise RunError if none remains."""
        self._supervisor.check()
        lost = self._supervisor.find_given_up()
        for server_exit in lost:
            if server_exit.server not in self._warned:
                self._warned.add(server_exit.server)
                _log.warning(
                    "%s\nIt is not restarted, because it keeps failing at start.", server_exit.report
                )
        if self._supervisor.has_given_up_all():
            endings = "\n".join(server_exit.report for server_exit in lost)
            raise RunError(f"all simulation servers have failed:\n{endings}")

    def _handle_news(self, news: News) -> None:
        if not self._ready:
            self._started.put(news)
        elif isinstance(news, ServerEnd) and not self._attached and news.pause is not None:
            _log.warning("%s", news.server_exit.report)

    def _wait_until_ready(self) -> None:
        deadline = time.monotonic() + self._start
        waiting = self.count
        while waiting:
            try:
                news = self._started.get(timeout=max(0.0, deadline - time.monotonic()))
            except queue.Empty:
                raise RunError(
                    f"a simulation server did not start within {self._start:g} s; "
                    "increase timeouts.discovery in the experiment"
                ) from None
            if isinstance(news, ServerEnd):
                raise RunError(news.server_exit.report)
            if isinstance(news, ServerEvent) and news.report.get("event") == "ready":
                waiting -= 1
        self._ready = True
