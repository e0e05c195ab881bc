"""Fitness curves of runs: the best fitness so far, on an axis that several runs share."""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from swarmwright.runs.instances import by_instance

if TYPE_CHECKING:
    from swarmwright.runs.run import Run

Values = NDArray[np.float64]

_POINTS = 600
"""Most points of a shared axis; finer than a figure can show."""


def fitness_at(run: "Run", evaluations: int | None = None) -> tuple[float, int]:
    """Return the best fitness after so many evaluations, NaN if there was none, and after how many it is.

    These are fewer where the run has fewer, or where only finished generations count, see `by_generation`.
    evaluations: None: at the run's end.
    """
    history = run.history
    if evaluations is not None:
        history = [one for one in history if one.evaluations <= evaluations]
    done, best = (history[-1].evaluations, history[-1].best_so_far) if history else (0, math.nan)
    if evaluations is not None and done < min(evaluations, run.evaluations) and not by_generation(run):
        # Within a generation, the record has evaluations in the order in which the method asked for them.
        end = min(evaluations, run.evaluations)
        best, done = float(np.fmax(best, run.store.best_fitness(done, end))), end
    return best if math.isfinite(best) else math.nan, done


def by_generation(run: "Run") -> bool:
    """Whether the best of a run is known at the end of generations only: its fitness may become another."""
    return run.experiment.ranking.reevaluate or by_instance(run.experiment)


def best_so_far(run: "Run", x: str) -> tuple[Values, Values]:
    """Return x of each finished generation, and the best fitness so far there.

    x: "evaluations" done at its end, or its number ("generations").
    """
    history = run.history
    places = [one.evaluations if x == "evaluations" else one.generation for one in history]
    values = [one.best_so_far if math.isfinite(one.best_so_far) else math.nan for one in history]
    return np.array(places, dtype=np.float64), np.array(values, dtype=np.float64)


def together(runs: Sequence["Run"], x: str) -> tuple[Values, Values, float]:
    """Put runs on one axis.

    Returns:
        The axis, (points,); best fitness so far of each run there, (runs, points), NaN before its first
        generation was finished, the last value after its end; and where the shortest run ends.
    """
    curves = [best_so_far(run, x) for run in runs]
    axis = np.unique(np.concatenate([places for places, _ in curves]))
    if len(axis) > _POINTS:
        axis = axis[np.unique(np.linspace(0, len(axis) - 1, _POINTS).round().astype(int))]
    values = np.full((len(runs), len(axis)), np.nan)
    for row, (places, fitness) in zip(values, curves, strict=True):
        index = np.searchsorted(places, axis, side="right") - 1
        row[index >= 0] = fitness[index[index >= 0]]
    return axis, values, min(places[-1] for places, _ in curves)


def bands(values: Values) -> Values:
    """Return minimum, quartiles and maximum over runs at each point, (5, points); NaN where a run is missing.

    values: (runs, points).
    """
    complete = ~np.isnan(values).any(axis=0)
    found = np.full((5, values.shape[1]), np.nan)
    with np.errstate(over="ignore", invalid="ignore"):
        found[:, complete] = np.quantile(values[:, complete], [0.0, 0.25, 0.5, 0.75, 1.0], axis=0)
    return found
