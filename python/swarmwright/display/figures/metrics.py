"""Figures of metrics over generations: of a run by share of the candidates, and of groups of runs."""

import textwrap
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from swarmwright.common.formatting import format_count
from swarmwright.display.figures.run import align_runs, compute_bands, title_of
from swarmwright.display.figures.style import (
    AXES,
    COLORS,
    INK,
    SOFT,
    clip_drawable,
    current_page,
    draw_title,
    fit_columns,
    group_style,
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

    from swarmwright.analysis.designs import Design
    from swarmwright.runs.metric_curves import MetricCurves
    from swarmwright.runs.run import Run

_LOOKS: tuple[tuple[str, float], ...] = (
    (COLORS[2], 1.0), (COLORS[0], 2.0), (COLORS[4], 2.0), (COLORS[1], 2.0),
)  # fmt: skip
"""Colour and width in points of the lines of shares."""
_ROW_INCHES, _OTHER_INCHES = 2.1, 1.3
"""Height in inches of a metric, and of title, legend and horizontal axis."""
_ONE_COLUMN = 4
"""Largest number of metrics in a single column."""
_LABEL = 22
"""Longest line of an axis label, in characters."""
_TOP = 1
"""Index of the share by which groups are compared: the best quarter, or the best of few candidates."""


@use_style_fonts()
def draw(run: "Run", curves: "MetricCurves", *, x: str = "evaluations") -> "Figure":
    """Return the figure of a run: each metric, averaged over shares of each generation.

    Args:
        run: a run with at least one finished generation.
        curves: its metrics.
        x: "evaluations" or "generations".
    """
    shares = curves.shares
    xs, values = curves.x_positions(x), clip_drawable(curves.values)
    figure, axes = _grid(len(curves.names))
    marker = "o" if len(xs) == 1 else None
    drawn = [index for index in range(len(shares)) if np.isfinite(values[:, index]).any()]
    for axis, name, metric_values in zip(axes, curves.labels, values, strict=False):
        for index in drawn:
            color, width = _LOOKS[index]
            style: dict[str, Any] = {"color": color, "linewidth": scale_points(width), "marker": marker}
            axis.plot(xs, metric_values[index], label=shares[index], **style)
        style_axes(axis, y=textwrap.fill(name, _LABEL))
    _finish(axes, len(curves.names), x, xs)
    draw_title(figure, title_of(run.experiment))
    failed = sum(summary.failed for summary in run.history)
    axes[0].set_title(
        wrap_above_axes(
            f"means over shares of each generation, by fitness; seed {run.experiment.seed}"
            + (f"; without {failed:,} failed" if failed else "")
        ),
        loc="left", fontsize=scale_points(10), color=SOFT,
    )  # fmt: skip
    labels = [shares[index] for index in drawn]
    figure.legend(
        *axes[0].get_legend_handles_labels(), loc="outside lower center",
        ncols=fit_columns(labels, len(labels)), fontsize=scale_points(10.5), frameon=False, labelcolor=INK,
    )  # fmt: skip
    return figure


@use_style_fonts()
def draw_groups(
    designs: "Sequence[Design]",
    curves: "Sequence[MetricCurves]",
    heading: str,
    *,
    x: str = "evaluations",
) -> "Figure":
    """Return the figure of groups of runs: each metric of the best quarter of each generation.

    Args:
        designs: of groups that solve one task.
        curves: the same metrics of every run, design by design and group by group.
        heading: title of the figure.
        x: "evaluations" or "generations".
    """
    runs = runs_of(designs)
    curve_of = {id(run): drawn for run, drawn in zip(runs, curves, strict=True)}
    metric_labels = curves[0].labels
    figure, axes = _grid(len(metric_labels))
    ends: list[np.ndarray[Any, Any]] = []
    for design in designs:
        color, dashes = group_style(design.number)
        members = [run for group in design.groups for run in group.runs]
        for index, panel in enumerate(axes[: len(metric_labels)]):

            def curve(run: "Run", x: str, index: int = index) -> Any:  # noqa: ANN401 - two arrays
                metric_curves = curve_of[id(run)]
                top, best = metric_curves.values[index, _TOP], metric_curves.values[index, 0]
                return metric_curves.x_positions(x), clip_drawable(np.where(np.isnan(top), best, top))

            places, values, _ = align_runs(members, x, curve)
            _, low, middle, high, _ = compute_bands(values)
            if len(members) > 1:
                panel.fill_between(places, low, high, color=color, alpha=0.2, linewidth=0)
            marker = "o" if np.count_nonzero(np.isfinite(middle)) == 1 else None
            panel.plot(
                places, middle, color=color, linestyle=dashes, linewidth=scale_points(2.0), marker=marker,
                label=design.entry,
            )  # fmt: skip
            ends.append(places)
    for panel, name in zip(axes, metric_labels, strict=False):
        style_axes(panel, y=textwrap.fill(name, _LABEL))
    _finish(axes, len(metric_labels), x, np.unique(np.concatenate(ends)))
    draw_title(figure, heading)
    axes[0].set_title(
        wrap_above_axes("best quarter of each generation; line: median of the runs, shaded: middle half"),
        loc="left", fontsize=scale_points(10), color=SOFT,
    )  # fmt: skip
    handles, labels = axes[0].get_legend_handles_labels()
    legend = figure.legend(
        handles, labels, loc="outside lower left", ncols=fit_columns(labels, 3), fontsize=scale_points(10),
        frameon=False, labelcolor=INK,
    )  # fmt: skip
    for text in legend.get_texts():
        text.set_parse_math(False)
    return figure


def runs_of(designs: "Sequence[Design]") -> "list[Run]":
    """Return the runs of designs, in order."""
    return [run for design in designs for group in design.groups for run in group.runs]


def title_of_groups(designs: "Sequence[Design]") -> str:
    """Return the title of a figure of groups of runs."""
    runs = runs_of(designs)
    subjects = sorted({run.experiment.subject for run in runs})
    return f"{'; '.join(subjects)}: {format_count(len(runs), 'run')}"


def _grid(count: int) -> "tuple[Figure, list[Axes]]":
    """Return a figure with axes for metrics, one column after the other."""
    columns = 1 if count <= _ONE_COLUMN or current_page().narrow else 2
    rows = -(-count // columns)
    width = 9.0 if columns == 1 else 12.0
    figure = new_figure(width, _ROW_INCHES * rows + _OTHER_INCHES)
    axes = figure.subplots(rows, columns, squeeze=False)
    return figure, list(axes.T.reshape(-1))


def _finish(axes: "Sequence[Axes]", count: int, x: str, places: "np.ndarray[Any, Any]") -> None:
    """Remove unused axes, and label the lowest axes of each column."""
    axes[0].figure.align_ylabels(axes[:count])
    rows = len({round(axis.get_position().y0, 6) for axis in axes})
    for index, axis in enumerate(axes):
        if index >= count:
            axis.remove()
            continue
        axis.margins(x=0.01, y=0.08)
        set_integer_ticks(axis.xaxis, places)
        if (index + 1) % rows == 0 or index == count - 1:
            axis.set_xlabel(AXES[x], fontsize=scale_points(11), color=INK)
        else:
            axis.tick_params(labelbottom=False)
