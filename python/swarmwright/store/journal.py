"""How a run went: its attempts and events, what servers did, and why attempts failed."""

import sqlite3
from collections.abc import Iterator, Mapping
from typing import Any

from swarmwright.core.attempts import OVERTAKEN
from swarmwright.core.formatting import counted
from swarmwright.core.message_kinds import kind_of
from swarmwright.store.pieces import Begin
from swarmwright.store.rows import FailureReason, ServerShare, journal_line

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
SELECT error, server, count(*) FROM attempt WHERE error NOT LIKE :overtaken AND rowid <= :last
GROUP BY server, error ORDER BY server, min(rowid)
"""
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
    return [
        ServerShare(int(server), int(evaluations), int(failed), seconds, int(slower), bool(within))
        for server, evaluations, failed, seconds, slower, within in connection.execute(
            _SHARES, {"overtaken": OVERTAKEN, "last": last}
        )
    ]


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
    for error, server, count in connection.execute(_FAILURES, {"overtaken": OVERTAKEN, "last": last}):
        one = found.get(kind_of(error)) or FailureReason(error, 0, {})
        servers = {**one.servers, server: one.servers.get(server, 0) + count}
        found[kind_of(error)] = one._replace(attempts=one.attempts + count, servers=servers)
    return sorted(found.values(), key=lambda one: -one.attempts)
