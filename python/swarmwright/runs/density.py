"""The evaluations of a run, counted in a grid over number and fitness; the evaluation nearest to a point."""

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
    """Number of evaluations in each cell of a grid."""

    counts: NDArray[np.uint32]
    """(columns, rows): number in the record along the columns, fitness along the rows, from the lowest."""
    evaluations: int
    """Number of evaluations in the record, which the columns share evenly."""
    lowest: float
    highest: float
    """Lowest and highest fitness, which the rows share evenly; both 0 if every evaluation failed."""
    failed: int
    """Number of evaluations that failed or have infinite fitness, which are not counted in cells."""


def evaluation_density(run: "Run", columns: int = 400, rows: int = 160) -> Density:
    """Count the evaluations of a run in a grid; memory use does not depend on their number.

    Args:
        run: the run, of which the fitness of every evaluation is read.
        columns: number of columns of the grid, 1 to 4,096.
        rows: number of rows of the grid, 1 to 4,096.

    Raises InputError if a number is out of range or the store is damaged.
    """
    for name, value in (("columns", columns), ("rows", rows)):
        if not 1 <= value <= 4096:
            raise InputError(f"{name}: must be from 1 to 4096, not {value}")
    fitness = run.fitness
    edges = -(-np.arange(columns + 1, dtype=np.int64) * len(fitness) // columns)
    # Column by column, so that the values of a column stay in the processor's cache.
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
    """Return the finite values, without copying if all are finite."""
    is_finite = np.isfinite(values)
    return values if is_finite.all() else values[is_finite]


def nearest_evaluation(
    run: "Run", number: float, fitness: float, width: float, height: float
) -> "Evaluation":
    """Return the evaluation that is nearest to a point.

    Args:
        run: the run with the evaluations.
        number: abscissa of the point, as the number of an evaluation in the record.
        fitness: ordinate of the point.
        width: number of evaluations that counts as the unit of distance.
        height: difference of fitness that counts as the unit of distance.

    Raises RunError if no evaluation has a fitness.
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
