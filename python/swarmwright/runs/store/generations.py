"""Read the generations of a store and compare them with their digests."""

import hashlib
import math
import sqlite3
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmwright import _engine
from swarmwright.common.arrays import best_first
from swarmwright.common.statistics import Summary
from swarmwright.runs.store import digests
from swarmwright.runs.store.blocks import (
    COLUMNS,
    EvaluationsDigest,
    Record,
    Sample,
    combine_digests,
    decode_block,
)
from swarmwright.runs.store.database import DamageError

_COLUMNS = (
    "generation, first, seeds, evaluations, best, mean, best_so_far, lower_quartile, median, upper_quartile, "
    "failed, leader, evaluations_digest, digest"
)
_SAMPLE = "SELECT address, numbers FROM sample WHERE generation = ?"
_BLOCKS = f"SELECT {COLUMNS} FROM block WHERE first >= ? AND first < ? ORDER BY first"  # noqa: S608 - our own names
_JOINED = 1 << 18
"""Bytes of fitness that are searched at once."""
_JOINED_MEASURED = 1 << 22
"""Bytes of fitness and metrics that are read at once."""
LARGEST = 1 << 62
"""Limit of numbers in queries, above every stored number; SQLite's integers have 64 bits."""
MISSING = "it is missing in the table generation"
ROW_DISAGREES = "the table generation does not match its digest"
_DECODING_ERRORS = (*digests.WRONG_TYPES, ValueError)
_DISAGREE = "the table block does not match its digest"
_BOTH_DISAGREE = "the tables block and sample do not match their digest"


