"""Generations in a store, compared with their digests as they are read."""

import hashlib
import math
import sqlite3
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmwright import _engine
from swarmwright.common.arrays import best_first
from swarmwright.common.statistics import Summary
from swarmwright.runs.store import digests
from swarmwright.runs.store.blocks import COLUMNS, EvaluationsDigest, Record, Sample, decoded, of_columns
from swarmwright.runs.store.database import DamageError

_COLUMNS = (
    "generation, first, seeds, evaluations, best, mean, best_so_far, lower_quartile, median, upper_quartile, "
    "failed, leader, evaluations_digest, digest"
)
_SAMPLE = "SELECT address, numbers FROM sample WHERE generation = ?"
_BLOCKS = f"SELECT {COLUMNS} FROM block WHERE first >= ? AND first < ? ORDER BY first"  # noqa: S608 - our own names
_JOINED = 1 << 18
"""Bytes of fitness that are looked through at once."""
LARGEST = 1 << 62
"""Of a number that is looked for, more than any that is stored; SQLite's integers have 64 bits."""
MISSING = "it is missing in the table generation"
ROW_DISAGREES = "the table generation disagrees with its digest"
_WRONG = (*digests.WRONG_TYPES, ValueError)
_DISAGREE = "the table block disagrees with its digest"
_BOTH_DISAGREE = "the tables block and sample disagree with their digest"


@dataclass(frozen=True)
class Row:
    """A line of the table `generation`."""

    generation: int
    first: int
    """Number of its first evaluation."""
    seeds: str
    """JSON."""
    summary: Summary
    leader: int
    evaluations_digest: str
    digest: str

    @property
    def count(self) -> int:
        """How many evaluations it has."""
        return self.summary.evaluations - self.first

    def digest_after(self, previous: str) -> str:
        """Return the digest that it ought to have after this one."""
        summary = self.summary
        return digests.of_generation(
            previous,
            (self.generation, self.first, summary.evaluations, summary.failed, self.leader),
            (
                summary.best,
                summary.mean,
                summary.best_so_far,
                summary.lower_quartile,
                summary.median,
                summary.upper_quartile,
            ),
            self.seeds,
            self.evaluations_digest,
        )


