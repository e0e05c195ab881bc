"""Which candidate of a run is looked at, and what the run says about it."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmwright._errors import InputError
from swarmwright._run import Run


@dataclass(frozen=True)
class Choice:
    """One candidate of a run."""

    generation: int
    candidate: int
    """Index among the candidates evaluated in that generation."""
    fitness: float
    """As the run's ranking made it of all episodes; NaN when the evaluation failed."""
    specification: dict[str, Any]
    """The controller as plain values."""


def choose(run: Run, generation: int | None = None, candidate: int | None = None) -> Choice:
    """Return a candidate of the run.

    Args:
        run: where to look.
        generation: from 0; None: the generation of the run's best candidate.
        candidate: index among the candidates evaluated in that generation; None: the best of them.

    Raises:
        InputError: the run has no such generation or candidate, or a candidate is named without a generation.
        RunError: the run holds nothing at all.
    """
    if generation is None:
        if candidate is not None:
            raise InputError(f"candidate {candidate}: of which generation? Name one, too")
        best = run.best
        return Choice(best.generation, best.candidate, best.fitness, best.specification)
    record = run.record
    rows = np.flatnonzero(record.generation == generation)
    if not len(rows):
        raise InputError(
            f"generation {generation}: {run.path} has none of that number; it holds "
            f"{_range(run.generations, 'generation')}"
        )
    if candidate is None:
        row = _best(record.fitness, rows)
    else:
        found = rows[record.candidate[rows] == candidate]
        if not len(found):
            raise InputError(
                f"candidate {candidate}: generation {generation} has none of that number; it holds "
                f"{_range(len(rows), 'candidate')}"
            )
        row = int(found[0])
    return Choice(
        generation,
        int(record.candidate[row]),
        float(record.fitness[row]),
        run.experiment.representation().specification(record.genomes[row]),
    )


def _best(fitness: NDArray[np.float64], rows: NDArray[np.intp]) -> int:
    """Return the row with the best fitness; failed ones come last, of equals the first."""
    values = np.where(np.isnan(fitness[rows]), -np.inf, fitness[rows])
    return int(rows[np.argmax(values)])


def _range(count: int, what: str) -> str:
    if count == 0:
        return f"no finished {what}"
    return f"one {what}, number 0" if count == 1 else f"{what}s 0 to {count - 1}"
