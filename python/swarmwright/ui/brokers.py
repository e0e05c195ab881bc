"""Brokers whose servers are shown: one connection for each, shared by all windows that look."""

import json
import logging
import threading
import time
from collections.abc import Mapping
from contextlib import closing
from typing import Any

from swarmwright import InputError, SwarmwrightError
from swarmwright.common.errors import engine_errors
from swarmwright.experiment.broker_address import broker_problem, prefix_problem
from swarmwright.servers.broker.credentials import location_of
from swarmwright.servers.broker.watching import (
    ServerRow,
    ToolRow,
    View,
    describe_abandoned,
    describe_owed_message,
    describe_work,
    watch_broker,
)
from swarmwright.ui.index import as_values, finite, significant

EVERY_S = 1.0
UNWATCHED_S = 10.0
"""After which the connection is closed, when nobody has looked."""
RETRY_S = 3.0
"""Between two attempts to reach a broker."""
FIRST_S = 1.0
"""That the first who looks waits for what the broker says."""
DISCONNECT_S = 1.0
"""That the engine waits for the broker to take leave."""
CLOSE_S = EVERY_S + DISCONNECT_S
"""After which a watch that was told to close has done so, unless it is just connecting."""
MOST_BROKERS = 8
"""With that of the start."""
MOST_ROWS = 500
"""Servers, and tools, that are listed; the others are counted."""
MOST_MESSAGES = 5


class BrokerWatch:
    """What the servers and tools on a broker do, as long as somebody looks.

    Args:
        url: of the broker. The account comes from the environment, as for all commands.
        prefix: of its topics.
    """

    def __init__(self, url: str, prefix: str) -> None:
        self.url = url
        self.prefix = prefix
        self._lock = threading.Lock()
        self._thread: threading.Thread | None = None
        self._closed = threading.Event()
        self._is_answered = threading.Event()
        self._asked = 0.0
        self._count: int | None = None
        self._set_state("connecting", "")
        self._last: dict[int, dict[str, Any]] = {}

    def look(self) -> bytes:
        """Return the newest state as JSON, built once for all who look."""
        self._renew()
        self._is_answered.wait(FIRST_S)
        return self._answer

    def count(self) -> int | None:
        """Return the number of servers that are not lost; None where that is not known yet."""
        self._renew()
        return self._count

    @property
    def is_connected(self) -> bool:
        """Whether there is a connection, or an attempt at one."""
        thread = self._thread
        return thread is not None and thread.is_alive()

    def begin_closing(self) -> None:
        """Disconnect soon."""
        self._closed.set()

    def close(self, seconds: float = CLOSE_S) -> None:
        """Disconnect; wait at most some seconds for it, since an attempt to connect may take longer."""
        self.begin_closing()
        thread = self._thread
        if thread is not None:
            thread.join(max(seconds, 0.0))

    def _renew(self) -> None:
        with self._lock:
            self._asked = time.monotonic()
            if self._thread is None and not self._closed.is_set():
                self._is_answered.clear()
                self._set_state("connecting", "")
                self._thread = threading.Thread(target=self._watch, name="broker", daemon=True)
                self._thread.start()

    def _is_wanted(self) -> bool:
        return not self._closed.is_set() and time.monotonic() - self._asked < UNWATCHED_S

    def _watch(self) -> None:
        while True:
            try:
                self._follow()
            except SwarmwrightError as error:
                self._fail(str(error))
            except Exception as error:  # a message that nobody has thought of
                logging.getLogger("swarmwright").exception("the servers on %s cannot be shown", self.url)
                self._fail(f"The state of the broker cannot be shown: {error!r}")
            with self._lock:
                if not self._is_wanted():
                    self._thread = None
                    return

    def _fail(self, message: str) -> None:
        self._set_state("away", message)
        self._is_answered.set()
        self._closed.wait(RETRY_S)

    def _follow(self) -> None:
        with engine_errors(), closing(watch_broker(self.url, prefix=self.prefix, every=EVERY_S)) as views:
            for view in views:
                self._remember(view)
                is_lost = view.broker_lost is not None
                self._count = None if is_lost else sum(server.state != "lost" for server in view.servers)
                self._answer = json.dumps(
                    {"broker": self.url, "prefix": self.prefix, **describe(view, self._last)}, allow_nan=False
                ).encode()
                self._is_answered.set()
                if not self._is_wanted():
                    return

    def _set_state(self, state: str, message: str) -> None:
        self._count = None
        self._answer = json.dumps(
            {
                "broker": self.url,
                "prefix": self.prefix,
                "state": state,
                "messages": [message] if message else [],
                "servers": [],
                "more_servers": 0,
                "tools": [],
                "more_tools": 0,
            }
        ).encode()

    def _remember(self, view: View) -> None:
        """Note what each server did last, since idle servers say nothing of it."""
        runs = {tool.status["tool"]: tool.status.get("run") for tool in view.tools}
        present = {server.server for server in view.servers}
        self._last = {server: last for server, last in self._last.items() if server in present}
        for server in view.servers:
            if server.tool is not None and (server.use or server.doing):
                self._last[server.server] = {
                    "run": runs.get(server.tool) or server.tool,
                    "speed": finite(server.use.get("speed")),
                    "at": time.time(),
                }


