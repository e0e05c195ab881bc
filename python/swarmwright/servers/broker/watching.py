"""The state of a broker's servers and tools, collected from their messages."""

import time
from collections.abc import Callable, Collection, Generator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from swarmwright import _engine
from swarmwright.servers.broker.credentials import prepare

SILENCE_S = 1.0
"""Seconds of silence after which a server with work counts as blocking."""
STALE_S = 2.5
"""Seconds after which a tool's status is stale; tools send it every second while they evaluate."""
FORGET_S = 30.0
"""Seconds of silence after which a tool is considered killed and dropped."""
MOST_SERVERS = 10_000
"""Largest number of servers that are kept; announcements of others are dropped."""
MOST_TOOLS = 200
"""Tools that are kept, likewise."""
_MOST_CHARACTERS = 300
"""Of a text in an announcement; announcements have up to 1 MiB, and peers may be hostile."""
_MOST_SIMULATIONS = 100

Json = dict[str, Any]


@dataclass
class _Tool:
    status: Json
    heard: float


@dataclass(frozen=True)
class ServerRow:
    """The state of one server."""

    server: int
    state: str | None
    """ready, busy, lost; None for a server of the D6.1 profile, which does not report it."""
    simulations: Sequence[str]
    tool: str | None
    """The tool that has reserved it."""
    presence: Json | None = None
    """Its presence message."""
    doing: Sequence[Json] = ()
    """Its work as in status messages, each with the waiting `tool`; longest silence first."""
    use: Json = field(default_factory=dict)
    """Measurements of the tool that uses it: mode, speed, failures, reason, benched."""

    @property
    def silent(self) -> float:
        """Seconds since its last useful message while a tool waits for it; otherwise 0."""
        return max((float(work["silent"]) for work in self.doing), default=0.0)

    def record(self) -> Json:
        """Return all fields as plain values."""
        return {
            "server": self.server,
            "state": self.state,
            "simulations": list(self.simulations),
            "tool": self.tool,
            "doing": list(self.doing),
            **{key: self.use.get(key) for key in ("mode", "speed", "failures", "reason", "benched")},
        }


@dataclass(frozen=True)
class ToolRow:
    """One active optimization tool."""

    status: Json
    """Its last status message, which describes what it waits for."""
    heard: float
    """Seconds since the status message arrived."""

    @property
    def waits_for(self) -> str | None:
        """What the tool waits for, as text; None while nothing blocks."""
        if self.heard > STALE_S:
            return f"no message for {self.heard:.0f} s: it is computing, stopped or killed"
        alone = self.status.get("no_server")
        if alone:
            return f"waiting for a server for {alone['seconds']:.1f} s ({alone['found']})"
        first = next(iter(self.status["waiting_for"]), None)
        return str(first["words"]) if first and first["silent"] >= SILENCE_S else None


@dataclass(frozen=True)
class View:
    """A snapshot of servers and tools."""

    servers: Sequence[ServerRow]
    tools: Sequence[ToolRow]
    broker_lost: str | None
    """Why there is no connection to the broker; None while there is one."""

    abandoned: Sequence[ServerRow] = ()
    """Servers reserved for a tool that has ended or has never sent its status."""
    gone: Collection[str] = ()
    """Names of tools that have ended."""

    @property
    def blocking(self) -> ServerRow | None:
        """The blocking server that has been silent for the longest time; None if there is none."""
        silent = [server for server in self.servers if server.silent >= SILENCE_S]
        return max(silent, key=lambda server: server.silent, default=None)

    def record(self) -> Json:
        """Return all fields as plain values."""
        blocking = self.blocking
        return {
            "servers": [server.record() for server in self.servers],
            "tools": [
                {**tool.status, "heard": tool.heard, "waits_for": tool.waits_for} for tool in self.tools
            ],
            "blocking": None
            if blocking is None
            else {
                "server": blocking.server,
                "silent": blocking.silent,
                "words": describe_owed_message(blocking),
            },
            "abandoned": [server.server for server in self.abandoned],
            "broker_lost": self.broker_lost,
        }


def describe_owed_message(server: ServerRow) -> str:
    """Describe the message that a server with work owes."""
    return str(max(server.doing, key=lambda work: float(work["silent"]))["words"])


def describe_work(server: ServerRow) -> str:
    """Return the current work of a server: 'block of 12', 'episode, step 7'; '-' for none."""
    if not server.doing:
        return "-"
    work = server.doing[0]
    activity = "episode" if work["kind"] == "episode" else f"{work['kind']} of {work['evaluations']}"
    if work.get("step") is not None:
        activity += f", step {work['step']}"
    if work.get("agent") is not None:
        activity += f", agent {work['agent']}"
    more = len(server.doing) - 1
    return f"{activity} (+{more})" if more else activity


def describe_abandoned(server: ServerRow, view: View) -> str:
    """Return a message on a server that is reserved for a tool that has probably ended."""
    if server.tool in view.gone:
        why, free = "has ended", "it becomes free"
    else:
        why, free = "sends no status", "if that has ended, it becomes free"
    return (
        f"server {server.server} is still reserved for {server.tool}, which {why}; {free} after its current "
        "work, at the latest after its --step-timeout (default 60 s)"
    )


