"""How a run went: its attempts and events, what servers did, and why attempts failed."""

import sqlite3
from collections.abc import Collection, Iterable, Iterator, Mapping
from typing import Any

from swarmwright.common.formatting import format_count
from swarmwright.common.message_kinds import kind_of
from swarmwright.runs.store.pieces import Begin
from swarmwright.servers.rows import FAILED, FailureReason, ServerShare, parse_journal_line

_FAILED = ", ".join(f"'{outcome}'" for outcome in sorted(FAILED))
_SHARES = f"""
WITH one AS (
    SELECT server, iif(outcome = 'done', candidates * episodes, 0) AS evaluations, started,
        started + seconds AS ended, outcome, outcome IN ({_FAILED}) AS failed, mode,
        max(started + seconds) OVER (
            PARTITION BY server ORDER BY started ROWS BETWEEN UNBOUNDED PRECEDING AND 1 PRECEDING) AS before
    FROM attempt WHERE server >= 0 AND rowid <= ?)
SELECT server, sum(evaluations), sum(failed),
    sum(max(0.0, ended - max(started, coalesce(before, started)))), sum(outcome = 'overtaken'),
    max(mode <> 'stepwise' AND (failed OR outcome = 'lost')), sum(outcome = 'lost'),
    sum(outcome = 'handed_back')
FROM one GROUP BY server ORDER BY server
"""  # noqa: S608 - our own names
"""What each server did; attempts that overlap count once as time: what is before the end of an earlier one is
left out."""
_FAILURES = f"""
SELECT error, server, sum(outcome <> 'lost'), sum(outcome = 'lost')
FROM attempt WHERE outcome IN ({_FAILED}, 'lost') AND rowid <= ?
GROUP BY server, error HAVING max(outcome <> 'lost') ORDER BY server, min(rowid)
"""  # noqa: S608 - our own names
"""Why attempts failed on each server, how many, and how many were lost for the same reason."""
_OVERTAKEN = """
SELECT server, count(*) FROM attempt WHERE session = ? AND outcome = 'overtaken'
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
                some.append(parse_journal_line(kind, dict(zip(names, row, strict=True))))
                after = number
        yield from some
        found = len(some)


def shares(connection: sqlite3.Connection, last: int) -> list[ServerShare]:
    """Return what each server did in the attempts up to the row `last`, by its number."""
    return [
        ServerShare(server, evaluations, failed, seconds, slower, bool(within), lost, handed_back)
        for server, evaluations, failed, seconds, slower, within, lost, handed_back in connection.execute(
            _SHARES, (last,)
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
            f"WHERE outcome = 'done' AND server >= 0 AND rowid <= ? AND generation IN ({marks})",
            (last, *generations),
        )
    )


def incidents(connection: sqlite3.Connection, session: int, counts: Mapping[str, int]) -> str:
    """Return the incidents of a session in words; of backups, with the servers that were slower."""
    texts = {name: f"{name.replace('_', ' ')}: {count}" for name, count in counts.items()}
    if "backups" in texts:
        servers = connection.execute(_OVERTAKEN, (session,)).fetchall()
        slower = [f"{format_count(count, 'attempt')} of server {server}" for server, count in servers]
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
    for reason, server, count, lost in connection.execute(_FAILURES, (last,)):
        failure = found.get(kind_of(reason)) or FailureReason(reason, 0, {}, 0)
        servers = {**failure.servers, server: failure.servers.get(server, 0) + count}
        found[kind_of(reason)] = FailureReason(
            failure.reason, failure.attempts + count, servers, failure.lost + lost
        )
    return sorted(found.values(), key=lambda failure: -failure.attempts)
