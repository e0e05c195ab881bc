"""Simulation servers that a run starts for itself, each in its own process, and ends with it."""

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
from swarmwright.servers.server_use import ServerUses
from swarmwright.servers.supervision import Ended, Event, News, Output, Supervisor
from swarmwright.servers.supervision.place import Limits

_log = logging.getLogger("swarmwright")

_running: dict[str, "LocalServers"] = {}
"""Address of the broker -> servers of this process on it."""


def automatic_count() -> int:
    """Return how many servers suit this machine: one per processor, at least 2 and at most 8."""
    return min(max(os.cpu_count() or 1, 2), 8)


def processors() -> int:
    """Return how many processors this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def running_on(broker: str) -> "LocalServers | None":
    """Return the servers that this process has started on a broker, None where there are none."""
    return _running.get(broker)


class LocalServers:
    """Server processes for the time of a `with` block; those that end or hang are started again.

    Args:
        settings: the arguments of `_engine.serve`, one mapping per server; a simulation in Python by its
            class.
        visual: let the servers draw on this process's standard output.
        limits: of their time.
        environment: further variables of the processes.

    Raises:
        RunError: on entry, when a server does not start; the message holds its last output.

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
            tell=self._heard,
            limits=limits,
            environment=environment,
        )
        self._started: queue.SimpleQueue[News] = queue.SimpleQueue()
        self._ready = False
        self._attached = False
        self._told: set[int] = set()

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
        """Process ids of those that run now."""
        return self._supervisor.pids

    @property
    def count(self) -> int:
        """How many servers there are, also while one of them is being started again."""
        return len(self._supervisor.identifiers)

    @property
    def usage(self) -> str:
        """Nothing: processes of this machine are not counted."""
        return ""

    @property
    def use(self) -> ServerUses:
        """Nothing: processes of this machine are not counted."""
        return {}

    @property
    def on_status(self) -> None:
        """None: their number does not depend on the work."""

    @property
    def restarts(self) -> int:
        """How often one was started again."""
        return self._supervisor.restarts

    def attach(self, pool: _engine.Pool) -> None:
        """Report the state of the servers to a pool, until `detach`."""
        self._supervisor.attach(pool.watch(self._supervisor.identifiers))
        self._attached = True

    def detach(self) -> None:
        """Stop reporting: the pool is closed."""
        self._supervisor.attach(None)
        self._attached = False

    def log_to(self, file: Path) -> None:
        """Write what the servers print to a file, which is made when there is something."""
        self.output.log_to(file)

    def close(self) -> None:
        """End all servers: ask all, then wait for each, then kill."""
        if _running.get(self._broker) is self:
            del _running[self._broker]
        self._supervisor.stop()
        self.output.close()

    def check(self) -> None:
        """Log servers that have been given up since the last check; raise RunError when none is left.

        Also when they are not watched any more.
        """
        self._supervisor.check()
        lost = self._supervisor.given_up()
        for server_exit in lost:
            if server_exit.server not in self._told:
                self._told.add(server_exit.server)
                _log.warning("%s\nIt is not started again: it keeps failing at start.", server_exit.report)
        if self._supervisor.all_given_up():
            endings = "\n".join(server_exit.report for server_exit in lost)
            raise RunError(f"no simulation server is left:\n{endings}")

    def _heard(self, news: News) -> None:
        if not self._ready:
            self._started.put(news)
        elif isinstance(news, Ended) and not self._attached and news.pause is not None:
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
                    "timeouts.discovery of the experiment gives it more time"
                ) from None
            if isinstance(news, Ended):
                raise RunError(news.server_exit.report)
            if isinstance(news, Event) and news.report.get("event") == "ready":
                waiting -= 1
        self._ready = True
