"""Supervision of launchers: starts and replaces servers, and gives up launchers that keep failing."""

import ipaddress
import logging
import math
import os
import secrets
import socket
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Any, Self, cast
from urllib.parse import urlsplit

from swarmwright import _engine
from swarmwright.common.errors import InputError, RunError, engine_errors
from swarmwright.common.formatting import format_amount
from swarmwright.common.processes import allow_more_open_files
from swarmwright.common.temporary import TemporaryFolder
from swarmwright.servers.broker.mosquitto import Account, format_access_rules
from swarmwright.servers.broker.private import create_account, start_private
from swarmwright.servers.evaluation.base import BudgetSpent
from swarmwright.servers.launchers import Health, Launcher, LauncherError, LauncherOptions
from swarmwright.servers.rows import ServerUse
from swarmwright.servers.supervision.output import MAX_KEPT_LINES, Output

WORK_S = 60.0
"""Seconds of work per server; more work starts another server."""


@dataclass(frozen=True)
class Load:
    """Work of a pool."""

    evaluations: int
    """Remaining evaluations of the run, as far as known."""
    at_once: int
    """Evaluations of a generation, which can run in parallel."""
    speed: float | None
    """Mean evaluations per second of one server; None before the first measurement."""
    busy: frozenset[int]
    """Servers that have work."""

    @classmethod
    def from_status(cls, status: Mapping[str, Any]) -> "Load":
        """Read the status that a pool publishes."""
        speeds = [
            status_of_server["speed"]
            for status_of_server in status.get("servers", ())
            if status_of_server.get("speed")
        ]
        total = status.get("total", 0)
        later = (
            max(0, status.get("generations", 0) - status["generation"] - 1) if "generation" in status else 0
        )
        return cls(
            max(0, total - status.get("done", 0)) + later * total,
            total,
            sum(speeds) / len(speeds) if speeds else None,
            frozenset(status_of_server["server"] for status_of_server in status.get("waiting_for", ())),
        )


def count_needed(load: Load, least: int, most: int) -> int:
    """Return how many servers the work can occupy, from `least` to `most`."""
    if load.speed is None:
        return least
    seconds = load.evaluations / load.speed
    return max(least, min(most, load.at_once, math.ceil(seconds / WORK_S)))


@dataclass
class Scaling:
    """Number of servers over time: grows at once, shrinks after `idle` seconds of lower need."""

    least: int
    most: int
    idle: float
    _history: deque[tuple[float, int]] = field(default_factory=deque)

    def choose_count(self, now: float, current: int, load: Load) -> int:
        """Return the new number of servers. now: monotonic seconds."""
        need = count_needed(load, self.least, self.most)
        self._history.append((now, need))
        # Keep the needs within the last `idle` seconds, and the entry before.
        while len(self._history) > 1 and self._history[1][0] <= now - self.idle:
            self._history.popleft()
        if need >= current or self._history[0][0] > now - self.idle:
            return max(need, current)
        return min(current, max(count for _, count in self._history))


SHORTEST_USE_S = 36.0
"""Use below which servers without a price are not reported: 0.01 hours."""


@dataclass
class LaunchedServer:
    """A started server."""

    since: float
    """When it was started or began to run, monotonic seconds."""
    health: Health = field(default_factory=lambda: Health("waiting"))
    was_ready: bool = False
    """Whether the server has been on the broker."""


