"""Supervision of server processes: starts them, ends hanging ones, restarts ended ones."""

import logging
import signal
import threading
import time
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from swarmwright.common.errors import RunError
from swarmwright.servers.supervision.output import Output, Sample
from swarmwright.servers.supervision.process import (
    LONGEST_PAUSE_S,
    Limits,
    Process,
    SupervisedServer,
    stagger_quotas,
)
from swarmwright.servers.supervision.server_exit import (
    News,
    ServerEnd,
    ServerEvent,
    ServerExit,
    ServerRestart,
)

if TYPE_CHECKING:
    from swarmwright import _engine

_log = logging.getLogger("swarmwright")

CHECK_S = 0.2
"""Seconds between checks of the servers."""
FAST_CHECK_S = 0.01
"""Seconds between checks while a server is about to end."""


class Supervisor:
    """Supervisor of a set of servers, from `start` to `stop`.

    Args:
        settings: one mapping of `server_process`'s arguments per server, with its `id`.
        draws: whether servers draw on this process's standard output.
        restart: whether to restart servers that end.
        output: collects their output.
        tell: called with news, on another thread; must not call back.
        limits: their time limits.
        environment: further variables of the processes.
        recycle: evaluations after which a process is replaced; 0 for never. The first replacements of
            servers that start together are staggered.
    """

    def __init__(
        self,
        settings: Sequence[Mapping[str, Any]],
        *,
        draws: bool = False,
        restart: bool = True,
        output: Output,
        tell: Callable[[News], None],
        limits: Limits | None = None,
        environment: Mapping[str, str] | None = None,
        recycle: int = 0,
    ) -> None:
        self._servers = self._make_servers(settings, recycle)
        self._environment = dict(environment or {})
        self._leaving: set[int] = set()
        self._draws, self._restart, self._recycle = draws, restart, recycle
        self._output = output
        self._tell = tell
        self._limits = limits or Limits()
        self._supervision: _engine.Supervision | None = None
        self._last: _engine.Supervision | None = None
        self._stopping = threading.Event()
        self._news = threading.Event()
        self._lock = threading.Lock()
        self._thread = threading.Thread(target=self._watch, daemon=True, name="supervisor")
        self._failure: Exception | None = None
        self.restarts = 0
        """Number of restarts."""

    @staticmethod
    def _make_servers(settings: Sequence[Mapping[str, Any]], recycle: int) -> dict[int, SupervisedServer]:
        first = stagger_quotas(len(settings), recycle)
        return {
            int(setting["id"]): SupervisedServer(setting, quota)
            for setting, quota in zip(settings, first, strict=True)
        }

    @property
    def identifiers(self) -> list[int]:
        """Ids of all servers."""
        return list(self._servers)

    @property
    def pids(self) -> list[int]:
        """Process ids of the running servers."""
        with self._lock:
            return [
                supervised.process.pid
                for supervised in self._servers.values()
                if supervised.process is not None
            ]

    def find_given_up(self) -> list[ServerExit]:
        """Return the last exits of servers that will not be restarted."""
        with self._lock:
            supervised = self._servers.values()
            return [server.last for server in supervised if server.is_given_up and server.last is not None]

    def read_last_lines(self, server: int) -> tuple[str, ...]:
        """Return the last output lines of a running server."""
        supervised = self._servers.get(server)
        process = None if supervised is None else supervised.process
        return () if process is None else process.lines

    def check(self) -> None:
        """Raise RunError if supervision has failed."""
        if self._failure is not None:
            raise RunError(f"the supervision of servers failed: {self._failure!r}") from self._failure

    def has_given_up_all(self) -> bool:
        """Whether all servers were given up."""
        return len(self.find_given_up()) == len(self._servers)

    def start(self) -> None:
        """Start all servers; call `stop` even if this raises."""
        for supervised in self._servers.values():
            self._start_process(supervised)
        self._thread.start()

    def add(self, settings: Sequence[Mapping[str, Any]]) -> None:
        """Start further servers. Raises OSError if the system refuses another process."""
        with self._lock:
            for server, supervised in self._make_servers(settings, self._recycle).items():
                self._start_process(supervised)
                self._servers = {**self._servers, server: supervised}  # other threads iterate over it
            self._report_starting()

    def remove(self, servers: Collection[int]) -> None:
        """End servers for good, asynchronously; unknown ones are ignored."""
        with self._lock:
            self._leaving.update(servers)
        self._news.set()

    def _remove(self) -> None:
        with self._lock:
            servers, self._leaving = self._leaving, set()
            leaving = [supervised for server, supervised in self._servers.items() if server in servers]
            self._servers = {
                server: supervised for server, supervised in self._servers.items() if server not in servers
            }
            self._report_starting()
        _end([supervised.process for supervised in leaving if supervised.process is not None])

    def stop(self, grace: float = 0.0) -> None:
        """End all servers: ask all to end, wait for each, then kill.

        grace: seconds for each to finish its current request or episode.
        """
        self._stopping.set()
        self._news.set()
        if self._thread.is_alive():
            self._thread.join()
        self._finish(grace)
        _end([supervised.process for supervised in self._servers.values() if supervised.process is not None])
        for supervised in self._servers.values():
            supervised.process = None

    def _finish(self, grace: float) -> None:
        """Let each server finish its current work, then ask it to end."""
        deadline = time.monotonic() + grace
        computing = {}
        for supervised in self._servers.values():
            if supervised.process is not None:
                computing[supervised.process] = supervised.process.progress.read()
        while computing and time.monotonic() < deadline:
            for process, before in list(computing.items()):
                now = process.progress.read()
                if not now.continues(before):
                    process.dismiss()
                    del computing[process]
            time.sleep(FAST_CHECK_S)

    def attach(self, supervision: "_engine.Supervision | None") -> None:
        """Report the state of the servers to a pool from now on; None for no pool."""
        with self._lock:
            self._supervision = supervision
            if supervision is not None:
                # Output for the previous pool may still arrive; request numbers are unique.
                before = self._last
                self._last = supervision
                self._output.find_origin = lambda request: (
                    supervision.place(request) or (before and before.place(request))
                )
            self._report_starting()

    def _start_process(self, supervised: SupervisedServer) -> None:
        supervised.sample, supervised.since = Sample(), time.monotonic()
        supervised.restart_at = None
        supervised.process = Process(
            supervised.settings,
            draws=self._draws,
            on_event=self._handle_event,
            on_line=self._output.record_raw,
            on_end=self._news.set,
            environment=self._environment,
        )

    def _handle_event(self, process: Process, report: dict[str, Any]) -> None:
        if report.get("event") == "ready":
            with self._lock:
                supervised = self._servers.get(process.identifier)
                if supervised is not None:  # may have been removed meanwhile
                    supervised.was_ready, supervised.failed_starts = True, 0
                self._report_starting()
        elif report.get("event") == "error" and process.ready:
            with self._lock:
                supervised = self._servers.get(process.identifier)
                if supervised is not None:
                    supervised.has_left = True
        self._tell(ServerEvent(process.identifier, process.pid, report))

    def _report_starting(self) -> None:
        """Report the number of starting servers to the pool."""
        if self._supervision is not None:
            servers = self._servers.values()
            starting = [
                server
                for server in servers
                if server.restart_at is not None or (server.process is not None and not server.process.ready)
            ]
            self._supervision.starting(len(starting))

    def _watch(self) -> None:
        try:
            self._watch_servers()
        except Exception as error:  # noqa: BLE001 - raised by `check`, in the thread of its caller
            self._failure = error
            _log.exception(
                "The supervision of servers failed; servers that end or hang are no longer restarted."
            )

    def _watch_servers(self) -> None:
        last = time.monotonic()
        while not self._stopping.is_set():
            self._news.wait(self._find_wait())
            self._news.clear()
            if self._leaving:
                self._remove()
            now = time.monotonic()
            # This process was suspended, and probably the servers, too.
            away = max(0.0, now - last - 5 * CHECK_S)
            last = now
            overdue = self._take_overdue()
            for supervised in self._servers.values():
                if self._stopping.is_set():
                    return
                supervised.since += away
                supervised.episode_since += away
                self._check_server(supervised, now, overdue=int(supervised.settings["id"]) in overdue)

    def _find_wait(self) -> float:
        times = [
            supervised.restart_at
            for supervised in self._servers.values()
            if supervised.restart_at is not None
        ]
        # The output closes shortly before the process ends.
        look = (
            FAST_CHECK_S
            if any(supervised.process and supervised.process.silent for supervised in self._servers.values())
            else CHECK_S
        )
        return max(0.0, min([look, *(at - time.monotonic() for at in times)]))

    def _take_overdue(self) -> set[int]:
        supervision = self._supervision
        return set() if supervision is None else set(supervision.take_overdue())

    def _check_server(self, supervised: SupervisedServer, now: float, *, overdue: bool) -> None:
        process = supervised.process
        if process is None:
            if supervised.restart_at is not None and supervised.restart_at <= now:
                self._restart_process(supervised)
            return
        if overdue and self._supervision is not None and process.ready:
            if process.progress.read().candidates:
                self._supervision.is_alive(process.identifier)
            else:
                process.end_hung("did not answer in time")
        elif (
            process.hung is None and (reason := supervised.find_hang(process, now, self._limits)) is not None
        ):
            process.end_hung(reason)
        elif supervised.is_to_be_replaced(process):
            process.recycle()
        server_exit = process.end()
        if server_exit is not None:
            self._handle_end(supervised, process, server_exit)

    def _handle_end(self, supervised: SupervisedServer, process: Process, server_exit: ServerExit) -> None:
        """Handle the end of a process: report it and schedule the restart."""
        sample = process.progress.read()
        with self._lock:
            supervised.process, supervised.last = None, server_exit
            pause = supervised.compute_pause(process, server_exit, sample) if self._restart else None
            supervision = self._supervision
        origin = None if supervision is None else supervision.place(sample.request)
        work = ""
        if origin is not None and sample.candidates == 1:
            work = self._output.describe(origin, sample.first, sample.episode or 0)
        # A recycled process finishes its work and ends by this signal, unless the system kills it before.
        is_recycled = process.recycled and server_exit.status == -signal.SIGTERM
        description = (
            "has reached its quota of evaluations (recycle)" if is_recycled else server_exit.description
        )
        self._output.record(server_exit.server, f"[{description}]", work)
        if supervision is not None:
            supervision.ended(
                server_exit.server,
                server_exit.pid,
                f"a simulation server {description}",
                stack=server_exit.output_text or None,
                outside=server_exit.is_external,
                at=sample.position,
            )
        process.close()
        self._tell(ServerEnd(server_exit, pause))
        with self._lock:
            supervised.restart_at = None if pause is None else time.monotonic() + pause
            supervised.is_given_up = pause is None
            self._report_starting()
        self._news.set()

    def _restart_process(self, supervised: SupervisedServer) -> None:
        try:
            with self._lock:
                if self._stopping.is_set():
                    return
                supervised.quota = self._recycle
                self._start_process(supervised)
                self.restarts += 1
                process = supervised.process
        except OSError as error:  # too many processes or no memory: possibly temporary
            supervised.restart_at = time.monotonic() + LONGEST_PAUSE_S
            self._output.record(int(supervised.settings["id"]), f"[cannot be started: {error}]")
            return
        assert process is not None
        self._tell(ServerRestart(process.identifier, process.pid))


def _end(processes: Sequence[Process]) -> None:
    """Ask all processes to end, wait for each, then kill."""
    for process in processes:
        process.dismiss()
    for process in processes:
        process.close()
