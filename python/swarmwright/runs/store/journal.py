"""The journal of a run: attempts and events, shares of servers, and reasons of failed attempts."""

import sqlite3
from collections.abc import Collection, Iterable, Iterator, Mapping
from typing import Any

from swarmwright.common.formatting import format_count, kind_of
from swarmwright.runs.store.pieces import Begin
from swarmwright.servers.rows import FAILED, FailureReason, ServerShare, parse_journal_line

_FAILED = ", ".join(f"'{outcome}'" for outcome in sorted(FAILED))
_SHARES = f"""
WITH timed AS (
    SELECT server, iif(outcome = 'done', candidates * episodes, 0) AS evaluations, started,
        started + seconds AS ended, outcome, outcome IN ({_FAILED}) AS failed, mode,
        max(started + seconds) OVER (
            PARTITION BY server ORDER BY started ROWS BETWEEN UNBOUNDED PRECEDING AND 1 PRECEDING) AS before
    FROM attempt WHERE server >= 0 AND rowid <= ?)
SELECT server, sum(evaluations), sum(failed),
    sum(max(0.0, ended - max(started, coalesce(before, started)))), sum(outcome = 'overtaken'),
    max(mode <> 'stepwise' AND (failed OR outcome = 'lost')), sum(outcome = 'lost'),
    sum(outcome = 'handed_back')
FROM timed GROUP BY server ORDER BY server
"""  # noqa: S608 - our own names
"""The work of each server; time in which attempts overlap counts once."""
_FAILURES = f"""
SELECT error, server, sum(outcome <> 'lost'), sum(outcome = 'lost')
FROM attempt WHERE outcome IN ({_FAILED}, 'lost') AND rowid <= ?
GROUP BY server, error HAVING max(outcome <> 'lost') ORDER BY server, min(rowid)
"""  # noqa: S608 - our own names
"""Reasons of failed attempts on each server, with the numbers of failed and lost attempts."""
_OVERTAKEN = """
SELECT server, count(*) FROM attempt WHERE session = ? AND outcome = 'overtaken'
GROUP BY server ORDER BY count(*) DESC, server
"""
_NAMED_SERVERS = 3
"""Largest number of servers named in incidents."""
_PIECE_ROWS = 1000
"""Rows read at once."""


def read_rows(begin: Begin, kind: type[Any], table: str, last: int) -> Iterator[Any]:
    """Yield the rows of a table up to the row `last`, in order."""
    after, count = 0, _PIECE_ROWS
    while count == _PIECE_ROWS:
        with begin() as connection:
            cursor = connection.execute(
                f"SELECT rowid, * FROM {table} WHERE rowid > ? AND rowid <= ? ORDER BY rowid LIMIT ?",  # noqa: S608 - our own names
                (after, last, _PIECE_ROWS),
            )
            names = [column[0] for column in cursor.description][1:]
            rows = []
            for number, *row in cursor:
                rows.append(parse_journal_line(kind, dict(zip(names, row, strict=True))))
                after = number
        yield from rows
        count = len(rows)


def read_shares(connection: sqlite3.Connection, last: int) -> list[ServerShare]:
    """Return the work of each server in the attempts up to the row `last`, ordered by server number."""
    return [
        ServerShare(server, evaluations, failed, seconds, slower, bool(within), lost, handed_back)
        for server, evaluations, failed, seconds, slower, within, lost, handed_back in connection.execute(
            _SHARES, (last,)
        )
    ]


class Evaluators:
    """The server that evaluated each episode of each candidate.

    attempts: successful ones: generation, first candidate, candidates, first episode, episodes, server.
    """

    def __init__(self, attempts: Iterable[tuple[int, int, int, int, int, int]]) -> None:
        self._attempts: dict[int, list[tuple[range, range, int]]] = {}
        for generation, candidate, candidates, episode, episodes, server in attempts:
            block = range(candidate, candidate + candidates), range(episode, episode + episodes), server
            self._attempts.setdefault(generation, []).append(block)

    def find_server(self, generation: int, candidate: int, episode: int) -> int | None:
        """Return the server of an evaluation; None if no server evaluated it."""
        for candidates, episodes, server in self._attempts.get(generation, ()):
            if candidate in candidates and episode in episodes:
                return server
        return None


def read_evaluators(connection: sqlite3.Connection, generations: Collection[int], last: int) -> Evaluators:
    """Return the servers of some generations, from the attempts up to the row `last`."""
    marks = ", ".join("?" * len(generations))
    return Evaluators(
        connection.execute(
            "SELECT generation, candidate, candidates, episode, episodes, server FROM attempt "  # noqa: S608 - marks alone
            f"WHERE outcome = 'done' AND server >= 0 AND rowid <= ? AND generation IN ({marks})",
            (last, *generations),
        )
    )


def format_incidents(connection: sqlite3.Connection, session: int, counts: Mapping[str, int]) -> str:
    """Describe the incidents of a session; for backups, with the slower servers."""
    texts = {name: f"{name.replace('_', ' ')}: {count}" for name, count in counts.items()}
    if "backups" in texts:
        servers = connection.execute(_OVERTAKEN, (session,)).fetchall()
        slower = [f"{format_count(count, 'attempt')} of server {server}" for server, count in servers]
        if slower:
            more = " and others" * (len(slower) > _NAMED_SERVERS)
            texts["backups"] += (
                " (repeated work of slow servers, of which the first result counted; slower were "
                f"{', '.join(slower[:_NAMED_SERVERS])}{more})"
            )
    return ", ".join(texts.values())


def read_failures(connection: sqlite3.Connection, last: int) -> list[FailureReason]:
    """Return the reasons of failed attempts up to the row `last`, the most frequent first."""
    failures: dict[str, FailureReason] = {}
    for reason, server, count, lost in connection.execute(_FAILURES, (last,)):
        failure = failures.get(kind_of(reason)) or FailureReason(reason, 0, {}, 0)
        servers = {**failure.servers, server: failure.servers.get(server, 0) + count}
        failures[kind_of(reason)] = FailureReason(
            failure.reason, failure.attempts + count, servers, failure.lost + lost
        )
    return sorted(failures.values(), key=lambda failure: -failure.attempts)
