"""The figure of a run: fitness and diversity."""

import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from swarmwright.common.formatting import format_count
from swarmwright.common.simulation_names import label_of
from swarmwright.display.figures.style import (
    AXES,
    COLORS,
    INK,
    PAPER,
    SOFT,
    clip_drawable,
    current_page,
    cut_axis,
    describe_far_below,
    draw_title,
    fit_columns,
    new_figure,
    scale_points,
    set_integer_ticks,
    style_axes,
    use_style_fonts,
    wrap_above_axes,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    from swarmwright.analysis.indicators import Indicator
    from swarmwright.experiment.experiment import Experiment
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


_BEST, _MEAN, _SPREAD = COLORS[2], COLORS[1], COLORS[0]
_MARGIN, _PAGE_MARGIN = 0.14, 0.22
"""Margin above and below curves, relative to their height; larger on pages."""
_LEGEND_LINE_INCHES = 0.22
"""Height of a line of the legend on screens, in inches."""
_ONE_ROW = 80
"""Characters below which a legend has one row."""


@use_style_fonts()
def draw(run: "Run", diversity: "NDArray[np.float64]", *, x: str = "evaluations") -> "Figure":
    """Return the figure.

    Args:
        run: a run with at least one finished generation.
        diversity: diversity of each generation, (generations,), see `swarmwright.runs.diversity`.
        x: "evaluations" or "generations".
    """
    history = run.history
    places = np.array(
        [summary.evaluations if x == "evaluations" else summary.generation for summary in history],
        dtype=float,
    )
    figure = new_figure(9, 6.6)
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=[2.6, 1])
    _draw_fitness(upper, run, places)
    _draw_diversity(lower, diversity, places)
    style_axes(upper, y="fitness (more is better)")
    continuous = run.experiment.representation().continuous
    style_axes(
        lower,
        x=AXES[x],
        y="diversity"
        if current_page().narrow
        else "diversity\n(first generation: 1)"
        if continuous
        else "diversity\n(genes that differ)",
    )
    set_integer_ticks(lower.xaxis, places)
    _draw_titles(figure, upper, run)
    return figure


@use_style_fonts()
def fitness(run: "Run") -> "Figure":
    """Return the figure of fitness over generations only. run: with at least one finished generation."""
    places = np.array([summary.generation for summary in run.history], dtype=float)
    figure = new_figure(9, 5.2)
    axes = figure.subplots()
    _draw_fitness(axes, run, places)
    style_axes(axes, x=AXES["generations"], y="fitness (more is better)")
    set_integer_ticks(axes.xaxis, places)
    _draw_titles(figure, axes, run)
    return figure


def title_of(experiment: "Experiment") -> str:
    """Return the title of a run: subject, method and controller."""
    method = label_of(experiment.method.kind)
    kind: str = experiment.controller.kind
    article = "an" if kind[0] in "aeiou" else "a"
    return f"{experiment.subject}: {method} evolves {article} {kind} controller"