class Brokers:
    """The brokers of a window: that of its start, and those that were added on its page.

    Others are refused: a connection has the account of the environment, which only its owner may send to
    another broker.

    Args:
        url: of the first broker.
        prefix: of its topics.
    """

    def __init__(self, url: str, prefix: str = "") -> None:
        self._watches = {(url, prefix): BrokerWatch(url, prefix)}
        self._lock = threading.Lock()

    def list_addresses(self) -> list[tuple[str, str]]:
        """Return the address and the prefix of each, that of the start first."""
        with self._lock:
            return list(self._watches)

    def add(self, url: str, prefix: str) -> None:
        """Add a broker. Raises InputError for an address or a prefix that is none, and for too many."""
        problem = broker_problem(url)
        if problem is not None:
            raise InputError(f"broker: the address {problem}")
        problem = prefix_problem(prefix)
        if problem is not None:
            raise InputError(f"prefix: {problem}")
        with self._lock:
            if (url, prefix) in self._watches:
                return
            if len(self._watches) >= MOST_BROKERS:
                # The first one is that of the start.
                idle = [key for key in list(self._watches)[1:] if not self._watches[key].is_connected]
                if not idle:
                    raise InputError(
                        f"broker: at most {MOST_BROKERS} are watched at once; close the page of another, and "
                        f"try again in {UNWATCHED_S:.0f} s"
                    )
                del self._watches[idle[0]]
            self._watches[url, prefix] = BrokerWatch(url, prefix)

    def find(self, url: str, prefix: str) -> BrokerWatch:
        """Return the watch of a broker; for an empty address, of the first. Raises InputError for others."""
        with self._lock:
            watch = self._watches.get((url, prefix)) if url else next(iter(self._watches.values()))
        if watch is None:
            raise InputError("broker: this window does not show that broker; enter its address to connect")
        return watch

    def require(self, url: str) -> None:
        """Raise InputError for a broker that is not of this window, whatever the prefix."""
        endpoints = list_endpoints(url)
        if endpoints not in [list_endpoints(address) for address, _ in self.list_addresses()]:
            raise InputError(
                "broker: this window does not show the broker that the run names, and sends it no account; "
                "enter its address on the page Servers if you trust it"
            )

    def count_servers(self, url: str, prefix: str) -> int | None:
        """Return how many servers a broker has; None where that is not known yet.

        Of others than those of the window it never is: the experiment that names the broker may come from
        somebody who wants to know the account.
        """
        endpoints = list_endpoints(url)
        with self._lock:
            watches = list(self._watches.values())
        for watch in watches:
            if watch.prefix == prefix and list_endpoints(watch.url) == endpoints:
                return watch.count()
        return None

    def close(self) -> None:
        """Disconnect from all, at once."""
        with self._lock:
            watches = list(self._watches.values())
        for watch in watches:
            watch.begin_closing()
        end = time.monotonic() + CLOSE_S
        for watch in watches:
            watch.close(end - time.monotonic())


def list_endpoints(urls: str) -> list[tuple[str, str]]:
    """Return scheme and location of a broker's address, or of several: `mqtt://lab` is `mqtt://lab:1883`.

    The scheme belongs to it: an account that goes to a broker by TLS must not go there without.
    """
    return [(url.strip().partition("://")[0].lower(), location_of(url)) for url in urls.split(",")]


def describe(view: View, last: Mapping[int, Mapping[str, Any]]) -> dict[str, Any]:
    """Return what is shown of the state of a broker.

    last: what each server did last.
    """
    messages = []
    if view.broker_lost is not None:
        messages.append(f"The broker is lost ({view.broker_lost}); trying again.")
    elif view.blocking is not None:
        messages.append(f"Blocking: {describe_owed_message(view.blocking)}.")
    messages += [f"{tool.status['tool']}: {tool.waits_for}." for tool in view.tools if tool.waits_for]
    messages += [f"{describe_abandoned(server, view)}." for server in view.abandoned]
    runs = {tool.status["tool"]: tool.status.get("run") for tool in view.tools}
    return {
        "state": "connected" if view.broker_lost is None else "away",
        "messages": [message[:1].upper() + message[1:] for message in messages[:MOST_MESSAGES]],
        "servers": [
            describe_server(server, runs, last.get(server.server)) for server in view.servers[:MOST_ROWS]
        ],
        "more_servers": max(len(view.servers) - MOST_ROWS, 0),
        "tools": [describe_tool(tool) for tool in view.tools[:MOST_ROWS]],
        "more_tools": max(len(view.tools) - MOST_ROWS, 0),
    }


def describe_server(
    server: ServerRow, runs: Mapping[str, str | None], last: Mapping[str, Any] | None
) -> dict[str, Any]:
    """Return the row of a server. runs: the run of each tool."""
    presence = server.presence or {}
    values: dict[str, Any] = as_values(
        {
            # Ids pass the largest whole number of JavaScript.
            "server": str(server.server),
            "state": server.state or "known to a run",
            "simulations": list(server.simulations),
            "tool": server.tool,
            "run": runs.get(server.tool) if server.tool is not None else None,
            "work": describe_work(server) if server.doing else None,
            "evaluations": sum(int(work["evaluations"]) for work in server.doing),
            "silent": significant(server.silent) if server.doing else None,
            "speed": significant(server.use.get("speed")),
            "failures": server.use.get("failures", 0),
            "reason": server.use.get("reason"),
            "paused": significant(server.use.get("benched")),
            "host": presence.get("host"),
            "process": presence.get("pid"),
            "since": presence.get("since"),
            "last": None if last is None else dict(last),
        }
    )
    return values


def describe_tool(tool: ToolRow) -> dict[str, Any]:
    """Return the row of an optimization tool."""
    status = tool.status
    names = ("tool", "run", "simulation", "state", "generation", "generations", "done", "total")
    values: dict[str, Any] = as_values({name: status.get(name) for name in names})
    return {**values, "waits_for": tool.waits_for, "servers": len(status["servers"])}
