"""Reading a store in pieces, between which it is locked for nobody and little of it is in memory."""

import sqlite3
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager, closing, contextmanager
from pathlib import Path

from swarmwright.common.errors import InputError
from swarmwright.runs.store.blocks import Record
from swarmwright.runs.store.database import connect_to_read, errors, reading_on
from swarmwright.runs.store.generations import Generations, Row

_PIECE_BYTES = 1 << 24
"""Bytes of evaluations that are read at once, about: of larger generations, and after the first ones of small
generations."""

Begin = Callable[[], AbstractContextManager[sqlite3.Connection]]
"""Begins to read a piece."""


@contextmanager
def in_pieces(file: Path) -> Iterator[Begin]:
    """Yield what begins a transaction to read a piece of a store, on one connection for all pieces.

    Between the pieces nothing is locked: who stops in the middle keeps no process from writing. A connection
    for each would read the whole write-ahead log each time, where a process that was killed has left one.

    Raises InputError as `reading`.
    """
    with errors(file, InputError):
        connection = connect_to_read(file)

    @contextmanager
    def begin() -> Iterator[sqlite3.Connection]:
        with reading_on(connection, file):
            connection.execute("BEGIN")
            try:
                yield connection
            finally:
                if connection.in_transaction:
                    connection.execute("ROLLBACK")

    with closing(connection):
        yield begin


def evaluations(
    begin: Begin, rows: Iterable[Row], opened: Callable[[sqlite3.Connection], Generations]
) -> Iterator[Record]:
    """Yield the evaluations of generations; none of a generation before all of it has been compared.

    opened: returns the tables of a connection.
    """
    left = deque(rows)
    while left:
        parts: list[Record] = []
        size, large = 0, None
        with begin() as connection:
            generations = opened(connection)
            while left and large is None and size <= _PIECE_BYTES:
                row = left.popleft()
                found = generations.compared(row, _PIECE_BYTES)
                if found is None:
                    large = row
                else:
                    parts += found
                    size += sum(part.nbytes for part in found)
        yield from parts
        if large is not None:
            yield from _blocks(begin, large, opened)


def _blocks(begin: Begin, row: Row, opened: Callable[[sqlite3.Connection], Generations]) -> Iterator[Record]:
    """Yield the evaluations of a generation that has been compared, block by block."""
    with begin() as connection:
        sample = opened(connection).sample(row)
    number = row.first
    while number < row.summary.evaluations:
        with begin() as connection:
            part = opened(connection).block(row, number, sample)
        number += len(part.fitness)
        yield part
