"""All evaluations of a run in a grid of their number and fitness, and the one next to a point of it."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from swarmwright.common.errors import InputError

if TYPE_CHECKING:
    from swarmwright.runs.run import Run
    from swarmwright.runs.store import Evaluation


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
    is_finite = np.isfinite(fitness)
    lowest, highest = 0.0, 0.0
    if is_finite.any():
        lowest, highest = float(fitness[is_finite].min()), float(fitness[is_finite].max())
    column = np.arange(len(fitness), dtype=np.int64) * columns // max(len(fitness), 1)
    span = (highest - lowest) or 1.0
    row = np.minimum((fitness[is_finite] - lowest) / span * rows, rows - 1).astype(np.int64)
    counts = np.bincount(column[is_finite] * rows + row, minlength=columns * rows)
    return Density(
        counts.reshape(columns, rows).astype(np.uint32),
        len(fitness),
        lowest,
        highest,
        int(len(fitness) - is_finite.sum()),
    )


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
    first = max(0, int(number - 20 * width))
    part = values[first : int(number + 20 * width) + 2]
    if not np.isfinite(part).any():
        return run.evaluation()
    apart = ((np.arange(first, first + len(part)) - number) / (width or 1.0)) ** 2
    apart += np.where(np.isfinite(part), (part - fitness) / (height or 1.0), np.inf) ** 2
    return run.evaluation(first + int(np.argmin(apart)))
