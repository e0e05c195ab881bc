"""Evaluations as columns of numbers, and as the blocks of bytes that the store keeps."""

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

_BLOCK_BYTES = 1 << 22
"""Largest size of a block, unless a single evaluation is larger."""
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
"""Sample that the genomes of a generation are made from: address and numbers of the table `sample`."""


@dataclass(frozen=True, eq=False)
class Record(ComparedByValue):
    """Evaluations of a run, sorted by generation and candidate."""

    generation: NDArray[np.int64]
    """(evaluations,)"""
    candidate: NDArray[np.int64]
    """(evaluations,)"""
    fitness: NDArray[np.float64]
    """(evaluations,), NaN for failed evaluations."""
    episodes: NDArray[np.float64]
    """(evaluations, episodes)"""
    metrics: NDArray[np.float64]
    """(evaluations, episodes, metrics)"""
    genomes: NDArray[np.float32]
    """(evaluations, genome_size)"""

    @property
    def nbytes(self) -> int:
        """Bytes of its numbers, without generation and candidate."""
        return sum(int(getattr(self, name).nbytes) for name in _COLUMNS)


def concatenate_records(parts: list[Record], metrics: int) -> Record:
    """Concatenate consecutive parts. Raises ValueError when their shapes differ.

    metrics: number of metrics, for a record without evaluations.
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
    """SHA-256 of the evaluations of a generation, independent of their division into blocks.

    sample: sample that its genomes are made from; None if the blocks have the genomes.
    """

    def __init__(self, sample: Sample | None = None) -> None:
        self._sums = [hashlib.sha256() for _ in _COLUMNS]
        if sample is not None:
            address, numbers = sample
            self._sums[-1].update(address.encode())
            self._sums[-1].update(numbers)

    def add(self, block: Block) -> None:
        """Add the next block of the generation. Raises TypeError for an invalid block."""
        for total, column in zip(self._sums, block[3:], strict=True):
            total.update(column)

    def columns(self) -> list[bytes]:
        """Return the digest of each column of the blocks so far."""
        return [total.digest() for total in self._sums]


def combine_digests(digests: Sequence[bytes], first: int, generation: int, evaluations: int) -> str:
    """Combine the digests of columns into the digest of a generation's evaluations.

    first: number of the generation's first evaluation. evaluations: their number.
    """
    return hashlib.sha256(_GENERATION.pack(first, generation, evaluations) + b"".join(digests)).hexdigest()


def encode_blocks(result: GenerationResult, first: int) -> Iterator[Block]:
    """Encode a generation as blocks; `first` is the number of its first evaluation."""
    # Normalize NaN and zero, which have several representations.
    fitness = result.fitness + 0.0
    if result.summary.failed:
        fitness[np.isnan(fitness)] = np.nan
    columns = (_plain(fitness), _plain(result.episodes), _plain(result.metrics), _genomes(result.genomes))
    count = len(fitness)
    whole = sum([column.nbytes for column in columns])
    size = count if whole <= _BLOCK_BYTES else max(1, _BLOCK_BYTES * count // whole)
    for start in range(0, count, max(size, 1)):
        parts = columns if size >= count else [column[start : start + size] for column in columns]
        yield (
            *(first + start, result.generation, len(parts[0])),
            *(_column(parts[0]), _column(parts[1]), _column(parts[2]), _column(parts[3])),
        )


def _plain(numbers: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return numbers in the layout of the store, which the engine's already have."""
    if numbers.dtype == _DOUBLE and numbers.flags.c_contiguous:
        return numbers
    return np.ascontiguousarray(numbers, dtype=_DOUBLE)


def _genomes(genomes: Genomes | _engine.Sample) -> NDArray[Any]:
    """Return the genomes for the blocks, without genes if they are made from a sample."""
    if isinstance(genomes, _engine.Sample):
        return np.empty((len(genomes), 0), dtype=_SINGLE)
    return np.ascontiguousarray(genomes, dtype=_SINGLE)


def _column(part: NDArray[Any]) -> Column:
    return part.data if part.size else b""  # without a copy; an empty array has no buffer


def decode_block(block: Block, first: int, sample: _engine.Sample | None = None) -> Record:
    """Decode the evaluations of a block.

    Args:
        block: a row of the table.
        first: number of the first evaluation of its generation.
        sample: sample that the genomes of the generation are made from, if the block has none.

    Raises:
        ValueError, TypeError: the block is invalid.
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
