"""Curves of runs: the best fitness so far or an indicator, on an axis that several runs share."""

import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from swarmwright.analysis.indicators import Indicator
    from swarmwright.runs.run import Run

Values = NDArray[np.float64]
Curve = Callable[["Run", str], tuple[Values, Values]]

_POINTS = 600
"""Most points of a shared axis; finer than a figure can show."""


def best_so_far(run: "Run", x: str) -> tuple[Values, Values]:
    """Return x of each finished generation, and the best fitness so far there.

    x: "evaluations" done at its end, or its number ("generations").
    """
    history = run.history
    places = [summary.evaluations if x == "evaluations" else summary.generation for summary in history]
    values = [summary.best_so_far if math.isfinite(summary.best_so_far) else math.nan for summary in history]
    return np.array(places, dtype=np.float64), np.array(values, dtype=np.float64)


def indicator_so_far(indicator: "Indicator", run: "Run", x: str) -> tuple[Values, Values]:
    """Return x of some finished generations, and an indicator of fronts or archives there."""
    found = indicator.curve(run)
    history = {summary.generation: summary.evaluations for summary in run.history}
    places = [history[generation] if x == "evaluations" else generation for generation in found]
    return np.array(places, dtype=np.float64), np.array(list(found.values()), dtype=np.float64)


def together(runs: Sequence["Run"], x: str, curve: Curve = best_so_far) -> tuple[Values, Values, float]:
    """Put runs on one axis.

    curve: of a run, x of some generations and a value there.

    Returns:
        The axis, (points,); the value of each run there, (runs, points), NaN before its first
        generation was finished, the last value after its end; and where the shortest run ends.
    """
    curves = [curve(run, x) for run in runs]
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