@dataclass
class Entry:
    """A launcher and its servers. Times are monotonic seconds."""

    name: str
    launcher: Launcher
    options: LauncherOptions
    servers: dict[int, LaunchedServer] = field(default_factory=dict)
    """Running servers, by id."""
    target: int = 0
    """Intended number of servers."""
    failures: int = 0
    """Consecutive servers that ended before they reached the broker."""
    replace_at: float = 0.0
    """Earliest time to replace ended servers."""
    checked_at: float = 0.0
    """Time of the last health check."""
    answered_at: float = field(default_factory=time.monotonic)
    """Time when the launcher last answered or had a server on the broker."""
    failure: str | None = None
    """Why the launcher is no longer used; None while it is."""
    scaling: Scaling | None = None
    """Scaling with the work; None for a fixed number of servers."""
    seconds: float = 0.0
    """Total running time of all servers in this session."""
    earlier: ServerUse = field(default_factory=ServerUse)
    """Use of servers in earlier sessions of the run."""
    counted_at: float = 0.0
    """Time up to which `seconds` are counted."""
    is_spent: bool = False
    """Whether the budget is spent."""
    reported_waiting: str = ""
    """The last report about queued servers."""
    reported_starting: bool = False
    """Whether it was reported that no running server has reached the broker."""
    early_exits: list[str] = field(default_factory=list)
    """Messages of the last servers that ended before they reached the broker."""

    @property
    def use(self) -> ServerUse:
        """Use of its servers in this session so far."""
        return ServerUse(self.seconds, self.seconds / 3600 * (self.options.cost_per_hour or 0.0))

    @property
    def is_counted(self) -> bool:
        """Whether its use is reported: for remote servers and for servers with a price."""
        return not self.launcher.is_here or self.options.cost_per_hour is not None

    @property
    def is_notable(self) -> bool:
        """Whether its use exceeds 0.01 hours or has a price."""
        seconds = (self.earlier + self.use).seconds
        return self.options.cost_per_hour is not None or seconds >= SHORTEST_USE_S

    @property
    def usage_text(self) -> str:
        """Use of servers and their cost as text."""

        def format_use(use: ServerUse) -> str:
            cost = "" if self.options.cost_per_hour is None else f", cost {format_amount(use.cost)}"
            return f"{format_amount(use.seconds / 3600)} server hours{cost}"

        whole = f" (the whole run: {format_use(self.earlier + self.use)})" if self.earlier.seconds else ""
        return f"{self.name} {format_use(self.use)}{whole}"

    def count_use(self, now: float) -> None:
        """Count the time of running servers, and check the budget."""
        running = sum(server.health.state == "running" for server in self.servers.values())
        self.seconds += running * (now - self.counted_at)
        self.counted_at = now
        self.compare_with_budget()

    def compare_with_budget(self) -> None:
        """Check whether the budget is spent, including earlier sessions."""
        budget, cost = self.options.budget, self.earlier.cost + self.use.cost
        self.is_spent = self.is_spent or (budget is not None and cost >= budget)

    @property
    def budget_message(self) -> str:
        """Message that earlier sessions of the run have spent the budget."""
        return (
            f"the budget of {self.name}, {self.options.budget:g}, is spent: earlier sessions of this run "
            f"cost {format_amount(self.earlier.cost)}"
        )

    @contextmanager
    def prefix_errors(self) -> Iterator[None]:
        """Prefix errors of the launcher with its name within this block."""
        try:
            yield
        except LauncherError as error:
            raise LauncherError(f"{self.name}: {error}") from error


_CERTIFICATE_DAYS = 366
"""Validity of the certificate, which serves one run."""
TOOL = "tool"


@dataclass(frozen=True)
class Credentials:
    """Credentials of a client for a broker; None for what the broker does not require."""

    username: str | None = None
    password: str | None = field(default=None, repr=False)
    authority: str | None = field(default=None, repr=False)
    """PEM text."""
    certificate: str | None = field(default=None, repr=False)
    """The client's certificate as PEM text."""
    key: str | None = field(default=None, repr=False)
    """The client's private key as PEM text."""

    @classmethod
    def from_environment(cls, variables: "os._Environ[str] | dict[str, str]", label: str) -> Self:
        """Read the credentials in Swarmwright's variables. Raises InputError that begins with `what`."""

        def text(name: str) -> str | None:
            file = variables.get(name)
            if not file:
                return None
            try:
                return Path(file).read_text(encoding="utf-8")
            except (OSError, UnicodeDecodeError) as error:
                raise InputError(f"{label}: {name}: {file} cannot be read: {error}") from error

        password = variables.get("SWARMWRIGHT_PASSWORD") or None
        if password is None:
            lines = (text("SWARMWRIGHT_PASSWORD_FILE") or "").splitlines()
            password = lines[0] if lines else None
        username = variables.get("SWARMWRIGHT_USERNAME") or None
        return cls(
            username,
            password,
            text("SWARMWRIGHT_CA_FILE"),
            text("SWARMWRIGHT_CERTIFICATE_FILE"),
            text("SWARMWRIGHT_KEY_FILE"),
        )


