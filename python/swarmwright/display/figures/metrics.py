"""Figures of metrics over generations: of one run by how good candidates were, and of groups of runs."""

import textwrap
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from swarmwright.common.formatting import format_count
from swarmwright.display.figures.curves import bands, together
from swarmwright.display.figures.run import title_of
from swarmwright.display.figures.style import (
    AXES,
    COLORS,
    INK,
    SOFT,
    above_axes,
    current,
    drawable,
    dress,
    entitle,
    fitting_columns,
    look,
    new_figure,
    points,
    styled,
    whole_ticks,
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
"""Inches of the height of a metric, and of title, legend and the horizontal axis."""
_ONE_COLUMN = 4
"""Metrics up to which these are one below the other, where there is room for two columns."""
_LABEL = 22
"""Characters in a line of the label of an axis."""
_TOP = 1
"""The share of a generation by which groups of runs are compared: the best quarter; the best of fewer."""


@styled()
def draw(run: "Run", curves: "MetricCurves", *, x: str = "evaluations") -> "Figure":
    """Return the figure of one run: each metric of the candidates, by their share of each generation.

    Args:
        run: with a finished generation at least.
        curves: its metrics.
        x: "evaluations" or "generations".
    """
    shares = curves.shares
    places, values = curves.x_positions(x), drawable(curves.values)
    figure, axes = _grid(len(curves.names))
    marker = "o" if len(places) == 1 else None
    drawn = [index for index in range(len(shares)) if np.isfinite(values[:, index]).any()]
    for axis, name, of_metric in zip(axes, curves.labels, values, strict=False):
        for index in drawn:
            color, width = _LOOKS[index]
            style: dict[str, Any] = {"color": color, "linewidth": points(width), "marker": marker}
            axis.plot(places, of_metric[index], label=shares[index], **style)
        dress(axis, y=textwrap.fill(name, _LABEL))
    _finish(axes, len(curves.names), x, places)
    entitle(figure, title_of(run.experiment))
    failed = sum(summary.failed for summary in run.history)
    axes[0].set_title(
        above_axes(
            f"means over shares of each generation, by fitness; seed {run.experiment.seed}"
            + (f"; without {failed:,} failed" if failed else "")
        ),
        loc="left", fontsize=points(10), color=SOFT,
    )  # fmt: skip
    labels = [shares[index] for index in drawn]
    figure.legend(
        *axes[0].get_legend_handles_labels(), loc="outside lower center",
        ncols=fitting_columns(labels, len(labels)), fontsize=points(10.5), frameon=False, labelcolor=INK,
    )  # fmt: skip
    return figure


@styled()
def of_groups(
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
        heading: above all.
        x: "evaluations" or "generations".
    """
    runs = runs_of(designs)
    curve_of = {id(run): drawn for run, drawn in zip(runs, curves, strict=True)}
    every = curves[0].labels
    figure, axes = _grid(len(every))
    ends: list[np.ndarray[Any, Any]] = []
    for design in designs:
        color, dashes = look(design.number)
        members = [run for group in design.groups for run in group.runs]
        for index, panel in enumerate(axes[: len(every)]):

            def curve(run: "Run", x: str, index: int = index) -> Any:  # noqa: ANN401 - two arrays
                found = curve_of[id(run)]
                top, best = found.values[index, _TOP], found.values[index, 0]
                return found.x_positions(x), drawable(np.where(np.isnan(top), best, top))

            places, values, _ = together(members, x, curve)
            _, low, middle, high, _ = bands(values)
            if len(members) > 1:
                panel.fill_between(places, low, high, color=color, alpha=0.2, linewidth=0)
            marker = "o" if np.count_nonzero(np.isfinite(middle)) == 1 else None
            panel.plot(
                places, middle, color=color, linestyle=dashes, linewidth=points(2.0), marker=marker,
                label=design.entry,
            )  # fmt: skip
            ends.append(places)
    for panel, name in zip(axes, every, strict=False):
        dress(panel, y=textwrap.fill(name, _LABEL))
    _finish(axes, len(every), x, np.unique(np.concatenate(ends)))
    entitle(figure, heading)
    axes[0].set_title(
        above_axes("best quarter of each generation; line: median of the runs, shaded: middle half"),
        loc="left", fontsize=points(10), color=SOFT,
    )  # fmt: skip
    handles, labels = axes[0].get_legend_handles_labels()
    legend = figure.legend(
        handles, labels, loc="outside lower left", ncols=fitting_columns(labels, 3), fontsize=points(10),
        frameon=False, labelcolor=INK,
    )  # fmt: skip
    for text in legend.get_texts():
        text.set_parse_math(False)
    return figure


def runs_of(designs: "Sequence[Design]") -> "list[Run]":
    """Return the runs of designs, in their order."""
    return [run for design in designs for group in design.groups for run in group.runs]


def title_of_groups(designs: "Sequence[Design]") -> str:
    """Return the title of a figure of groups of runs."""
    runs = runs_of(designs)
    subjects = sorted({run.experiment.subject for run in runs})
    return f"{'; '.join(subjects)}: {format_count(len(runs), 'run')}"


def _grid(count: int) -> "tuple[Figure, list[Axes]]":
    """Return a figure with axes for metrics, one column after the other."""
    columns = 1 if count <= _ONE_COLUMN or current().narrow else 2
    rows = -(-count // columns)
    width = 9.0 if columns == 1 else 12.0
    figure = new_figure(width, _ROW_INCHES * rows + _OTHER_INCHES)
    axes = figure.subplots(rows, columns, squeeze=False)
    return figure, list(axes.T.reshape(-1))


def _finish(axes: "Sequence[Axes]", count: int, x: str, places: "np.ndarray[Any, Any]") -> None:
    """Remove axes without a metric, and write what all are drawn over below the lowest of each column."""
    axes[0].figure.align_ylabels(axes[:count])
    rows = len({round(axis.get_position().y0, 6) for axis in axes})
    for index, axis in enumerate(axes):
        if index >= count:
            axis.remove()
            continue
        axis.margins(x=0.01, y=0.08)
        whole_ticks(axis.xaxis, places)
        if (index + 1) % rows == 0 or index == count - 1:
            axis.set_xlabel(AXES[x], fontsize=points(11), color=INK)
        else:
            axis.tick_params(labelbottom=False)