@dataclass(frozen=True)
class Row:
    """A row of the table `generation`."""

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
        """Number of its evaluations."""
        return self.summary.evaluations - self.first

    def digest_after(self, previous: str) -> str:
        """Compute the correct digest of the row from that of the previous generation."""
        summary = self.summary
        return digests.digest_generation(
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
    """The tables `generation` and `block` of an open store.

    Every method raises InputError for damaged content, and sqlite3.Error.

    Args:
        connection: to the store, within one transaction.
        file: the store, for messages.
        end: number of the first generation to ignore, with all later ones.
    """

    def __init__(self, connection: sqlite3.Connection, file: Path, end: int = LARGEST) -> None:
        self._connection = connection
        self._file = file
        self._end = end

    def rows(self) -> list[Row]:
        """Return all finished generations."""
        rows = self.select("WHERE generation < ? ORDER BY generation", self._end)
        previous = ""
        for index, row in enumerate(rows):
            if row.generation != index:
                raise self.build_damage_error(MISSING, index)
            self.check(row, previous)
            previous = row.digest
        self.check_end(rows[-1] if rows else None)
        return rows

    def row(self, generation: int) -> Row | None:
        """Return a generation; None if it does not exist."""
        if abs(generation) > LARGEST or generation >= self._end:
            return None
        rows = self.select("WHERE generation BETWEEN ? AND ? ORDER BY generation", generation - 1, generation)
        if not rows or rows[-1].generation != generation:
            return None
        if generation and len(rows) == 1:
            raise self.build_damage_error(MISSING, generation - 1)
        self.check(rows[-1], rows[0].digest if generation else "")
        return rows[-1]

    def last(self) -> Row | None:
        """Return the last generation; None if none is finished."""
        (number,) = self._connection.execute(
            "SELECT max(generation) FROM generation WHERE generation < ?", (self._end,)
        ).fetchone()
        row = None if number is None else self.row(int(number))
        self.check_end(row)
        return row

    def find_by_evaluation(self, number: int) -> Row | None:
        """Return the generation of an evaluation; None if the evaluation does not exist."""
        if abs(number) > LARGEST:
            return None
        generation = self._connection.execute(
            "SELECT generation, evaluations FROM generation WHERE first <= ? AND generation < ? "
            "ORDER BY generation DESC LIMIT 1",
            (number, self._end),
        ).fetchone()
        return None if generation is None or generation[1] <= number else self.row(int(generation[0]))

    def check(self, row: Row, previous: str) -> None:
        """Compare a row with its digest."""
        if row.digest != self.compute_digest(row, previous):
            raise self.build_damage_error(ROW_DISAGREES, row.generation)

    def compute_digest(self, row: Row, previous: str) -> str:
        """Compute the correct digest of a row."""
        try:
            return row.digest_after(previous)
        except digests.WRONG_TYPES as error:
            raise self.build_damage_error(
                f"the table generation cannot be read: {error}", row.generation
            ) from error

    def check_end(self, last: Row | None) -> None:
        """Check that there is no evaluation after the last generation, unless generations are ignored."""
        if self._ignores_generations:
            return
        # The blocks of earlier generations, which may be many, are compared when they are read.
        begin, evaluations = (-(2**63), 0) if last is None else (last.first, last.summary.evaluations)
        (most,) = self._connection.execute(
            "SELECT max(first + evaluations) FROM block WHERE first >= ?", (begin,)
        ).fetchone()
        if most is not None and most > evaluations:
            raise self.build_damage_error(
                f"evaluations from {evaluations} to {most - 1} belong to no generation"
            )

    @property
    def _ignores_generations(self) -> bool:
        cursor = self._connection.execute(
            "SELECT 1 FROM generation WHERE generation >= ? LIMIT 1", (self._end,)
        )
        return cursor.fetchone() is not None

    def sample(self, row: Row) -> _engine.Sample | None:
        """Return the sample that a generation's genomes are made from; None if the blocks have genomes."""
        stored = self._read_sample(row)
        if stored is None:
            return None
        try:
            sample = _engine.Sample.read(*stored)
        except _DECODING_ERRORS as error:
            raise self.build_damage_error(_BOTH_DISAGREE, row.generation) from error
        if len(sample) != row.count:
            raise self.build_damage_error(_BOTH_DISAGREE, row.generation)
        return sample

    def _read_sample(self, row: Row) -> Sample | None:
        sample: Sample | None = self._connection.execute(_SAMPLE, (row.generation,)).fetchone()
        return sample

    def evaluations(self, row: Row, *, make_genomes: bool = True) -> Iterator[Record]:
        """Yield the evaluations of a generation, block by block, then compare them with the digest.

        make_genomes: make genomes from the sample if there is one; otherwise they have no genes then.
        """
        cursor = self._connection.execute(_BLOCKS, (row.first, row.summary.evaluations))
        stored, sample, next_ = self._read_sample(row), self.sample(row), row.first
        disagree = _DISAGREE if sample is None else _BOTH_DISAGREE
        total = EvaluationsDigest(stored)
        for block in cursor:
            try:
                if block[0] != next_ or block[1] != row.generation:
                    break
                total.add(block)
                part = decode_block(block, row.first, sample if make_genomes else None)
            except _DECODING_ERRORS as error:
                raise self.build_damage_error(disagree, row.generation) from error
            next_ += len(part.fitness)
            yield part
        missing = row.summary.evaluations - next_
        if missing:
            raise self.build_damage_error(f"{missing} evaluations are missing", row.generation)
        if combine_digests(total.columns(), row.first, row.generation, row.count) != row.evaluations_digest:
            raise self.build_damage_error(disagree, row.generation)

    def seeds(self) -> set[str]:
        """Return the seeds of all generations, each as JSON, without checking digests."""
        cursor = self._connection.execute(
            "SELECT DISTINCT seeds FROM generation WHERE generation < ?", (self._end,)
        )
        return {str(text) for (text,) in cursor}

    def rank_by_fitness(self, first: int, most: int) -> NDArray[np.int64]:
        """Return the numbers of the best successful evaluations from `first` on, the best first.

        Equals are in the order of their numbers. Only the fitness is read, block by block, without checking
        digests.

        Args:
            first: number of the first evaluation that counts.
            most: largest number of evaluations to return.
        """
        cursor = self._connection.execute(
            "SELECT first, fitness FROM block WHERE first + evaluations > ? AND generation < ? "
            "ORDER BY first",
            (first, self._end),
        )
        number, value = np.zeros(0, np.int64), np.zeros(0)
        try:
            for begin, fitness in _join_small_blocks(cursor):
                counts = np.isfinite(fitness)
                counts[: max(first - begin, 0)] = False
                if len(value) >= most:  # later evaluations must be better
                    counts &= fitness > value[most - 1]
                rows = np.flatnonzero(counts)
                number = np.concatenate([number, begin + rows])
                value = np.concatenate([value, fitness[rows]])
                if len(value) > most > 0:  # sort only possible winners
                    least = np.partition(value, -most)[-most]
                    number, value = number[value >= least], value[value >= least]
                chosen = best_first(value)[:most]
                number, value = number[chosen], value[chosen]
        except _DECODING_ERRORS as error:
            raise self.build_damage_error(_DISAGREE) from error
        return number

    def fitness(self) -> NDArray[np.float64]:
        """Return the fitness of every evaluation, in order, without reading or verifying other columns."""
        cursor = self._connection.execute(
            "SELECT first, fitness FROM block WHERE generation < ? ORDER BY first", (self._end,)
        )
        try:
            columns = [column for _, column in _join_small_blocks(cursor)]
        except _DECODING_ERRORS as error:
            raise self.build_damage_error(_DISAGREE) from error
        return np.concatenate(columns) if columns else np.zeros(0)

    def ends(self) -> NDArray[np.int64]:
        """Return the number of evaluations after each generation, in order, without checking digests."""
        cursor = self._connection.execute(
            "SELECT evaluations FROM generation WHERE generation < ? ORDER BY generation", (self._end,)
        )
        return np.array([end for (end,) in cursor], dtype=np.int64)

    def iterate_parts(
        self, ends: Sequence[int], metrics: int, start: int = 0
    ) -> Iterator[tuple[int, NDArray[np.float64], NDArray[np.float64]]]:
        """Yield the fitness and the metrics of evaluations in parts, without checking digests.

        Each has the number of its first evaluation, fitness (n,) and metrics (n, episodes, metrics).

        Args:
            ends: ascending numbers of evaluations at which a part ends, each that of a generation.
            metrics: number of stored metrics.
            start: number of the first evaluation, the first of a generation.
        """
        cursor = self._connection.execute(
            "SELECT first, evaluations, fitness, metrics FROM block WHERE generation < ? AND first >= ? "
            "ORDER BY first",
            (self._end, start),
        )
        try:
            parts: list[tuple[bytes, bytes]] = []
            begin = done = size = 0
            borders = iter([*ends, LARGEST])
            border = next(borders)
            for first, count, fitness, values in cursor:
                if not parts:
                    begin = first
                parts.append((fitness, values))
                done, size = first + count, size + len(fitness) + len(values)
                if done >= border or size >= _JOINED_MEASURED:
                    yield begin, *_join_measured(parts, metrics)
                    parts, size = [], 0
                    while done >= border:
                        border = next(borders)
            if parts:
                yield begin, *_join_measured(parts, metrics)
        except _DECODING_ERRORS as error:
            raise self.build_damage_error(_DISAGREE) from error

    def measure_bytes(self, row: Row) -> int:
        """Return the bytes of an evaluation of a generation."""
        size = self._connection.execute(
            "SELECT (length(fitness) + length(episodes) + length(metrics) + length(genomes)) / evaluations "
            "FROM block WHERE first >= ? AND first < ? LIMIT 1",
            (row.first, row.summary.evaluations),
        ).fetchone()
        return 0 if size is None else int(size[0])

    def best_fitness(self, first: int, end: int) -> float:
        """Return the best fitness of the evaluations from `first` to before `end`; NaN if all failed.

        Only the fitness is read, without checking digests.
        """
        cursor = self._connection.execute(
            "SELECT first, fitness FROM block WHERE first + evaluations > ? AND first < ? ORDER BY first",
            (first, end),
        )
        best = -math.inf
        try:
            for begin, fitness in _join_small_blocks(cursor):
                selected = fitness[max(first - begin, 0) : end - begin]
                best = float(selected.max(initial=best, where=np.isfinite(selected)))
        except _DECODING_ERRORS as error:
            raise self.build_damage_error(_DISAGREE) from error
        return best if math.isfinite(best) else math.nan

    def select_by_fitness(
        self, value: float, first: int, end: int, metrics: int
    ) -> Iterator[tuple[NDArray[np.int64], NDArray[np.float64]]]:
        """Yield the evaluations with this fitness from `first` to before `end`, block by block.

        Each item has their numbers in the run, ascending, and their metrics, (evaluations, episodes,
        metrics). Only fitness and metrics are read, without checking digests.

        metrics: number of stored metrics.
        """
        cursor = self._connection.execute(
            "SELECT first, fitness FROM block WHERE first + evaluations > ? AND first < ? ORDER BY first",
            (first, end),
        )
        try:
            for begin, fitness in cursor:
                column = np.frombuffer(fitness, dtype="<f8")
                rows = np.flatnonzero(column == value)
                rows = rows[(rows >= first - begin) & (rows < end - begin)]
                if not len(rows):
                    continue
                (stored,) = self._connection.execute(
                    "SELECT metrics FROM block WHERE first = ?", (begin,)
                ).fetchone()
                table = np.frombuffer(stored, dtype="<f8").reshape(len(column), -1, metrics)
                yield begin + rows, table[rows].astype(np.float64)
        except _DECODING_ERRORS as error:
            raise self.build_damage_error(_DISAGREE) from error

    def find_by_genome(self, genome: bytes, last: int) -> list[int]:
        """Return the numbers of a genome's evaluations up to the number `last`, ascending.

        Digests are not checked. Empty if genomes are made from a sample.
        """
        cursor = self._connection.execute(
            "SELECT first, evaluations, genomes FROM block WHERE first <= ? ORDER BY first", (last,)
        )
        numbers: list[int] = []
        try:
            for first, count, genomes in cursor:
                if len(genomes) == count * len(genome) > 0:
                    block = np.frombuffer(genomes, dtype=f"V{len(genome)}")
                    rows = np.flatnonzero(block == np.void(genome))
                    numbers += (first + rows[first + rows <= last]).tolist()
        except _DECODING_ERRORS as error:
            raise self.build_damage_error(_DISAGREE) from error
        return numbers

    def rank_by_instances(self, most: int) -> list[int]:
        """Return the number of each genome's last evaluation, genomes with the most evaluations first.

        Ties are broken by higher fitness, then by the lower number. Genomes whose last evaluation failed are
        omitted. Digests are not checked.
        """
        cursor = self._connection.execute(
            "SELECT first, evaluations, fitness, genomes FROM block WHERE generation < ? ORDER BY first",
            (self._end,),
        )
        genome_entries: dict[bytes, list[float]] = {}  # evaluations, fitness and number of the last
        try:
            for first, count, column, genomes in cursor:
                size = len(genomes) // count
                for index, value in enumerate(np.frombuffer(column, dtype="<f8").tolist()):
                    genome = genomes[index * size : (index + 1) * size]
                    key = hashlib.blake2b(genome, digest_size=16).digest()
                    entry = genome_entries.setdefault(key, [0, 0, 0])
                    entry[:] = entry[0] + 1, value, first + index
        except _DECODING_ERRORS as error:
            raise self.build_damage_error(_DISAGREE) from error
        entries = sorted(
            (entry for entry in genome_entries.values() if math.isfinite(entry[1])),
            key=lambda entry: (-entry[0], -entry[1], entry[2]),
        )
        return [int(number) for _, _, number in entries[:most]]

    def read_verified(self, row: Row, most: int) -> list[Record] | None:
        """Compare the evaluations of a generation with their digest, and return the blocks.

        most: bytes; if several blocks have more, None is returned.
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
        for _ in self.evaluations(row, make_genomes=False):
            pass
        return None

    def block(self, row: Row, number: int, sample: _engine.Sample | None) -> Record:
        """Return the evaluations of the block that begins with this number, without checking digests.

        sample: sample of the generation.
        """
        block = self._connection.execute(_BLOCKS, (number, number + 1)).fetchone()
        if block is None:
            raise self.build_damage_error(f"the evaluations from {number} on are missing", row.generation)
        try:
            return decode_block(block, row.first, sample)
        except _DECODING_ERRORS as error:
            raise self.build_damage_error(_DISAGREE, row.generation) from error

    def build_damage_error(self, reason: str, generation: int | None = None) -> DamageError:
        """Create the error for damaged content."""
        return DamageError(self._file, reason, generation)

    def select(self, clause: str, *values: int) -> list[Row]:
        """Return rows of the table without checking their digests."""
        cursor = self._connection.execute(f"SELECT {_COLUMNS} FROM generation {clause}", values)  # noqa: S608
        return [_parse_row(columns) for columns in cursor]


def _join_small_blocks(blocks: Iterable[tuple[int, bytes]]) -> Iterator[tuple[int, NDArray[np.float64]]]:
    """Join consecutive small blocks; yield the number of the first evaluation, and the fitness of all.

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


def _join_measured(
    parts: Sequence[tuple[bytes, bytes]], metrics: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the numbers of consecutive blocks: fitness, (n,), and metrics, (n, episodes, metrics)."""
    fitness, values = (np.frombuffer(b"".join(column), dtype="<f8") for column in zip(*parts, strict=True))
    return fitness, values.reshape(len(fitness), -1, metrics)


def digest_before(connection: sqlite3.Connection, generation: int) -> str:
    """Return the digest of the generation before; empty for the first."""
    before = connection.execute(
        "SELECT digest FROM generation WHERE generation = ?", (generation - 1,)
    ).fetchone()
    return "" if before is None else str(before[0])


def _parse_row(columns: tuple[Any, ...]) -> Row:
    generation, first, seeds, evaluations, *figures, failed, leader, evaluations_digest, digest = columns
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
