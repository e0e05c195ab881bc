"""Keeps the servers of launchers going: starts them, replaces those that end, gives up what keeps failing."""

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
from swarmwright.servers.supervision.output import MOST_KEPT_LINES, Output

_log = logging.getLogger("swarmwright")

POLL_S = 0.5
"""Seconds between two looks, unless something is heard before."""
LATE_S = 5.0
"""Seconds for which servers may wait in a queue before that is reported."""
SHOWN_LINES = 20
"""Lines of a server that ended too early which are shown."""
SHOWN_SERVERS = 3
"""Servers that are late whose lines are shown; elsewhere each takes a request."""
MOST_FAILURES = 3
"""Servers in a row that end without having been on the broker before a launcher is given up."""
FIRST_PAUSE_S, LONGEST_PAUSE_S = 1.0, 60.0
"""Seconds before a server is replaced; doubled with each one in a row that was never on the broker."""
LAUNCHER_TIMEOUT_S = 60.0
"""Seconds for which a launcher may not answer, while none of its servers is on the broker."""
COLLECT_S = 10.0
"""Seconds at most for collecting at the end of a run what servers elsewhere have printed."""
_LARGEST_ID = 2**31 - 1
"""The largest of servers' IDs."""


class LaunchedServers:
    """Servers of several launchers for the time of a `with` block, which begins when one is on the broker.

    Args:
        entries: the launchers.
        access: the broker.
        prefix: of all topics.

    Raises:
        InputError: on entry, when the budget of every launcher was spent in earlier sessions.
        RunError: on entry, when no launcher can start a server; with the launchers' own words.

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
        self._told: set[str] = set()
        self._began = time.monotonic()
        # Others may have servers on this broker; ids must differ.
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
                entry.wanted, entry.counted_at = options.fewest, time.monotonic()
                entry.compare_with_budget()
                if entry.is_spent:
                    entry.wanted = 0
                    self._warn_once(f"{entry.spent_before}; none of its servers is started")
                self._reserved[entry.name] = [self._new_id() for _ in range(options.most)]  # see `_start`
                if options.is_elastic:
                    entry.scaling = Scaling(options.fewest, options.most, options.idle)
                with entry.named_errors():
                    entry.launcher.open()
            for entry in self._entries:
                if entry.wanted:
                    with entry.named_errors():
                        self._start(entry, entry.wanted)
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
        """How many servers are wanted."""
        return sum(entry.wanted for entry in self._entries)

    @property
    def where(self) -> str:
        """Which launchers start how many, in words."""
        return ", ".join(f"{entry.wanted} by {entry.name}" for entry in self._entries)

    @property
    def usage(self) -> str:
        """How long servers have run, and what they cost; empty where it would be 0.00 hours of no price."""
        return "; ".join(entry.used for entry in self._entries if entry.is_counted and entry.is_notable)

    @property
    def use(self) -> dict[str, ServerUse]:
        """Of the servers of each launcher in this session."""
        return {entry.name: entry.use for entry in self._entries if entry.is_counted}

    @property
    def on_status(self) -> Callable[[Mapping[str, Any]], None] | None:
        """Takes the pool's status; None where the number of servers does not depend on it."""
        return self._hear_status if any(entry.scaling for entry in self._entries) else None

    def _hear_status(self, status: Mapping[str, Any]) -> None:
        self._load = Load.of_status(status)

    def attach(self, pool: _engine.Pool) -> None:
        """Report to a pool how many servers are being started, until `detach`; from the pool's thread."""
        for entry in self._entries:
            entry.launcher.attach(pool, self._reserved[entry.name])
        self._supervision = pool.watch([])

    def detach(self) -> None:
        """Stop reporting: the pool is closed."""
        self._supervision = None
        for entry in self._entries:
            entry.launcher.attach(None, ())

    def log_to(self, file: Path) -> None:
        """Write what servers print to a file: those of this machine at once, others when they end."""
        for entry in self._entries:
            entry.launcher.log_to(file)
        if self._output is None:
            self._output = Output()
        self._output.log_to(file)

    def check(self) -> None:
        """Log launchers that have been given up; raise RunError when none of their servers is left."""
        if self._failure is not None:
            raise RunError(f"launchers: {self._failure!r}") from self._failure
        ends = [entry.is_spent or entry.given_up is not None for entry in self._entries]
        if all(ends) and any(entry.is_spent for entry in self._entries):
            words = f"the budget for servers is spent: {self.usage}"
            self._warn_once(f"{words}; `swarmwright resume` goes on with a larger one, or with other servers")
            raise BudgetSpent
        lost = [entry for entry in self._entries if entry.given_up is not None]
        if len(lost) == len(self._entries) and not self._present:
            raise RunError("\n".join(f"{entry.name}: {entry.given_up}" for entry in lost))
        for entry in lost:
            self._warn_once(f"{entry.name}: {entry.given_up}\nIt is not used any more.")

    def _check_budgets(self) -> None:
        """Raise InputError when no launcher may start a server."""
        for entry in self._entries:
            entry.compare_with_budget()
        if all(entry.is_spent for entry in self._entries):
            words = "; ".join(entry.spent_before for entry in self._entries)
            entry = self._entries[0]
            # In the experiment, several launchers are a list.
            key = "servers.budget" if len(self._entries) == 1 else "servers.0.budget"
            larger = 2 * max(entry.earlier.cost, entry.options.budget or 0.0)
            raise InputError(
                f"servers: {words}. Give a larger budget, such as --set {key}={float(f'{larger:.2g}'):.10g}, "
                "or other servers, such as --servers local"
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
                    self._printed(entry, server)
            try:
                entry.launcher.close()
            except LauncherError as error:
                _log.warning("%s: servers may be left: %s", entry.name, error)
        if self._output is not None:
            self._output.close()
        if self._watcher is not None:
            self._watcher.close()
            self._watcher = None

    def _wait_for_first(self) -> None:
        """Wait until a server is on the broker; in a queue that may take any time."""
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
                        entry.wanted = 0
                    if entry.given_up is None and now - entry.asked_at >= entry.launcher.interval:
                        entry.asked_at = now
                        self._check_servers(entry, now)
                self._report_coming()
                with self._changed:
                    self._changed.notify_all()
        except Exception as error:  # noqa: BLE001 - raised by `check`, in the run's own thread
            self._failure = error
            with self._changed:
                self._changed.notify_all()

    def _read_presence(self) -> None:
        """Take what servers say of themselves on the broker."""
        assert self._watcher is not None
        own = {server: entry for entry in self._entries for server in entry.servers}
        for news in self._watcher.poll(min(POLL_S, *(entry.launcher.interval for entry in self._entries))):
            told = cast("dict[str, Any]", news)
            if "left" in told:
                self._present.discard(told["left"])
            elif "presence" in told and told["presence"]["server"] in own:
                presence = told["presence"]
                server = presence["server"]
                if presence["state"] == "lost":
                    self._present.discard(server)
                    continue
                self._present.add(server)
                own[server].servers[server].was_ready = True
                own[server].failures, own[server].ended_early = 0, []

    def _check_servers(self, entry: Entry, now: float) -> None:
        """Ask a launcher for its servers, and replace those that have ended."""
        try:
            states = entry.launcher.health()
            entry.answered_at = now
        except LauncherError as error:
            self._note_no_answer(entry, str(error), now)
            return
        for server, server_state in list(entry.servers.items()):
            health = states.get(server, Health("ended", "it is not known any more"))
            if health.state == "running" and server_state.health.state != "running":
                server_state.since = now
            server_state.health = health
            late = (
                health.state == "running"
                and not server_state.was_ready
                and now - server_state.since > entry.options.start_timeout
            )
            if health.state == "ended" or late:
                self._ended(entry, server, late=late)
        self._tell_waiting(entry, now)
        self._tell_starting(entry, now)
        self._scale(entry, now)
        missing = entry.wanted - len(entry.servers)
        if entry.given_up is None and missing > 0 and now >= entry.replace_at:
            self._replace(entry, missing, now)

    def _scale(self, entry: Entry, now: float) -> None:
        """Follow the work; of too many servers, end those that wait first, then those without work."""
        load = self._load
        if entry.scaling is not None and load is not None and not entry.is_spent:
            entry.wanted = entry.scaling.wanted(now, entry.wanted, load)
        surplus = len(entry.servers) - entry.wanted
        if surplus <= 0:
            return
        busy = frozenset() if load is None else load.busy

        def worth(server: int) -> tuple[bool, bool, float]:
            server_state = entry.servers[server]
            return server_state.health.state == "running", server in busy, -server_state.since

        leaving = sorted(entry.servers, key=worth)[:surplus]
        for server in leaving:
            self._printed(entry, server)
        try:
            entry.launcher.stop(leaving)
        except LauncherError as error:
            self._note_no_answer(entry, str(error), now)
            return
        for server in leaving:
            del entry.servers[server]
            self._present.discard(server)

    def _ended(self, entry: Entry, server: int, *, late: bool) -> None:
        """Note the end of a server."""
        server_state = entry.servers.pop(server)
        self._present.discard(server)
        printed = [line for line in self._printed(entry, server) if line.strip()][-SHOWN_LINES:]
        with suppress(LauncherError):
            entry.launcher.stop([server])
        words = server_state.health.reason or "ended"
        if late:
            words = (
                f"runs, but is not on {entry.launcher.specification.broker} after "
                f"{entry.options.start_timeout:g} s; {self._needed(entry)}"
            )
        text = "\n".join([f"server {server} {words}", *printed])
        pause = 0.0
        if not server_state.was_ready:
            entry.failures += 1
            entry.ended_early = [*entry.ended_early, text][-MOST_FAILURES:]
            pause = min(FIRST_PAUSE_S * 2.0 ** (entry.failures - 1), LONGEST_PAUSE_S)
            if entry.failures >= min(MOST_FAILURES, max(entry.wanted, 1)) and not self._on_broker(entry):
                entry.given_up = "no server starts:\n" + "\n".join(dict.fromkeys(entry.ended_early))
        entry.replace_at = max(entry.replace_at, time.monotonic() + pause)

    def _printed(self, entry: Entry, server: int) -> Sequence[str]:
        """Return the last lines that a server printed; those of servers elsewhere are written to the log."""
        lines: Sequence[str] = ()
        with suppress(LauncherError):
            lines = entry.launcher.logs(server, MOST_KEPT_LINES)
        if self._output is not None and not entry.launcher.is_here:
            for line in lines:
                self._output.say(server, line)
        return lines

    def _replace(self, entry: Entry, missing: int, now: float) -> None:
        try:
            self._start(entry, missing)
            self.restarts += missing
        except LauncherError as error:
            self._note_no_answer(entry, str(error), now)

    def _note_no_answer(self, entry: Entry, words: str, now: float) -> None:
        """Note that a launcher does not answer; give it up when that lasts and no server of it is left."""
        if self._on_broker(entry):
            entry.answered_at = now
        self._warn_once(f"{entry.name}: {words}\nTried again meanwhile; servers that are there go on.")
        entry.replace_at = now + FIRST_PAUSE_S
        if now - entry.answered_at > LAUNCHER_TIMEOUT_S:
            entry.given_up = words

    def _tell_waiting(self, entry: Entry, now: float) -> None:
        """Say why servers wait in a queue, when that takes long or its reason changes."""
        waiting = [
            server.health.reason for server in entry.servers.values() if server.health.state == "waiting"
        ]
        if not waiting or now - self._began < LATE_S or not any(waiting):
            return
        reasons = ", ".join(sorted({reason for reason in waiting if reason}))
        told = f"{len(waiting)} of {entry.wanted} servers wait: {reasons}"
        if told != entry.reported_waiting:
            entry.reported_waiting = told
            _log.warning("%s: %s", entry.name, told)

    def _tell_starting(self, entry: Entry, now: float) -> None:
        """Say what is waited for when servers run, and the first one is not on the broker soon."""
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
        began = (
            f"{entry.name}: no server is on {entry.launcher.specification.broker} yet, {len(late)} started; "
            f"each has {entry.options.start_timeout:g} s for that"
        )
        if lines:
            began += f"; {self._needed(entry)}. They print:"
        _log.warning("%s", "\n".join([began, *dict.fromkeys(lines[-SHOWN_LINES:])]))

    def _needed(self, entry: Entry) -> str:
        """Say what servers need to come to the broker."""
        needed = "servers need a way to this address, see the options broker_host and start_timeout"
        username, file = entry.launcher.specification.username, entry.options.credentials
        if username is None or self.access.servers:
            return needed
        account = (
            f"with the account {username} of {file}"
            if file is not None
            else f"with the account of this process, {username}; the option credentials names their own, "
            "such as the file server.env of `swarmwright broker --init`"
        )
        return f"{needed}, and the rights of a server there: they log in {account}"

    def _start(self, entry: Entry, count: int) -> None:
        """Start servers. Raises LauncherError."""
        # Processes of this machine keep their ids, of which the pool was told.
        free = [server for server in self._reserved[entry.name] if server not in entry.servers]
        ids = free[:count] if entry.launcher.is_here else [self._new_id() for _ in range(count)]
        entry.launcher.start(ids)
        now = time.monotonic()
        entry.servers |= {server: LaunchedServer(now) for server in ids}

    def _new_id(self) -> int:
        self._next += 1
        return self._next

    def _on_broker(self, entry: Entry) -> bool:
        return not self._present.isdisjoint(entry.servers)

    def _report_coming(self) -> None:
        """Tell the pool how many servers may still come."""
        supervision = self._supervision
        if supervision is not None:
            coming = [
                server
                for entry in self._entries
                if entry.given_up is None
                for server in range(max(0, entry.wanted - len(self._present & set(entry.servers))))
            ]
            supervision.starting(len(coming))

    def _warn_once(self, text: str) -> None:
        if text not in self._told:
            self._told.add(text)
            _log.warning("%s", text)
