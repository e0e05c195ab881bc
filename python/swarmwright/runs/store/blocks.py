"""Evaluations as columns of numbers, and as the blocks of bytes in which the store keeps them."""

import hashlib
import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmwright import _engine
from swarmwright.common.arrays import Genomes
from swarmwright.common.values import ComparedByValue
from swarmwright.servers.rows import GenerationResult

_BLOCK = 1 << 22
"""Bytes that a block has at most, unless a single evaluation has more."""
_GENERATION = struct.Struct("<3q")
_COLUMNS = ("fitness", "episodes", "metrics", "genomes")
_KINDS = ("<f8", "<f8", "<f8", "<f4")
_DOUBLE, _SINGLE = np.dtype("<f8"), np.dtype("<f4")

COLUMNS = "first, generation, evaluations, fitness, episodes, metrics, genomes"
"""Columns of the table `block`."""

Column = bytes | memoryview
Block = tuple[int, int, int, Column, Column, Column, Column]
"""A row of the table."""
Sample = tuple[str, bytes]
"""What the genomes of a generation are made from: address and numbers of the table `sample`."""


@dataclass(frozen=True, eq=False)
class Record(ComparedByValue):
    """Evaluations of a run, sorted by generation and candidate."""

    generation: NDArray[np.int64]
    """(evaluations,)"""
    candidate: NDArray[np.int64]
    """(evaluations,)"""
    fitness: NDArray[np.float64]
    """(evaluations,), NaN where it failed."""
    episodes: NDArray[np.float64]
    """(evaluations, episodes)"""
    metrics: NDArray[np.float64]
    """(evaluations, episodes, metrics)"""
    genomes: NDArray[np.float32]
    """(evaluations, genome_size)"""

    @property
    def nbytes(self) -> int:
        """Bytes of its numbers, but for those that say which evaluations they are."""
        return sum(int(getattr(self, name).nbytes) for name in _COLUMNS)


def joined(parts: list[Record], metrics: int) -> Record:
    """Return consecutive parts as one. Raises ValueError when they do not fit together.

    metrics: how many there are, for a record without evaluations.
    """
    if not parts:
        none = np.zeros(0, dtype=np.int64)
        numbers = np.zeros(0)
        return Record(
            none, none, numbers, np.zeros((0, 0)), np.zeros((0, 0, metrics)), np.zeros((0, 0), np.float32)
        )
    if len(parts) == 1:
        return parts[0]
    names = ("generation", "candidate", *_COLUMNS)
    return Record(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


class EvaluationsDigest:
    """SHA-256 of the evaluations of a generation, whatever the blocks that they are in.

    sample: what its genomes are made from; None where the blocks have them.
    """

    def __init__(self, sample: Sample | None = None) -> None:
        self._sums = [hashlib.sha256() for _ in _COLUMNS]
        if sample is not None:
            address, numbers = sample
            self._sums[-1].update(address.encode())
            self._sums[-1].update(numbers)

    def add(self, block: Block) -> None:
        """Take in the next block of the generation. Raises TypeError for what is not a block."""
        for total, column in zip(self._sums, block[3:], strict=True):
            total.update(column)

    def columns(self) -> list[bytes]:
        """Return the digest of each column, of all that was taken in."""
        return [total.digest() for total in self._sums]


def of_columns(digests: Sequence[bytes], first: int, generation: int, evaluations: int) -> str:
    """Return the digest of a generation's evaluations, made of those of its columns.

    first: number of the generation's first evaluation. evaluations: how many it has.
    """
    return hashlib.sha256(_GENERATION.pack(first, generation, evaluations) + b"".join(digests)).hexdigest()


def encoded(result: GenerationResult, first: int) -> Iterator[Block]:
    """Yield the blocks of a generation; `first` is the number of its first evaluation."""
    # One representation of each value: NaN has many, and zero has two.
    fitness = result.fitness + 0.0
    if result.summary.failed:
        fitness[np.isnan(fitness)] = np.nan
    columns = (_plain(fitness), _plain(result.episodes), _plain(result.metrics), _genomes(result.genomes))
    count = len(fitness)
    whole = sum([column.nbytes for column in columns])
    size = count if whole <= _BLOCK else max(1, _BLOCK * count // whole)
    for start in range(0, count, max(size, 1)):
        parts = columns if size >= count else [column[start : start + size] for column in columns]
        yield (
            *(first + start, result.generation, len(parts[0])),
            *(_column(parts[0]), _column(parts[1]), _column(parts[2]), _column(parts[3])),
        )


def _plain(numbers: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return numbers as they are stored: those of the engine are already."""
    if numbers.dtype == _DOUBLE and numbers.flags.c_contiguous:
        return numbers
    return np.ascontiguousarray(numbers, dtype=_DOUBLE)


def _genomes(genomes: Genomes | _engine.Sample) -> NDArray[Any]:
    """Return the genomes that blocks have: none of them where they are made from a sample."""
    if isinstance(genomes, _engine.Sample):
        return np.empty((len(genomes), 0), dtype=_SINGLE)
    return np.ascontiguousarray(genomes, dtype=_SINGLE)


def _column(part: NDArray[Any]) -> Column:
    return part.data if part.size else b""  # no copy; but there is none of what is empty


def decoded(block: Block, first: int, sample: _engine.Sample | None = None) -> Record:
    """Return a block's evaluations.

    Args:
        block: as it is stored.
        first: number of the first evaluation of its generation.
        sample: what the genomes of the generation are made from, where the block has none.

    Raises:
        ValueError, TypeError: it is not what the store writes.
    """
    begin, generation, count = block[:3]
    columns: list[NDArray[Any]] = [
        np.frombuffer(column, dtype=kind).astype(kind[1:])
        for column, kind in zip(block[3:], _KINDS, strict=True)
    ]
    fitness, episodes, values, genomes = columns
    episodes = episodes.reshape(count, -1)
    if sample is not None:
        genomes = sample.genomes(begin - first, count)
    return Record(
        np.full(count, generation, dtype=np.int64),
        np.arange(begin - first, begin - first + count, dtype=np.int64),
        fitness.reshape(count),
        episodes,
        values.reshape(*episodes.shape, -1),
        genomes.reshape(count, -1),
    )
