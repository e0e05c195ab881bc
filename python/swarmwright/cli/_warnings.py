"""Warnings of a pool, for people: the first of each kind, then the number of repetitions."""

import re
import time
from collections import Counter
from typing import TYPE_CHECKING

from swarmwright.cli._output import complain
from swarmwright.common.message_kinds import kind_of
from swarmwright.common.untrusted import one_line

if TYPE_CHECKING:
    from swarmwright.servers.evaluation.reports import Report

PAUSE_S = 10.0
"""Seconds until the first count of one kind; the pause before the next one is twice as long each time."""
_SERVER = re.compile(r"\bserver (\d+)")
NAMED = 10
"""Servers that a count names, at most."""
_COUNT = re.compile(r"(\d+) more warnings? of the same kind: ")
"""How the pool begins a line that counts repetitions."""


class Warnings:
    """Shows warnings on standard error: the first of each kind, then how many more on which servers."""

    def __init__(self) -> None:
        self._kinds: dict[str, _Kind] = {}

    def report(self, report: "Report") -> None:
        """Show what a pool told, see `_engine.Pool.listen`."""
        match report["event"]:
            case "warning":
                self._warn(str(report["message"]))
            case "broker_lost":
                self._warn(f"lost the broker ({report['reason']}); trying again")
            case "broker_back":
                self._warn("the broker is back")

    def _warn(self, text: str) -> None:
        counted = _COUNT.match(text)
        message, more = (text[counted.end() :], int(counted[1])) if counted else (text, 1)
        kind = self._kinds.get(kind_of(message))
        if kind is None:
            self._kinds[kind_of(message)] = _Kind(message)
            _show(text)
            return
        kind.add(message, more)
        if time.monotonic() - kind.told >= kind.pause:
            kind.count()

    def close(self) -> None:
        """Print the counts that have not been printed."""
        for kind in self._kinds.values():
            kind.count()


class _Kind:
    """Repetitions of a message since they were last counted, by the server that they name first."""

    def __init__(self, text: str) -> None:
        self.text = text
        self.pause = PAUSE_S
        self.told = time.monotonic()
        self._more = 0
        self._servers: Counter[int] = Counter()

    def add(self, text: str, more: int) -> None:
        self._more += more
        server = _SERVER.search(text)
        if server is not None:
            self._servers[int(server[1])] += more

    def count(self) -> None:
        if self._more:
            servers = [f"server {server}: {count}" for server, count in sorted(self._servers.items())]
            named = ", ".join(servers[:NAMED]) + ", ..." * (len(servers) > NAMED)
            text = _SERVER.sub("a server", self.text) if servers else self.text
            warnings = "warning" if self._more == 1 else "warnings"
            named = f" ({named})" if servers else ""
            _show(f"{self._more} more {warnings} of the same kind{named}: {text}")
            self.pause *= 2
        self._more, self.told = 0, time.monotonic()
        self._servers.clear()


def _show(text: str) -> None:
    complain(one_line(text))