def _shorten_presence(presence: Json) -> Json:
    """Return the displayed part of a presence, since capabilities may be of any size."""
    shown = {key: value for key, value in presence.items() if key not in {"capabilities", "simulations"}}
    return {**_shorten(shown), "simulations": _shorten(presence["simulations"][:_MOST_SIMULATIONS])}


def _shorten(value: Any) -> Any:  # noqa: ANN401 - JSON
    """Return a value with its texts cut."""
    if isinstance(value, dict):
        return {key: _shorten(entry) for key, entry in value.items()}
    if isinstance(value, list):
        return [_shorten(entry) for entry in value]
    return value[:_MOST_CHARACTERS] if isinstance(value, str) else value


class Watch:
    """Collector of peers' announcements, independent of the connection.

    clock: returns seconds, from any origin.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._presences: dict[int, Json] = {}
        self._tools: dict[str, _Tool] = {}
        self._broker_lost: str | None = None
        self._gone: set[str] = set()
        self._since = clock()

    def update(self, news: Mapping[str, Any]) -> None:
        """Process one event of `_engine.Watcher.poll`."""
        if "presence" in news:
            server = news["presence"]["server"]
            if server in self._presences or len(self._presences) < MOST_SERVERS:
                self._presences[server] = _shorten_presence(news["presence"])
        elif "left" in news:
            self._presences.pop(news["left"], None)
        elif "status" in news and news["status"]["state"] == "left":
            self._tools.pop(news["token"], None)
            self._gone.add(_shorten(news["status"]["tool"]))
            if len(self._gone) > MOST_SERVERS:
                self._gone &= {presence.get("tool") for presence in self._presences.values()}
        elif "status" in news:
            if news["token"] in self._tools or len(self._tools) < MOST_TOOLS:
                status = _shorten(news["status"])
                self._tools[news["token"]] = _Tool(status, self._clock())
                self._gone.discard(status["tool"])
        elif "broker" in news:
            self._broker_lost = news["reason"] if news["broker"] == "lost" else None
            if self._broker_lost is None:
                # Peers may have left unnoticed; present ones have retained announcements.
                self._presences.clear()
                self._since = self._clock()

    def view(self) -> View:
        """Return the current state."""
        now = self._clock()
        for token in [token for token, tool in self._tools.items() if now - tool.heard > FORGET_S]:
            del self._tools[token]
        tools = sorted(
            (ToolRow(tool.status, now - tool.heard) for tool in self._tools.values()),
            key=lambda tool: str(tool.status["tool"]),
        )
        doing, use = _group_by_server([tool for tool in tools if tool.heard <= STALE_S])
        rows = []
        for server in sorted({*self._presences, *doing, *use}):
            presence = self._presences.get(server)
            works = sorted(doing.get(server, ()), key=lambda work: -float(work["silent"]))
            holder = works[0]["tool"] if works else None
            rows.append(
                ServerRow(
                    server=server,
                    state=presence["state"] if presence else None,
                    simulations=presence["simulations"] if presence else (),
                    tool=(presence or {}).get("tool") or holder,
                    presence=presence,
                    doing=works,
                    use=use.get(server, {}),
                )
            )
        self._gone &= {row.tool for row in rows if row.tool is not None}
        return View(rows, tools, self._broker_lost, self._find_abandoned(rows), frozenset(self._gone))

    def _find_abandoned(self, rows: Sequence[ServerRow]) -> list[ServerRow]:
        listened = self._clock() - self._since > STALE_S
        active = {tool.status["tool"] for tool in self._tools.values()}
        orphaned = (
            row for row in rows if row.state == "busy" and row.tool is not None and row.tool not in active
        )
        return [row for row in orphaned if row.tool in self._gone or listened]


def _group_by_server(tools: Sequence[ToolRow]) -> tuple[dict[int, list[Json]], dict[int, Json]]:
    """Return the work and the use of each server; the tool that gave it work takes precedence."""
    doing: dict[int, list[Json]] = {}
    use: dict[int, Json] = {}
    for tool in tools:
        status = tool.status
        for work in status["waiting_for"]:
            doing.setdefault(work["server"], []).append({**work, "tool": status["tool"]})
        working = {work["server"] for work in status["waiting_for"]}
        for entry in status["servers"]:
            if entry["server"] in working or entry["server"] not in use:
                use[entry["server"]] = entry
    return doing, use


def watch_broker(broker: str, *, prefix: str = "", every: float = 1.0) -> Generator[View, None, None]:
    """Connect to a broker and yield its state every `every` seconds, forever.

    Raises the engine's errors: no broker, refused, an invalid prefix.
    """
    prepare(broker)
    watcher = _engine.Watcher(broker, prefix=prefix)
    try:
        watch = Watch()
        first = True
        while True:
            # The first view is early: retained messages arrive at once.
            until = time.monotonic() + (min(every, 0.5) if first else every)
            first = False
            while (remaining := until - time.monotonic()) > 0:
                for news in watcher.poll(remaining):
                    watch.update(news)
            yield watch.view()
    finally:
        watcher.close()
