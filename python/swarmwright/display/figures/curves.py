"""Curves of runs: the best fitness so far or an indicator, on a shared axis."""

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
"""Largest number of points of a shared axis; finer than a figure can show."""


def best_so_far(run: "Run", x: str) -> tuple[Values, Values]:
    """Return x of each finished generation, and the best fitness up to it.

    x: "evaluations" done at its end, or its number ("generations").
    """
    history = run.history
    xs = [summary.evaluations if x == "evaluations" else summary.generation for summary in history]
    values = [summary.best_so_far if math.isfinite(summary.best_so_far) else math.nan for summary in history]
    return np.array(xs, dtype=np.float64), np.array(values, dtype=np.float64)


def indicator_so_far(indicator: "Indicator", run: "Run", x: str) -> tuple[Values, Values]:
    """Return x and the value of an indicator of fronts or archives for some finished generations."""
    values = indicator.curve(run)
    history = {summary.generation: summary.evaluations for summary in run.history}
    xs = [history[generation] if x == "evaluations" else generation for generation in values]
    return np.array(xs, dtype=np.float64), np.array(list(values.values()), dtype=np.float64)


def align_runs(runs: Sequence["Run"], x: str, curve: Curve = best_so_far) -> tuple[Values, Values, float]:
    """Align the curves of runs on a shared axis.

    curve: returns x and values of a run.

    Returns:
        The axis, (points,); the value of each run, (runs, points), NaN before its first generation and the
        last value after its end; and the end of the shortest run.
    """
    curves = [curve(run, x) for run in runs]
    axis = np.unique(np.concatenate([xs for xs, _ in curves]))
    if len(axis) > _POINTS:
        axis = axis[np.unique(np.linspace(0, len(axis) - 1, _POINTS).round().astype(int))]
    values = np.full((len(runs), len(axis)), np.nan)
    for row, (xs, fitness) in zip(values, curves, strict=True):
        index = np.searchsorted(xs, axis, side="right") - 1
        row[index >= 0] = fitness[index[index >= 0]]
    return axis, values, min(xs[-1] for xs, _ in curves)


def compute_bands(values: Values) -> Values:
    """Return minimum, quartiles and maximum over runs at each point, (5, points); NaN if a run is missing.

    values: (runs, points).
    """
    complete = ~np.isnan(values).any(axis=0)
    quantiles = np.full((5, values.shape[1]), np.nan)
    with np.errstate(over="ignore", invalid="ignore"):
        quantiles[:, complete] = np.quantile(values[:, complete], [0.0, 0.25, 0.5, 0.75, 1.0], axis=0)
    return quantiles
