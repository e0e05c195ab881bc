"""Supervision of launchers: starts and replaces servers, and gives up launchers that keep failing."""

import logging
import secrets
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Any, Self, cast

from swarmwright import _engine
from swarmwright.common.errors import InputError, RunError, engine_errors
from swarmwright.servers.evaluation.base import BudgetSpent
from swarmwright.servers.evaluation.launched.access import Access
from swarmwright.servers.evaluation.launched.entry import Entry, LaunchedServer
from swarmwright.servers.evaluation.launched.scaling import Load, Scaling
from swarmwright.servers.launchers import Health, LauncherError
from swarmwright.servers.server_use import ServerUse
from swarmwright.servers.supervision.output import MAX_KEPT_LINES, Output

_log = logging.getLogger("swarmwright")

POLL_S = 0.5
"""Seconds between checks, unless a message arrives earlier."""
LATE_S = 5.0
"""Seconds in a queue before waiting servers are reported."""
SHOWN_LINES = 20
"""Output lines to show of a server that ended early."""
SHOWN_SERVERS = 3
"""Late servers whose output is shown; remote ones cost a request each."""
MAX_FAILURES = 3
"""Consecutive servers that end before they reach the broker until a launcher is given up."""
FIRST_PAUSE_S, LONGEST_PAUSE_S = 1.0, 60.0
"""Seconds before a server is replaced; doubled with each consecutive early end."""
LAUNCHER_TIMEOUT_S = 60.0
"""Seconds a launcher may stay silent while none of its servers is on the broker."""
COLLECT_S = 10.0
"""Time limit, seconds, for collecting the output of remote servers at the end of a run."""
_LARGEST_ID = 2**31 - 1
"""The largest server ID."""