@dataclass(frozen=True)
class Access:
    """A broker's address and credentials."""

    address: str
    """The address as seen from this process."""
    tool: Credentials | None = None
    """Credentials of this process; None to find them in the environment."""
    servers: dict[str, Credentials] = field(default_factory=dict)
    """Credentials of servers, by account."""
    authority_file: str | None = None

    def address_for(self, host: str | None) -> str:
        """Return the address for servers that reach this machine as `host`."""
        if host is None:
            return self.address
        parts = urlsplit(self.address)
        location = f"[{host}]" if ":" in host else host
        return f"{parts.scheme}://{location}:{parts.port}"

    @property
    def account(self) -> tuple[str, str, str] | None:
        """User name, password and CA file of this process; None to find them in the environment."""
        if self.tool is None:
            return None
        return self.tool.username or "", self.tool.password or "", self.authority_file or ""


def find_own_address() -> str:
    """Return the address of this machine's default route, or its host name without one."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(("192.0.2.1", 9))  # documentation address (RFC 5737); nothing is sent
            return str(probe.getsockname()[0])
        except OSError:
            return socket.gethostname()


def is_loopback(host: str) -> bool:
    """Whether a host name or address refers to the local machine."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def start_embedded(
    stack: ExitStack, hosts: Sequence[str], accounts: Sequence[str], *, port: int | None, prefix: str
) -> Access:
    """Start the embedded broker, which ends with the stack.

    Args:
        stack: ends it.
        hosts: names by which servers reach this machine.
        accounts: a name for each launcher.
        port: None for any.
        prefix: prefix of all topics.

    Raises:
        RunError: the port is taken.
    """
    if all(map(is_loopback, hosts)):
        address, account = start_private(stack, port or 0)
        credentials = Credentials(account.username, account.password)
        return Access(address, servers=dict.fromkeys(accounts, credentials))
    return _start_with_accounts(stack, hosts, accounts, port=port, prefix=prefix)


def _start_with_accounts(
    stack: ExitStack, hosts: Sequence[str], accounts: Sequence[str], *, port: int | None, prefix: str
) -> Access:
    allow_more_open_files()
    folder = stack.enter_context(TemporaryFolder("broker"))
    names = list(dict.fromkeys([*hosts, "localhost", "127.0.0.1", "::1"]))
    with engine_errors("servers: broker_host: "):
        authority, _, certificate, key = _engine.certificates(names, _CERTIFICATE_DAYS)
    passwords = {name: create_account().password for name in (TOOL, *accounts)}
    root = prefix.removesuffix("/")
    rules = [Account(TOOL, "tool", root), *(Account(name, "server", root) for name in accounts)]
    files = {
        "access": format_access_rules(rules),
        "ca.pem": authority,
        "broker.pem": certificate,
        "broker-key.pem": key,
    }
    for name, text in files.items():
        (folder / name).touch(0o600)
        (folder / name).write_text(text, encoding="utf-8")
    with engine_errors():
        broker = _engine.Broker(
            "::" if any(":" in host for host in hosts) else "0.0.0.0",  # noqa: S104 - with TLS and passwords
            port or 0,
            accounts=list(passwords.items()),
            access=str(folder / "access"),
            certificate=str(folder / "broker.pem"),
            key=str(folder / "broker-key.pem"),
        )
    stack.callback(broker.stop)
    credentials = {name: Credentials(name, password, authority) for name, password in passwords.items()}
    tool = credentials.pop(TOOL)
    return Access(f"mqtts://127.0.0.1:{broker.port}", tool, credentials, str(folder / "ca.pem"))


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