class Generations:
    """The tables `generation` and `block` of a store that is open.

    Every method raises InputError for what is not what was written, and sqlite3.Error.

    Args:
        connection: to the store, within one transaction.
        file: the store, for messages.
        end: number of the first generation that is left out, together with all that follow.
    """

    def __init__(self, connection: sqlite3.Connection, file: Path, end: int = LARGEST) -> None:
        self._connection = connection
        self._file = file
        self._end = end

    def rows(self) -> list[Row]:
        """Return every finished generation."""
        found = self.select("WHERE generation < ? ORDER BY generation", self._end)
        previous = ""
        for index, row in enumerate(found):
            if row.generation != index:
                raise self.damaged(MISSING, index)
            self.check(row, previous)
            previous = row.digest
        self.check_end(found[-1] if found else None)
        return found

    def row(self, generation: int) -> Row | None:
        """Return a generation; None when there is none of that number."""
        if abs(generation) > LARGEST or generation >= self._end:
            return None
        found = self.select(
            "WHERE generation BETWEEN ? AND ? ORDER BY generation", generation - 1, generation
        )
        if not found or found[-1].generation != generation:
            return None
        if generation and len(found) == 1:
            raise self.damaged(MISSING, generation - 1)
        self.check(found[-1], found[0].digest if generation else "")
        return found[-1]

    def last(self) -> Row | None:
        """Return the last generation; None when none is finished."""
        found = self._connection.execute(
            "SELECT max(generation) FROM generation WHERE generation < ?", (self._end,)
        ).fetchone()[0]
        row = None if found is None else self.row(int(found))
        self.check_end(row)
        return row

    def of_evaluation(self, number: int) -> Row | None:
        """Return the generation that an evaluation belongs to; None when there is none of that number."""
        if abs(number) > LARGEST:
            return None
        found = self._connection.execute(
            "SELECT generation, evaluations FROM generation WHERE first <= ? AND generation < ? "
            "ORDER BY generation DESC LIMIT 1",
            (number, self._end),
        ).fetchone()
        return None if found is None or found[1] <= number else self.row(int(found[0]))

    def check(self, row: Row, previous: str) -> None:
        """Compare a line of the table with its digest."""
        if row.digest != self.expected(row, previous):
            raise self.damaged(ROW_DISAGREES, row.generation)

    def expected(self, row: Row, previous: str) -> str:
        """Return the digest that a line of the table ought to have."""
        try:
            return row.digest_after(previous)
        except digests.WRONG_TYPES as error:
            raise self.damaged(f"the table generation cannot be read: {error}", row.generation) from error

    def check_end(self, last: Row | None) -> None:
        """Check that there is no evaluation after the last generation, unless some are left out."""
        if self._leaves_out:
            return
        # Blocks before the last generation's are compared when they are read; there may be many.
        begin, evaluations = (-(2**63), 0) if last is None else (last.first, last.summary.evaluations)
        (most,) = self._connection.execute(
            "SELECT max(first + evaluations) FROM block WHERE first >= ?", (begin,)
        ).fetchone()
        if most is not None and most > evaluations:
            raise self.damaged(f"evaluations from {evaluations} to {most - 1} belong to no generation")

    @property
    def _leaves_out(self) -> bool:
        found = self._connection.execute(
            "SELECT 1 FROM generation WHERE generation >= ? LIMIT 1", (self._end,)
        )
        return found.fetchone() is not None

    def sample(self, row: Row) -> _engine.Sample | None:
        """Return what the genomes of a generation are made from; None where the blocks have them."""
        found = self._sample(row)
        if found is None:
            return None
        try:
            sample = _engine.Sample.read(*found)
        except _WRONG as error:
            raise self.damaged(_BOTH_DISAGREE, row.generation) from error
        if len(sample) != row.count:
            raise self.damaged(_BOTH_DISAGREE, row.generation)
        return sample

    def _sample(self, row: Row) -> Sample | None:
        found: Sample | None = self._connection.execute(_SAMPLE, (row.generation,)).fetchone()
        return found

    def evaluations(self, row: Row, *, made: bool = True) -> Iterator[Record]:
        """Yield the evaluations of a generation, block by block; at the end they are compared.

        made: whether genomes are made where there is a sample; otherwise they have no genes there.
        """
        cursor = self._connection.execute(_BLOCKS, (row.first, row.summary.evaluations))
        stored, sample, next_ = self._sample(row), self.sample(row), row.first
        disagree = _DISAGREE if sample is None else _BOTH_DISAGREE
        total = EvaluationsDigest(stored)
        for block in cursor:
            try:
                if block[0] != next_ or block[1] != row.generation:
                    break
                total.add(block)
                part = decoded(block, row.first, sample if made else None)
            except _WRONG as error:
                raise self.damaged(disagree, row.generation) from error
            next_ += len(part.fitness)
            yield part
        missing = row.summary.evaluations - next_
        if missing:
            raise self.damaged(f"{missing} evaluations are missing", row.generation)
        if of_columns(total.columns(), row.first, row.generation, row.count) != row.evaluations_digest:
            raise self.damaged(disagree, row.generation)

    def seeds(self) -> set[str]:
        """Return the seeds of all generations, JSON each, compared with nothing."""
        found = self._connection.execute(
            "SELECT DISTINCT seeds FROM generation WHERE generation < ?", (self._end,)
        )
        return {str(text) for (text,) in found}

    def by_fitness(self, first: int, most: int) -> NDArray[np.int64]:
        """Return the numbers of the best evaluations from `first` on that did not fail, the best first.

        Of equals, the first one comes first. Only their fitness is read, a block at a time, and compared with
        nothing.

        Args:
            first: number of the first evaluation that counts.
            most: how many are returned, at most.
        """
        cursor = self._connection.execute(
            "SELECT first, fitness FROM block WHERE first + evaluations > ? AND generation < ? "
            "ORDER BY first",
            (first, self._end),
        )
        number, value = np.zeros(0, np.int64), np.zeros(0)
        try:
            for begin, fitness in _side_by_side(cursor):
                counts = np.isfinite(fitness)
                counts[: max(first - begin, 0)] = False
                if len(value) >= most:  # one that comes later has to be better
                    counts &= fitness > value[most - 1]
                places = np.flatnonzero(counts)
                number = np.concatenate([number, begin + places])
                value = np.concatenate([value, fitness[places]])
                if len(value) > most > 0:  # only what may be chosen is sorted
                    least = np.partition(value, -most)[-most]
                    number, value = number[value >= least], value[value >= least]
                chosen = best_first(value)[:most]
                number, value = number[chosen], value[chosen]
        except _WRONG as error:
            raise self.damaged(_DISAGREE) from error
        return number

    def fitness(self) -> NDArray[np.float64]:
        """Return the fitness of every evaluation, in order; nothing else is read, or compared."""
        cursor = self._connection.execute(
            "SELECT first, fitness FROM block WHERE generation < ? ORDER BY first", (self._end,)
        )
        try:
            columns = [column for _, column in _side_by_side(cursor)]
        except _WRONG as error:
            raise self.damaged(_DISAGREE) from error
        return np.concatenate(columns) if columns else np.zeros(0)

    def best_fitness(self, first: int, end: int) -> float:
        """Return the best fitness of the evaluations from `first` to before `end`; NaN where all failed.

        Only their fitness is read, and compared with nothing.
        """
        cursor = self._connection.execute(
            "SELECT first, fitness FROM block WHERE first + evaluations > ? AND first < ? ORDER BY first",
            (first, end),
        )
        best = -math.inf
        try:
            for begin, fitness in _side_by_side(cursor):
                some = fitness[max(first - begin, 0) : end - begin]
                best = float(some.max(initial=best, where=np.isfinite(some)))
        except _WRONG as error:
            raise self.damaged(_DISAGREE) from error
        return best if math.isfinite(best) else math.nan

    def with_fitness(
        self, value: float, first: int, end: int, metrics: int
    ) -> Iterator[tuple[NDArray[np.int64], NDArray[np.float64]]]:
        """Yield the evaluations of this fitness from `first` to before `end`, those of a block at a time.

        They are numbers in the whole run, ascending, and metrics, (evaluations, episodes, metrics). Only
        their fitness and metrics are read, and compared with nothing.

        metrics: how many are stored.
        """
        cursor = self._connection.execute(
            "SELECT first, fitness FROM block WHERE first + evaluations > ? AND first < ? ORDER BY first",
            (first, end),
        )
        try:
            for begin, fitness in cursor:
                column = np.frombuffer(fitness, dtype="<f8")
                places = np.flatnonzero(column == value)
                places = places[(places >= first - begin) & (places < end - begin)]
                if not len(places):
                    continue
                (stored,) = self._connection.execute(
                    "SELECT metrics FROM block WHERE first = ?", (begin,)
                ).fetchone()
                table = np.frombuffer(stored, dtype="<f8").reshape(len(column), -1, metrics)
                yield begin + places, table[places].astype(np.float64)
        except _WRONG as error:
            raise self.damaged(_DISAGREE) from error

    def of_genome(self, genome: bytes, last: int) -> list[int]:
        """Return the numbers of the evaluations of a genome up to the one with the number `last`, ascending.

        It is compared with nothing. Empty where genomes are made of a sample.
        """
        cursor = self._connection.execute(
            "SELECT first, evaluations, genomes FROM block WHERE first <= ? ORDER BY first", (last,)
        )
        found: list[int] = []
        try:
            for first, count, genomes in cursor:
                if len(genomes) == count * len(genome) > 0:
                    rows = np.frombuffer(genomes, dtype=f"V{len(genome)}")
                    places = np.flatnonzero(rows == np.void(genome))
                    found += (first + places[first + places <= last]).tolist()
        except _WRONG as error:
            raise self.damaged(_DISAGREE) from error
        return found

    def by_instances(self, most: int) -> list[int]:
        """Return the numbers of the last evaluations of genomes, those with the most evaluations first.

        Of equally many, that with the higher fitness comes first, then the earlier one; genomes whose last
        evaluation failed are left out. It is compared with nothing.
        """
        cursor = self._connection.execute(
            "SELECT first, evaluations, fitness, genomes FROM block WHERE generation < ? ORDER BY first",
            (self._end,),
        )
        known: dict[bytes, list[float]] = {}  # evaluations, fitness and number of the last
        try:
            for first, count, column, genomes in cursor:
                size = len(genomes) // count
                for index, value in enumerate(np.frombuffer(column, dtype="<f8").tolist()):
                    genome = genomes[index * size : (index + 1) * size]
                    entry = known.setdefault(hashlib.blake2b(genome, digest_size=16).digest(), [0, 0, 0])
                    entry[:] = entry[0] + 1, value, first + index
        except _WRONG as error:
            raise self.damaged(_DISAGREE) from error
        entries = sorted(
            (entry for entry in known.values() if math.isfinite(entry[1])),
            key=lambda entry: (-entry[0], -entry[1], entry[2]),
        )
        return [int(number) for _, _, number in entries[:most]]

    def compared(self, row: Row, most: int) -> list[Record] | None:
        """Compare the evaluations of a generation and return them, block by block.

        most: bytes; None is returned where several blocks have more.
        """
        parts: list[Record] = []
        size = 0
        for part in self.evaluations(row):
            size += part.nbytes
            if parts and size > most:
                break
            parts.append(part)
        else:
            return parts
        parts.clear()
        for _ in self.evaluations(row, made=False):
            pass
        return None

    def block(self, row: Row, number: int, sample: _engine.Sample | None) -> Record:
        """Return the evaluations of the block that begins with this number, compared with nothing.

        sample: of the generation.
        """
        found = self._connection.execute(_BLOCKS, (number, number + 1)).fetchone()
        if found is None:
            raise self.damaged(f"the evaluations from {number} on are missing", row.generation)
        try:
            return decoded(found, row.first, sample)
        except _WRONG as error:
            raise self.damaged(_DISAGREE, row.generation) from error

    def damaged(self, what: str, generation: int | None = None) -> DamageError:
        """Return the error for a damaged place."""
        return DamageError(self._file, what, generation)

    def select(self, which: str, *values: int) -> list[Row]:
        """Return lines of the table, not compared with anything."""
        cursor = self._connection.execute(f"SELECT {_COLUMNS} FROM generation {which}", values)  # noqa: S608
        return [_row(found) for found in cursor]