def _draw_titles(figure: "Figure", upper: "Axes", run: "Run") -> None:
    """Draw title and legend."""
    experiment = run.experiment
    failed = sum(summary.failed for summary in run.history)
    draw_title(figure, title_of(experiment))
    upper.set_title(
        wrap_above_axes(
            f"{format_count(run.evaluations, 'evaluation')} in "
            f"{format_count(run.generations, 'generation')}, seed {experiment.seed}" + (f", {failed:,} "
            "failed" if failed else "")
        ),
        loc="left", fontsize=scale_points(10.5), color=SOFT,
    )  # fmt: skip
    handles, labels = upper.get_legend_handles_labels()
    most = 4 if sum(map(len, labels)) < _ONE_ROW else 2
    columns = fit_columns(labels, most)
    if columns < min(most, len(labels)):
        rows = [-(-len(labels) // count) for count in (columns, most)]
        figure.set_figheight(figure.get_figheight() + scale_points(_LEGEND_LINE_INCHES) * (rows[0] - rows[1]))
    figure.legend(
        handles, labels, loc="outside lower center", ncols=columns, fontsize=scale_points(10.5),
        frameon=False, labelcolor=INK,
    )  # fmt: skip


def _draw_fitness(axes: "Axes", run: "Run", places: "NDArray[np.float64]") -> None:
    history = run.history
    marker = "o" if len(history) == 1 else None

    def column(name: str) -> "NDArray[np.float64]":
        values = np.array([getattr(summary, name) for summary in history], dtype=np.float64)
        return clip_drawable(np.where(np.isfinite(values), values, np.nan))

    quartiles = column("lower_quartile"), column("upper_quartile")
    half: dict[str, Any] = {"color": _MEAN, "alpha": 0.18, "label": "middle half of the population"}
    if len(history) == 1:
        axes.vlines(places, *quartiles, linewidth=scale_points(12), **half)
    else:
        axes.fill_between(places, *quartiles, linewidth=0, **half)
    best = column("best_so_far")
    current_best = column("best")
    drawn = np.stack([quartiles[0], quartiles[1], best, current_best])
    mean = column("mean")
    outside = describe_far_below(places, drawn.min(axis=0), drawn.max(axis=0), mean)
    axes.plot(places, mean, color=_MEAN, linewidth=scale_points(1.4), marker=marker, label="mean")
    if outside is None:
        drawn = np.vstack([drawn, mean])
    if not np.array_equal(current_best, best, equal_nan=True):  # elitist methods keep their best
        axes.step(
            places, current_best, where="post", color=_BEST, linewidth=scale_points(1.0), marker=marker,
            alpha=0.6, label="best of the population",
        )  # fmt: skip
    axes.step(
        places,
        best,
        where="post",
        color=_BEST,
        linewidth=scale_points(2.4),
        marker=marker,
        label=run.best_words,
    )
    if np.isnan(best).all():
        axes.text(0.5, 0.5, "every candidate failed", transform=axes.transAxes, ha="center", color=SOFT)
        return
    # With racing and `reevaluate` the curve may fall; then the best of the run is the last value.
    finite = np.flatnonzero(~np.isnan(best))
    best_index = int(finite[-1])
    if (np.diff(best[finite]) >= 0).all():
        best_index = int(finite[best[finite] == best[best_index]][0])
    axes.plot(
        places[best_index],
        best[best_index],
        "o",
        markersize=scale_points(8),
        color=_BEST,
        markeredgecolor=PAPER,
        zorder=5,
    )
    text = _format_number(history[best_index].best_so_far + 0.0, drawn[np.isfinite(drawn)])
    axes.annotate(
        text, (places[best_index], best[best_index]), xytext=(0, scale_points(8)), textcoords="offset points",
        ha="center" if best_index else "left", color=_BEST, fontsize=scale_points(11.5), fontweight="bold",
    )  # fmt: skip
    margin = _MARGIN if current_page().width is None else _PAGE_MARGIN
    low, high = drawn.min(axis=0), drawn.max(axis=0)
    held_out = _draw_held_out(axes, run, float(places[-1]))
    if held_out is not None:
        low[-1], high[-1] = np.fmin(low[-1], held_out[0]), np.fmax(high[-1], held_out[1])
    axes.margins(x=0.02, y=margin)
    if outside is not None:
        bottom, top = float(np.nanmin(low)), float(np.nanmax(high))
        spare = margin * top - margin * bottom
        axes.set_ylim(bottom - spare, top + spare)
    cut_axis(axes, [(places, low, high)], outside=outside)


def _draw_held_out(axes: "Axes", run: "Run", position: float) -> tuple[float, float] | None:
    """Draw the fitness of the best candidate on held-out seeds; return the limits of its interval.

    None if it was not validated, or its fitness does not depend on seeds.
    """
    validation = run.validation
    if validation is None or not validation.depends_on_seed:
        return None
    best = validation.best.fitness
    if not math.isfinite(best.mean) or best.low is None or best.high is None:
        return None
    mean, low, high = clip_drawable(np.array([best.mean, best.low, best.high])).tolist()
    axes.errorbar(
        position, mean, yerr=[[mean - low], [high - mean]], fmt="D", markersize=scale_points(6), color=INK,
        ecolor=INK, elinewidth=scale_points(1.6), capsize=scale_points(4), zorder=6, clip_on=False,
        label=f"best on held-out seeds ({len(validation.seeds):,} episodes, 95 % interval)",
    )  # fmt: skip
    return low, high


def _format_number(value: float, numbers: "NDArray[np.float64]") -> str:
    """Format a number with four digits, or more to distinguish it from the other numbers."""
    span = float(np.ptp(numbers)) if np.isfinite(np.ptp(numbers)) else 0.0
    digits = 4
    if 0.0 < span < abs(value):
        digits = min(max(4, math.ceil(math.log10(abs(value)) - math.log10(span)) + 2), 15)
    return f"{value:.{digits}g}"


def _draw_diversity(axes: "Axes", values: "NDArray[np.float64]", places: "NDArray[np.float64]") -> None:
    marker = "o" if np.count_nonzero(np.isfinite(values)) == 1 else None
    axes.plot(places, values, color=_SPREAD, linewidth=scale_points(1.8), marker=marker)
    axes.fill_between(places, 0, values, color=_SPREAD, alpha=0.12, linewidth=0)
    axes.set_ylim(bottom=0)
    if not np.isfinite(values).any():
        axes.text(
            0.5, 0.5, "one candidate in each generation", transform=axes.transAxes, ha="center", color=SOFT
        )