class LaunchedServers:
    """Servers of several launchers for the duration of a `with` block, entered with the first server.

    Args:
        entries: the launchers.
        access: the broker.
        prefix: prefix of all topics.

    Raises:
        InputError: on entry, if earlier sessions have spent the budget of every launcher.
        RunError: on entry, if no launcher can start a server; with the launchers' messages.
    """

    def __init__(self, entries: Sequence[Entry], access: Access, prefix: str) -> None:
        self.access = access
        self._entries = list(entries)
        self._prefix = prefix
        self._present: set[int] = set()
        self._changed = threading.Condition()
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._supervise, daemon=True, name="launchers")
        self._watcher: _engine.Watcher | None = None
        self._supervision: _engine.Supervision | None = None
        self._failure: BaseException | None = None
        self._warned: set[str] = set()
        self._began = time.monotonic()
        # Random ids, as other servers may be on this broker.
        self._next = 1 + secrets.randbelow(_LARGEST_ID // 2)
        self._reserved: dict[str, list[int]] = {}
        self._load: Load | None = None
        self._output: Output | None = None
        self.restarts = 0

    def __enter__(self) -> Self:
        self._check_budgets()
        try:
            with engine_errors():
                self._watcher = _engine.Watcher(
                    self.access.address, prefix=self._prefix, account=self.access.account
                )
            for entry in self._entries:
                options = entry.options
                entry.target, entry.counted_at = options.initial_count, time.monotonic()
                entry.compare_with_budget()
                if entry.is_spent:
                    entry.target = 0
                    self._warn_once(f"{entry.budget_message}; starting none of its servers")
                self._reserved[entry.name] = [
                    self._new_id() for _ in range(options.max_count)
                ]  # see `_start`
                if options.is_elastic:
                    entry.scaling = Scaling(options.initial_count, options.max_count, options.idle)
                with entry.prefix_errors():
                    entry.launcher.open()
            for entry in self._entries:
                if entry.target:
                    with entry.prefix_errors():
                        self._start(entry, entry.target)
            self._thread.start()
            self._wait_for_first()
        except BaseException:
            self.close()
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    @property
    def count(self) -> int:
        """Intended number of servers."""
        return sum(entry.target for entry in self._entries)

    @property
    def description(self) -> str:
        """The launchers and their numbers of servers as text."""
        return ", ".join(f"{entry.target} by {entry.name}" for entry in self._entries)

    @property
    def usage(self) -> str:
        """Running time and cost of servers as text; empty for negligible use without a price."""
        return "; ".join(entry.usage_text for entry in self._entries if entry.is_counted and entry.is_notable)

    @property
    def use(self) -> dict[str, ServerUse]:
        """Use of the servers of each launcher in this session."""
        return {entry.name: entry.use for entry in self._entries if entry.is_counted}

    @property
    def on_status(self) -> Callable[[Mapping[str, Any]], None] | None:
        """Callback for the pool's status; None if no launcher scales with the work."""
        return self._hear_status if any(entry.scaling for entry in self._entries) else None

    def _hear_status(self, status: Mapping[str, Any]) -> None:
        self._load = Load.from_status(status)

    def attach(self, pool: _engine.Pool) -> None:
        """Report the servers being started to a pool until `detach`, on the pool's thread."""
        for entry in self._entries:
            entry.launcher.attach(pool, self._reserved[entry.name])
        self._supervision = pool.watch([])

    def detach(self) -> None:
        """Stop reporting, because the pool is closed."""
        self._supervision = None
        for entry in self._entries:
            entry.launcher.attach(None, ())

    def log_to(self, file: Path) -> None:
        """Write the output of servers to a file: local servers at once, remote ones when they end."""
        for entry in self._entries:
            entry.launcher.log_to(file)
        if self._output is None:
            self._output = Output()
        self._output.log_to(file)

    def check(self) -> None:
        """Log launchers that were given up; raise RunError if no server remains."""
        if self._failure is not None:
            raise RunError(f"launchers: {self._failure!r}") from self._failure
        ends = [entry.is_spent or entry.failure is not None for entry in self._entries]
        if all(ends) and any(entry.is_spent for entry in self._entries):
            self._warn_once(
                f"the budget for servers is spent: {self.usage}; continue with `swarmwright resume` and a "
                "larger budget or other servers"
            )
            raise BudgetSpent
        lost = [entry for entry in self._entries if entry.failure is not None]
        if len(lost) == len(self._entries) and not self._present:
            raise RunError("\n".join(f"{entry.name}: {entry.failure}" for entry in lost))
        for entry in lost:
            self._warn_once(f"{entry.name}: {entry.failure}\nThis launcher is no longer used.")

    def _check_budgets(self) -> None:
        """Raise InputError if no launcher has budget for a server."""
        for entry in self._entries:
            entry.compare_with_budget()
        if all(entry.is_spent for entry in self._entries):
            words = "; ".join(entry.budget_message for entry in self._entries)
            entry = self._entries[0]
            # Several launchers are a list in the experiment.
            key = "servers.budget" if len(self._entries) == 1 else "servers.0.budget"
            larger = 2 * max(entry.earlier.cost, entry.options.budget or 0.0)
            raise InputError(
                f"servers: {words}. Set a larger budget, such as --set "
                f"{key}={float(f'{larger:.2g}'):.10g}, or choose other servers, such as --servers local"
            )

    def close(self) -> None:
        """End all servers of all launchers."""
        self._stopping.set()
        if self._thread.is_alive():
            self._thread.join()
        deadline = time.monotonic() + COLLECT_S
        for entry in self._entries:
            for server in entry.servers:
                if time.monotonic() < deadline:
                    self._collect_output(entry, server)
            try:
                entry.launcher.close()
            except LauncherError as error:
                _log.warning("%s: servers may still be running: %s", entry.name, error)
        if self._output is not None:
            self._output.close()
        if self._watcher is not None:
            self._watcher.close()
            self._watcher = None

    def _wait_for_first(self) -> None:
        """Wait until a server is on the broker, for any time in a queue."""
        with self._changed:
            while not self._present:
                self.check()
                self._changed.wait(0.2)

    def _supervise(self) -> None:
        try:
            while not self._stopping.is_set():
                self._read_presence()
                now = time.monotonic()
                for entry in self._entries:
                    entry.count_use(now)
                    if entry.is_spent:
                        entry.target = 0
                    if entry.failure is None and now - entry.checked_at >= entry.launcher.interval:
                        entry.checked_at = now
                        self._check_servers(entry, now)
                self._report_coming()
                with self._changed:
                    self._changed.notify_all()
        except Exception as error:  # noqa: BLE001 - raised by `check`, in the run's own thread
            self._failure = error
            with self._changed:
                self._changed.notify_all()

    def _read_presence(self) -> None:
        """Read the presence of servers from the broker."""
        assert self._watcher is not None
        entries = {server: entry for entry in self._entries for server in entry.servers}
        for news in self._watcher.poll(min(POLL_S, *(entry.launcher.interval for entry in self._entries))):
            message = cast("dict[str, Any]", news)
            if "left" in message:
                self._present.discard(message["left"])
            elif "presence" in message and message["presence"]["server"] in entries:
                presence = message["presence"]
                server = presence["server"]
                if presence["state"] == "lost":
                    self._present.discard(server)
                    continue
                self._present.add(server)
                entries[server].servers[server].was_ready = True
                entries[server].failures, entries[server].early_exits = 0, []

    def _check_servers(self, entry: Entry, now: float) -> None:
        """Check a launcher's servers and replace those that have ended."""
        try:
            states = entry.launcher.health()
            entry.answered_at = now
        except LauncherError as error:
            self._note_no_answer(entry, str(error), now)
            return
        for server, server_state in list(entry.servers.items()):
            health = states.get(server, Health("ended", "is no longer known to the launcher"))
            if health.state == "running" and server_state.health.state != "running":
                server_state.since = now
            server_state.health = health
            late = (
                health.state == "running"
                and not server_state.was_ready
                and now - server_state.since > entry.options.start_timeout
            )
            if health.state == "ended" or late:
                self._handle_end(entry, server, late=late)
        self._report_waiting(entry, now)
        self._report_starting(entry, now)
        self._scale(entry, now)
        missing = entry.target - len(entry.servers)
        if entry.failure is None and missing > 0 and now >= entry.replace_at:
            self._replace(entry, missing, now)

    def _scale(self, entry: Entry, now: float) -> None:
        """Scale with the work; stop surplus servers, queued ones first, then idle ones."""
        load = self._load
        if entry.scaling is not None and load is not None and not entry.is_spent:
            entry.target = entry.scaling.choose_count(now, entry.target, load)
        surplus = len(entry.servers) - entry.target
        if surplus <= 0:
            return
        busy = frozenset() if load is None else load.busy

        def worth(server: int) -> tuple[bool, bool, float]:
            server_state = entry.servers[server]
            return server_state.health.state == "running", server in busy, -server_state.since

        leaving = sorted(entry.servers, key=worth)[:surplus]
        for server in leaving:
            self._collect_output(entry, server)
        try:
            entry.launcher.stop(leaving)
        except LauncherError as error:
            self._note_no_answer(entry, str(error), now)
            return
        for server in leaving:
            del entry.servers[server]
            self._present.discard(server)

    def _handle_end(self, entry: Entry, server: int, *, late: bool) -> None:
        """Handle the end of a server."""
        server_state = entry.servers.pop(server)
        self._present.discard(server)
        printed = [line for line in self._collect_output(entry, server) if line.strip()][-SHOWN_LINES:]
        with suppress(LauncherError):
            entry.launcher.stop([server])
        words = server_state.health.reason or "ended"
        if late:
            words = (
                f"runs, but has not reached {entry.launcher.specification.broker} after "
                f"{entry.options.start_timeout:g} s; {self._explain_connection(entry)}"
            )
        text = "\n".join([f"server {server} {words}", *printed])
        pause = 0.0
        if not server_state.was_ready:
            entry.failures += 1
            entry.early_exits = [*entry.early_exits, text][-MAX_FAILURES:]
            pause = min(FIRST_PAUSE_S * 2.0 ** (entry.failures - 1), LONGEST_PAUSE_S)
            if entry.failures >= min(MAX_FAILURES, max(entry.target, 1)) and not self._has_present_server(
                entry
            ):
                entry.failure = "no server starts:\n" + "\n".join(dict.fromkeys(entry.early_exits))
        entry.replace_at = max(entry.replace_at, time.monotonic() + pause)

    def _collect_output(self, entry: Entry, server: int) -> Sequence[str]:
        """Return the last output lines of a server, and log those of remote servers."""
        lines: Sequence[str] = ()
        with suppress(LauncherError):
            lines = entry.launcher.logs(server, MAX_KEPT_LINES)
        if self._output is not None and not entry.launcher.is_here:
            for line in lines:
                self._output.record(server, line)
        return lines

    def _replace(self, entry: Entry, missing: int, now: float) -> None:
        try:
            self._start(entry, missing)
            self.restarts += missing
        except LauncherError as error:
            self._note_no_answer(entry, str(error), now)

    def _note_no_answer(self, entry: Entry, words: str, now: float) -> None:
        """Note that a launcher does not answer; give it up if that lasts and it has no server."""
        if self._has_present_server(entry):
            entry.answered_at = now
        self._warn_once(f"{entry.name}: {words}\nRetrying; running servers continue.")
        entry.replace_at = now + FIRST_PAUSE_S
        if now - entry.answered_at > LAUNCHER_TIMEOUT_S:
            entry.failure = words

    def _report_waiting(self, entry: Entry, now: float) -> None:
        """Report queued servers if they wait long or the reason changes."""
        waiting = [
            server.health.reason for server in entry.servers.values() if server.health.state == "waiting"
        ]
        if not waiting or now - self._began < LATE_S or not any(waiting):
            return
        reasons = ", ".join(sorted({reason for reason in waiting if reason}))
        message = f"{len(waiting)} of {entry.target} servers are waiting: {reasons}"
        if message != entry.reported_waiting:
            entry.reported_waiting = message
            _log.warning("%s: %s", entry.name, message)

    def _report_starting(self, entry: Entry, now: float) -> None:
        """Report that servers run but none has reached the broker."""
        late = [
            server
            for server, server_state in entry.servers.items()
            if server_state.health.state == "running"
            and not server_state.was_ready
            and now - server_state.since >= LATE_S
        ]
        if self._present or entry.reported_starting or not late:
            return
        entry.reported_starting = True
        lines: list[str] = []
        for server in late[:SHOWN_SERVERS]:
            with suppress(LauncherError):
                lines += [line for line in entry.launcher.logs(server, SHOWN_LINES) if line.strip()]
        message = (
            f"{entry.name}: none of {len(late)} started servers has reached "
            f"{entry.launcher.specification.broker} yet; each has {entry.options.start_timeout:g} s"
        )
        if lines:
            message += f"; {self._explain_connection(entry)}. Their output:"
        _log.warning("%s", "\n".join([message, *dict.fromkeys(lines[-SHOWN_LINES:])]))

    def _explain_connection(self, entry: Entry) -> str:
        """Explain how servers reach the broker."""
        advice = "servers must be able to reach this address, see the options broker_host and start_timeout"
        username, file = entry.launcher.specification.username, entry.options.credentials
        if username is None or self.access.servers:
            return advice
        account = (
            f"with the account {username} of {file}"
            if file is not None
            else f"with the account of this process, {username}; the option credentials sets another, like "
            "the file server.env of `swarmwright broker --init`"
        )
        return f"{advice}, and need the rights of a server: they log in {account}"

    def _start(self, entry: Entry, count: int) -> None:
        """Start servers. Raises LauncherError."""
        # Local processes keep their ids, which the pool knows.
        free = [server for server in self._reserved[entry.name] if server not in entry.servers]
        ids = free[:count] if entry.launcher.is_here else [self._new_id() for _ in range(count)]
        entry.launcher.start(ids)
        now = time.monotonic()
        entry.servers |= {server: LaunchedServer(now) for server in ids}

    def _new_id(self) -> int:
        self._next += 1
        return self._next

    def _has_present_server(self, entry: Entry) -> bool:
        return not self._present.isdisjoint(entry.servers)

    def _report_coming(self) -> None:
        """Report to the pool how many servers may still arrive."""
        supervision = self._supervision
        if supervision is not None:
            coming = [
                server
                for entry in self._entries
                if entry.failure is None
                for server in range(max(0, entry.target - len(self._present & set(entry.servers))))
            ]
            supervision.starting(len(coming))

    def _warn_once(self, text: str) -> None:
        if text not in self._warned:
            self._warned.add(text)
            _log.warning("%s", text)
