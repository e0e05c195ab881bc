"""Warnings of a pool, for people: the first of each kind, then the number of repetitions."""

import re
import time
from typing import TYPE_CHECKING

from swarmwright.cli._output import complain
from swarmwright.core.untrusted import one_line

if TYPE_CHECKING:
    from swarmwright.evaluation.reports import Report

PAUSE_S = 10.0
"""Seconds between two counts of one kind."""
_NUMBER = re.compile(r"\d+(\.\d+)?")
_SERVER = re.compile(r"\bserver (\d+)")
NAMED = 10
"""Servers that a count names, at most."""
_COUNT = re.compile(r"and \d+ more alike: ")
"""How those lines begin that count already, the pool's and those below."""


class Warnings:
    """Shows warnings on standard error, where lines that differ in numbers alone are of one kind."""

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
        if _COUNT.match(text):
            _show(text)
            return
        key = _NUMBER.sub("0", text)
        kind = self._kinds.get(key)
        if kind is None:
            self._kinds[key] = _Kind(text)
            _show(text)
            return
        kind.add(text)
        if time.monotonic() - kind.told >= PAUSE_S:
            kind.count()

    def close(self) -> None:
        """Print the counts that have not been printed."""
        for kind in self._kinds.values():
            kind.count()


class _Kind:
    def __init__(self, text: str) -> None:
        self.text = text
        self.more = 0
        self.told = time.monotonic()
        self._servers: dict[str, None] = {}

    def add(self, text: str) -> None:
        self.more += 1
        self._servers.update(dict.fromkeys(_SERVER.findall(text)))

    def count(self) -> None:
        if self.more:
            others = [server for server in self._servers if server not in _SERVER.findall(self.text)]
            named = ", ".join(others[:NAMED]) + (", ..." if len(others) > NAMED else "")
            which = f" (server{'s' * (len(others) > 1)} {named})" if others else ""
            _show(f"and {self.more} more alike{which}: {self.text}")
        self.more, self.told = 0, time.monotonic()
        self._servers.clear()


def _show(text: str) -> None:
    complain(one_line(text))
