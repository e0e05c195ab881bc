"""How a run went: its attempts and events, what servers did, and why attempts failed."""

import sqlite3
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping
from typing import Any

from swarmwright.common.formatting import counted
from swarmwright.common.message_kinds import kind_of
from swarmwright.runs.store.pieces import Begin
from swarmwright.servers.attempts import NOT_FINISHED, OVERTAKEN, SAME_END_S, is_server_end
from swarmwright.servers.rows import FailureReason, ServerShare, journal_line

_SHARES = """
WITH numbers AS (
    SELECT server, iif(error IS NULL, candidates * episodes, 0) AS evaluations, started,
        started + seconds AS ended, coalesce(error LIKE :overtaken, 0) AS slower,
        coalesce(error NOT LIKE :overtaken, 0) AS failed, mode <> 'stepwise' AS is_together
    FROM attempt WHERE server >= 0 AND rowid <= :last),
one AS (
    SELECT *, max(ended) OVER (
        PARTITION BY server ORDER BY started ROWS BETWEEN UNBOUNDED PRECEDING AND 1 PRECEDING) AS before
    FROM numbers)
SELECT server, sum(evaluations), sum(failed),
    sum(max(0.0, ended - max(started, coalesce(before, started)))), sum(slower), max(failed AND is_together)
FROM one GROUP BY server ORDER BY server
"""
"""What each server did; attempts that overlap count once as time: what is before the end of an earlier one is
left out. They are sorted for that: as numbers, without the texts of errors."""
_FAILURES = """
WITH failed AS (
    SELECT rowid AS number, session, server, started + seconds AS ended,
        iif(substr(error, 1, length(:prefix)) = :prefix, substr(error, length(:prefix) + 1), error) AS reason
    FROM attempt WHERE error NOT LIKE :overtaken AND rowid <= :last),
one AS (
    SELECT *, ended - lag(ended) OVER (PARTITION BY session, server, reason ORDER BY ended) AS pause
    FROM failed)
SELECT reason, server, count(*), sum(coalesce(pause <= :same, 0))
FROM one GROUP BY server, reason ORDER BY server, min(number)
"""
"""Why attempts failed on each server, how many, and how many of these ended together with another one."""
_OVERTAKEN = """
SELECT server, count(*) FROM attempt WHERE session = ? AND error LIKE ?
GROUP BY server ORDER BY count(*) DESC, server
"""
_NAMED = 3
"""Servers that incidents name."""
_LINES = 1000
"""Lines that are read at once."""


def lines(begin: Begin, kind: type[Any], table: str, last: int) -> Iterator[Any]:
    """Yield the lines of a table up to the row `last`, in order."""
    after, found = 0, _LINES
    while found == _LINES:
        with begin() as connection:
            cursor = connection.execute(
                f"SELECT rowid, * FROM {table} WHERE rowid > ? AND rowid <= ? ORDER BY rowid LIMIT ?",  # noqa: S608 - our own names
                (after, last, _LINES),
            )
            names = [column[0] for column in cursor.description][1:]
            some = []
            for number, *row in cursor:
                some.append(journal_line(kind, dict(zip(names, row, strict=True))))
                after = number
        yield from some
        found = len(some)


def shares(connection: sqlite3.Connection, last: int) -> list[ServerShare]:
    """Return what each server did in the attempts up to the row `last`, by its number."""
    lost: Counter[int] = Counter()
    for _, server, _, others in _failed(connection, last):
        lost[server] += others
    return [
        ServerShare(
            int(server),
            int(evaluations),
            int(failed) - lost[server],
            seconds,
            int(slower),
            bool(within),
            lost[server],
        )
        for server, evaluations, failed, seconds, slower, within in connection.execute(
            _SHARES, {"overtaken": OVERTAKEN, "last": last}
        )
    ]


class Evaluators:
    """Which server evaluated which episode of which candidate.

    attempts: that succeeded: generation, first candidate, candidates, first episode, episodes, server.
    """

    def __init__(self, attempts: Iterable[tuple[int, int, int, int, int, int]]) -> None:
        self._attempts: dict[int, list[tuple[range, range, int]]] = {}
        for generation, candidate, candidates, episode, episodes, server in attempts:
            block = range(candidate, candidate + candidates), range(episode, episode + episodes), server
            self._attempts.setdefault(generation, []).append(block)

    def of(self, generation: int, candidate: int, episode: int) -> int | None:
        """Return the server of an evaluation; None where no server evaluated it."""
        for candidates, episodes, server in self._attempts.get(generation, ()):
            if candidate in candidates and episode in episodes:
                return server
        return None


def evaluators(connection: sqlite3.Connection, generations: Collection[int], last: int) -> Evaluators:
    """Return the servers of some generations, of the attempts up to the row `last`."""
    marks = ", ".join("?" * len(generations))
    return Evaluators(
        connection.execute(
            "SELECT generation, candidate, candidates, episode, episodes, server FROM attempt "  # noqa: S608 - marks alone
            f"WHERE error IS NULL AND server >= 0 AND rowid <= ? AND generation IN ({marks})",
            (last, *generations),
        )
    )


def incidents(connection: sqlite3.Connection, session: int, counts: Mapping[str, int]) -> str:
    """Return the incidents of a session in words; of backups, with the servers that were slower."""
    texts = {name: f"{name.replace('_', ' ')}: {count}" for name, count in counts.items()}
    if "backups" in texts:
        servers = connection.execute(_OVERTAKEN, (session, OVERTAKEN)).fetchall()
        slower = [f"{counted(count, 'attempt')} of server {server}" for server, count in servers]
        if slower:
            more = " and others" * (len(slower) > _NAMED)
            texts["backups"] += (
                " (work of slow servers that was repeated on others, and the first result counted; slower "
                f"were {', '.join(slower[:_NAMED])}{more})"
            )
    return ", ".join(texts.values())


def failures(connection: sqlite3.Connection, last: int) -> list[FailureReason]:
    """Return why attempts up to the row `last` failed, the most frequent reason first."""
    found: dict[str, FailureReason] = {}
    for reason, server, count, lost in _failed(connection, last):
        one = found.get(kind_of(reason)) or FailureReason(reason, 0, {}, 0)
        servers = {**one.servers, server: one.servers.get(server, 0) + count}
        found[kind_of(reason)] = FailureReason(one.reason, one.attempts + count, servers, one.lost + lost)
    return sorted(found.values(), key=lambda one: -one.attempts)


def _failed(connection: sqlite3.Connection, last: int) -> Iterator[tuple[str, int, int, int]]:
    """Yield reasons, a server, how many attempts failed on it, and how many others were lost with it."""
    named = {"overtaken": OVERTAKEN, "last": last, "prefix": NOT_FINISHED, "same": SAME_END_S}
    for reason, server, count, together in connection.execute(_FAILURES, named):
        lost = int(together) if is_server_end(reason) else 0
        yield reason, int(server), int(count) - lost, lost