def _side_by_side(blocks: Iterable[tuple[int, bytes]]) -> Iterator[tuple[int, NDArray[np.float64]]]:
    """Yield number of the first and fitness of many evaluations at once: small blocks joined.

    blocks: number of the first evaluation and column of fitness of each.
    """
    parts: list[bytes] = []
    begin, size = 0, 0
    for first, column in blocks:
        if parts and (size >= _JOINED or first != begin + size // 8):
            yield begin, np.frombuffer(b"".join(parts), dtype="<f8")
            parts, size = [], 0
        if not parts:
            begin = first
        parts.append(column)
        size += len(column)
    if parts:
        yield begin, np.frombuffer(b"".join(parts), dtype="<f8")


def digest_before(connection: sqlite3.Connection, generation: int) -> str:
    """Return the digest that a generation's own goes on from; empty for the first."""
    before = connection.execute(
        "SELECT digest FROM generation WHERE generation = ?", (generation - 1,)
    ).fetchone()
    return "" if before is None else str(before[0])


def _row(found: tuple[Any, ...]) -> Row:
    generation, first, seeds, evaluations, *figures, failed, leader, evaluations_digest, digest = found
    best, mean, best_so_far, lower, median, upper = (
        math.nan if value is None else float(value) for value in figures
    )
    summary = Summary(
        generation=int(generation),
        evaluations=int(evaluations),
        best=best,
        mean=mean,
        best_so_far=best_so_far,
        lower_quartile=lower,
        median=median,
        upper_quartile=upper,
        failed=int(failed),
    )
    return Row(
        int(generation), int(first), str(seeds), summary, int(leader), str(evaluations_digest), str(digest)
    )
