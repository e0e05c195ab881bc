"""When servers worked: attempts of a session, aggregated over time."""

import sqlite3
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from swarmwright.servers.rows import FAILED

_FAILED = ", ".join(f"'{outcome}'" for outcome in sorted(FAILED))
_MARKS = 2000
"""Largest number of marks of failures."""
_BUSY = """
WITH timed AS (
    SELECT server, started, started + seconds AS ended, max(started + seconds) OVER (
        PARTITION BY server ORDER BY started ROWS BETWEEN UNBOUNDED PRECEDING AND 1 PRECEDING) AS before
    FROM attempt WHERE server >= 0 AND session = :session AND rowid <= :last),
work AS (SELECT server, max(started, coalesce(before, started)) AS began, ended FROM timed),
shown AS (
    SELECT server, max(began - :low, 0) AS began, min(ended - :low, :high - :low) AS ended FROM work
    WHERE ended > began AND ended > :low AND began < :high)
SELECT server, cast(began / :width AS INTEGER) AS first, cast(ended / :width AS INTEGER) AS end, count(*),
    sum(began), sum(ended)
FROM shown GROUP BY server, first, end
"""
"""Time with at least one attempt in progress, by server and by the bins in which it begins and ends."""
_ENDED = """
SELECT server, cast((started + seconds - :low) / :width AS INTEGER) AS bin, sum(candidates * episodes)
FROM attempt WHERE server >= 0 AND session = :session AND rowid <= :last AND outcome = 'done'
    AND started + seconds BETWEEN :low AND :high
GROUP BY server, bin
"""
"""Episodes by the bin in which their attempt ended."""
_TROUBLE = f"""
SELECT server, cast((started + seconds - :low) / :width AS INTEGER) AS bin, outcome, error, count(*),
    min(rowid), generation, candidate, episode
FROM attempt WHERE session = :session AND rowid <= :last AND outcome IN ({_FAILED}, 'lost')
    AND started + seconds BETWEEN :low AND :high
GROUP BY server, bin, outcome, error ORDER BY min(rowid) LIMIT {_MARKS}
"""  # noqa: S608 - our own names
"""Failed attempts by bin and reason, with the first of each."""
_LAST_ANSWERS = """
SELECT generation, server, max(started + seconds) FROM attempt
WHERE server >= 0 AND session = :session AND rowid <= :last AND outcome = 'done' GROUP BY generation, server
"""
_GENERATIONS = """
SELECT evaluations - first, seconds FROM generation WHERE session = :session AND generation < :end
ORDER BY generation
"""


class Failures(NamedTuple):
    """Failed attempts of a server with the same outcome and reason in the same bin."""

    server: int
    """-1: the tool's own process."""
    bin: int
    outcome: str
    reason: str
    attempts: int
    generation: int
    """Generation of the first of these attempts; candidate and episode are of the same attempt."""
    candidate: int
    episode: int


class Waiting(NamedTuple):
    """How long the others waited for a server at the end of generations."""

    generations: int
    """Generations whose last answer came from it, while others had answered."""
    seconds: float
    """Total time between the last answer of the other servers and its own."""


@dataclass(frozen=True, eq=False)
class Timing:
    """What the servers did in a part of a session, in bins of equal width."""

    servers: tuple[int, ...]
    """Numbers of the servers with attempts in the session, ascending."""
    busy: NDArray[np.float64]
    """(servers, bins), seconds with at least one attempt in progress."""
    episodes: NDArray[np.int64]
    """(servers, bins), of the attempts that ended there."""
    failures: tuple[Failures, ...]
    evaluated: NDArray[np.float64]
    """(bins,), candidates, those of each generation spread evenly over its duration."""


class Part(NamedTuple):
    """A part of a session, in bins."""

    session: int
    low: float
    """Seconds since 1970."""
    high: float
    bins: int
    started: float
    """Beginning of the session, seconds since 1970."""


def read_bounds(connection: sqlite3.Connection, session: int, last: int) -> tuple[float | None, float | None]:
    """Return when the first attempt began and the last one ended, in seconds since 1970; None without any."""
    low, high = connection.execute(
        "SELECT min(started), max(started + seconds) FROM attempt WHERE session = ? AND rowid <= ? "
        "AND server >= 0",
        (session, last),
    ).fetchone()
    return low, high


def read_timing(connection: sqlite3.Connection, part: Part, last: int, end: int) -> Timing:
    """Return what the servers did.

    Args:
        connection: to the store.
        part: part of a session.
        last: number of the last row of the table attempt that counts.
        end: number of the first generation that does not count.
    """
    width = (part.high - part.low) / part.bins
    values = {
        "session": part.session, "low": part.low, "high": part.high, "width": width, "last": last, "end": end,
    }  # fmt: skip
    numbers = connection.execute(
        "SELECT DISTINCT server FROM attempt WHERE server >= 0 AND session = :session AND rowid <= :last "
        "ORDER BY server",
        values,
    )
    servers = tuple(number for (number,) in numbers)
    rows = {server: row for row, server in enumerate(servers)}
    busy = np.zeros((len(servers), part.bins))
    for server, first, stop, count, began, ended in connection.execute(_BUSY, values):
        lane, final = busy[rows[server]], min(stop, part.bins - 1)
        if first >= final:
            lane[final] += ended - began
            continue
        lane[first] += count * (first + 1) * width - began
        lane[first + 1 : final] += count * width
        lane[final] += ended - count * final * width
    episodes = np.zeros((len(servers), part.bins), np.int64)
    for server, number, count in connection.execute(_ENDED, values):
        episodes[rows[server], min(number, part.bins - 1)] += count
    failures = tuple(
        Failures(server, min(number, part.bins - 1), outcome, reason or "", count, *candidate)
        for server, number, outcome, reason, count, _, *candidate in connection.execute(_TROUBLE, values)
    )
    return Timing(servers, busy, episodes, failures, _read_evaluated(connection, part, values))


def read_waiting(connection: sqlite3.Connection, session: int, last: int) -> dict[int, Waiting]:
    """Return how long the others waited for each server in a session.

    last: number of the last row of the table attempt that counts.
    """
    values = {"session": session, "last": last}
    answers: dict[int, list[tuple[float, int]]] = {}
    for generation, server, ended in connection.execute(_LAST_ANSWERS, values):
        answers.setdefault(generation, []).append((ended, server))
    waiting: dict[int, Waiting] = {}
    for ends in answers.values():
        if len(ends) < 2:
            continue
        (before, _), (ended, server) = sorted(ends)[-2:]
        sums = waiting.get(server, Waiting(0, 0.0))
        waiting[server] = Waiting(sums.generations + 1, sums.seconds + ended - before)
    return waiting


def _read_evaluated(
    connection: sqlite3.Connection, part: Part, values: dict[str, float]
) -> NDArray[np.float64]:
    rows = np.array(connection.execute(_GENERATIONS, values).fetchall(), dtype=np.float64).reshape(-1, 2)
    times = np.concatenate([[part.started], part.started + rows[:, 1]])
    counts = np.concatenate([[0.0], np.cumsum(rows[:, 0])])
    edges = np.linspace(part.low, part.high, part.bins + 1)
    evaluated: NDArray[np.float64] = np.diff(np.interp(edges, times, counts))
    return evaluated
