"""When the servers of a run worked, failed, or kept the run waiting."""

import math
from dataclasses import dataclass
from datetime import datetime
from typing import TYPE_CHECKING

from swarmwright.common.errors import InputError
from swarmwright.runs.store.timing import Part, Timing, Waiting
from swarmwright.servers.rows import Session

if TYPE_CHECKING:
    from swarmwright.runs.run import Run

SHORTEST_S = 1e-3
"""Part of a session that can be shown: times are seconds since 1970, with a precision below 1 µs."""


@dataclass(frozen=True, eq=False)
class Timeline:
    """What the servers did in a part of a session."""

    session: int
    started: float
    """Beginning of the session, seconds since 1970."""
    seconds: float
    """Duration of the session up to the last record."""
    begin: float
    """Beginning of the part, in seconds from the beginning of the session."""
    end: float
    timing: Timing


def timeline(
    run: "Run",
    session: int | None = None,
    *,
    begin: float | None = None,
    end: float | None = None,
    bins: int = 400,
) -> Timeline:
    """Return what the servers of a run did, in bins of equal width.

    Args:
        run: the run; its attempts are aggregated in the store, which keeps memory use constant.
        session: number of the session; default: the last.
        begin: beginning of the part, in seconds from the beginning of the session; default: 0.
        end: end of the part, at least 1 ms later; default: the session's end.
        bins: number of bins, 1 to 2,000.

    Raises InputError for an unknown session, a part that is too short, or bins out of range.
    """
    if not 1 <= bins <= 2000:
        raise InputError(f"bins: must be from 1 to 2000, not {bins}")
    chosen = find_session(run, session)
    try:
        written = datetime.fromisoformat(chosen.started).timestamp()
    except (ValueError, OverflowError):
        raise InputError(f"{run.path}: session {chosen.session} has no valid beginning") from None
    first, last = run._store.attempt_bounds(chosen.session)
    started = min(written, written if first is None else first)
    seconds = max(chosen.seconds or 0.0, 0.0 if last is None else last - started, SHORTEST_S)
    low, high = 0.0 if begin is None else begin, seconds if end is None else end
    if not 0 <= low < high < math.inf:
        raise InputError(f"begin, end: must be ascending seconds from 0, not {low:g} and {high:g}")
    high = min(high, seconds)
    if high - low < SHORTEST_S * (1 - 1e-6):
        raise InputError(
            f"begin, end: must be at least {SHORTEST_S:g} s apart within the {seconds:g} s of the session"
        )
    part = Part(chosen.session, started + low, started + high, bins, written)
    return Timeline(chosen.session, started, seconds, low, high, run._store.timing(part))


def waiting(run: "Run", session: int | None = None) -> dict[int, Waiting]:
    """Return how long the others waited for each server at the end of the generations of a session.

    session: its number; default: the last.

    Raises InputError for another session.
    """
    return run._store.waiting(find_session(run, session).session)


def find_session(run: "Run", session: int | None) -> Session:
    """Return a session, by default the last. Raises InputError for another number."""
    sessions = {each.session: each for each in run.sessions}
    chosen = sessions.get(max(sessions, default=0) if session is None else session)
    if chosen is None:
        raise InputError(f"session: {run.path} has no session {session}")
    return chosen
