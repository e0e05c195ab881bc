"""All evaluations of a run in a grid of their number and fitness, and the one next to a point of it."""

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from swarmwright.common.errors import InputError

if TYPE_CHECKING:
    from swarmwright.runs.run import Run
    from swarmwright.runs.store import Evaluation

LEAST_SIZE = 1e-300
"""Of a point: smaller ones count as 1."""


@dataclass(frozen=True, eq=False)
class Density:
    """How many evaluations each cell of a grid has."""

    counts: NDArray[np.uint32]
    """(columns, rows): evaluations in the order of the record, fitness from the lowest."""
    evaluations: int
    """Evaluations in the record: the columns share them evenly."""
    lowest: float
    highest: float
    """The range of fitness that the rows share; both 0 where every evaluation failed."""
    failed: int
    """Evaluations that failed, or whose fitness is infinite, which are in no cell."""


def evaluation_density(run: "Run", columns: int = 400, rows: int = 160) -> Density:
    """Return the evaluations of a run as a grid; memory stays flat, however many there are.

    Args:
        run: that is read, every evaluation of it, without its genomes.
        columns: of the grid, 1 to 4,096.
        rows: of the grid, 1 to 4,096.

    Raises InputError when a number is out of range or the store is damaged.
    """
    for name, value in (("columns", columns), ("rows", rows)):
        if not 1 <= value <= 4096:
            raise InputError(f"{name}: must be from 1 to 4096, not {value}")
    fitness = run.fitness
    edges = -(-np.arange(columns + 1, dtype=np.int64) * len(fitness) // columns)
    # Column by column, so that all of one stays in the processor's cache.
    parts = [select_finite(fitness[begin:end]) for begin, end in pairwise(edges)]
    present = [part for part in parts if len(part)]
    lowest = min((float(part.min()) for part in present), default=0.0)
    highest = max((float(part.max()) for part in present), default=0.0)
    scale = 1.0 if math.isfinite(highest - lowest) else 0.5  # the difference of huge numbers is infinite
    span = (highest * scale - lowest * scale) or 1.0
    counts = np.zeros((columns, rows), np.uint32)
    for column, part in zip(counts, parts, strict=True):
        if len(part):
            row = np.minimum((part * scale - lowest * scale) / span * rows, rows - 1).astype(np.int64)
            column[:] = np.bincount(row, minlength=rows)
    failed = len(fitness) - sum(map(len, present))
    return Density(counts, len(fitness), lowest, highest, failed)


def select_finite(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the finite values, without a copy where all are."""
    is_finite = np.isfinite(values)
    return values if is_finite.all() else values[is_finite]


def nearest_evaluation(
    run: "Run", number: float, fitness: float, width: float, height: float
) -> "Evaluation":
    """Return the evaluation that is nearest to a point.

    Args:
        run: whose evaluations these are.
        number: of an evaluation in the record, the abscissa of the point.
        fitness: the ordinate of the point.
        width: evaluations that are as wide as
        height: this much fitness is high.

    Raises RunError when no evaluation has a fitness.
    """
    values = run.fitness
    width, height = (abs(size) if abs(size) > LEAST_SIZE else 1.0 for size in (width, height))
    first, end = (int(min(max(at, 0), len(values))) for at in (number - 20 * width, number + 20 * width + 2))
    part = values[first:end]
    if not np.isfinite(part).any():
        return run.evaluation()
    with np.errstate(over="ignore", invalid="ignore"):
        across = (np.arange(first, first + len(part)) - number) / width
        up = (part / 2 - fitness / 2) / (height / 2)
        apart = np.where(np.isfinite(part), np.hypot(across, up), np.inf)
    return run.evaluation(first + int(np.argmin(np.nan_to_num(apart, nan=np.inf))))
