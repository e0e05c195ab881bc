"""Read a store in pieces, without a lock between them and with little of it in memory."""

import sqlite3
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager, closing, contextmanager
from pathlib import Path

from swarmwright.common.errors import InputError
from swarmwright.runs.store.blocks import Record
from swarmwright.runs.store.database import connect_to_read, reading_on, translate_errors
from swarmwright.runs.store.generations import Generations, Row

_PIECE_BYTES = 1 << 24
"""Approximate bytes of evaluations that are read at once."""

Begin = Callable[[], AbstractContextManager[sqlite3.Connection]]
"""Begins a transaction to read a piece."""


@contextmanager
def read_in_pieces(file: Path) -> Iterator[Begin]:
    """Yield a function that begins a transaction to read a piece of a store, on one shared connection.

    Between the pieces nothing is locked, so an abandoned iteration blocks no writer. A connection for each
    piece would read the whole write-ahead log each time, if a killed process has left one.

    Raises InputError as `reading`.
    """
    with translate_errors(file, InputError):
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
    begin: Begin, rows: Iterable[Row], open_tables: Callable[[sqlite3.Connection], Generations]
) -> Iterator[Record]:
    """Yield the evaluations of generations, each generation only after its comparison with the digest.

    open_tables: returns the tables of a connection.
    """
    remaining = deque(rows)
    while remaining:
        parts: list[Record] = []
        size, large = 0, None
        with begin() as connection:
            generations = open_tables(connection)
            while remaining and large is None and size <= _PIECE_BYTES:
                row = remaining.popleft()
                blocks = generations.read_verified(row, _PIECE_BYTES)
                if blocks is None:
                    large = row
                else:
                    parts += blocks
                    size += sum(part.nbytes for part in blocks)
        yield from parts
        if large is not None:
            yield from _read_blocks(begin, large, open_tables)


def _read_blocks(
    begin: Begin, row: Row, open_tables: Callable[[sqlite3.Connection], Generations]
) -> Iterator[Record]:
    """Yield the evaluations of a generation that was compared with its digest, block by block."""
    with begin() as connection:
        sample = open_tables(connection).sample(row)
    number = row.first
    while number < row.summary.evaluations:
        with begin() as connection:
            part = open_tables(connection).block(row, number, sample)
        number += len(part.fitness)
        yield part
