"""How far a store is at a moment, so that readers can leave out what is added later."""

import sqlite3
from dataclasses import dataclass
from typing import Any, Self


@dataclass(frozen=True)
class Moment:
    """What a store holds at a moment; it only grows."""

    generations: int
    """Finished ones."""
    attempts: int
    """Number of the last row of the table; 0 without one."""
    events: int
    """The same."""
    sessions: tuple[dict[str, Any], ...]
    """Rows of the table, by column: the last one changes when its session ends."""

    @classmethod
    def of(cls, connection: sqlite3.Connection) -> Self:
        """Return the moment that the connection's transaction reads."""

        def last(column: str, table: str) -> int | None:
            found = connection.execute(f"SELECT max({column}) FROM {table}").fetchone()[0]  # noqa: S608 - our own names
            return None if found is None else int(found)

        generation = last("generation", "generation")
        return cls(
            generations=0 if generation is None else generation + 1,
            attempts=last("rowid", "attempt") or 0,
            events=last("rowid", "event") or 0,
            sessions=session_rows(connection),
        )


def session_rows(connection: sqlite3.Connection) -> tuple[dict[str, Any], ...]:
    """Return the rows of the table session, in order, by column."""
    cursor = connection.execute("SELECT * FROM session ORDER BY session")
    names = [column[0] for column in cursor.description]
    return tuple(dict(zip(names, row, strict=True)) for row in cursor)
