"""The figures of an archive of elites and of a front of trade-offs."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Literal

import numpy as np

from swarmwright.common.untrusted import escape_line
from swarmwright.display.figures.style import (
    COLORS,
    GRID,
    INK,
    SOFT,
    clip_drawable,
    disable_offset,
    draw_title,
    new_figure,
    scale_points,
    style_axes,
    use_style_fonts,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    Values = NDArray[np.float64]


@use_style_fonts()
def draw_archive(
    best: "Values",
    names: Sequence[str],
    limits: Sequence[tuple[float, float]],
    filled: tuple[int, int],
    heading: str,
) -> "Figure":
    """Return a heat map of fitness over the first two measures, or a row of cells for one measure.

    Args:
        best: fitness of each cell, NaN for empty cells, (bins,) or (bins, bins).
        names: names of all measures.
        limits: lowest and highest value of the drawn measures.
        filled: number of cells with an elite, and of all cells, in the whole archive.
        heading: title of the figure.
    """
    two = best.ndim > 1
    figure = new_figure(7.6, 6.4 if two else 3.6)
    draw_title(figure, heading)
    axes = figure.subplots()
    rows = clip_drawable(np.atleast_2d(best.T))
    extent = (*limits[0], *(limits[1] if two else (0.0, 1.0)))
    axes.set_facecolor(GRID)
    image = axes.imshow(
        np.ma.masked_invalid(rows), origin="lower", aspect="auto", extent=extent, cmap="viridis",
        interpolation="none",
    )  # fmt: skip
    bar = figure.colorbar(image, ax=axes)
    bar.set_label("fitness (more is better)", fontsize=scale_points(11), color=INK)
    disable_offset(bar.ax.yaxis)
    style_axes(axes, x=escape_line(names[0]), y=escape_line(names[1]) if two else "")
    axes.grid(visible=False)
    if not two:
        axes.set_yticks([])
    title = f"{filled[0]:,} of {filled[1]:,} cells have an elite (grey: empty)"
    more = "; of each, the best over the other measures" if len(names) > 2 else ""
    axes.set_title(title + more, loc="left", fontsize=scale_points(10.5), color=SOFT)
    return figure


@use_style_fonts()
def draw_front(values: "Values", names: Sequence[str], goals: Sequence[str], heading: str) -> "Figure":
    """Return the points of a front: fitness over the first metric, coloured by the second.

    The title lists metrics that are not shown. With one metric, a step line bounds the dominated region.

    Args:
        values: fitness and metrics of the candidates, (n, 1 + metrics), n >= 1.
        names: names of the metrics.
        goals: "maximize" or "minimize" for each.
        heading: title of the figure.
    """
    figure = new_figure(7.6, 6.0)
    draw_title(figure, heading)
    axes = figure.subplots()
    drawn = clip_drawable(values)
    order = np.lexsort((drawn[:, 0], drawn[:, 1]))
    labels = [
        escape_line(f"{name} ({'more' if goal == 'maximize' else 'less'} is better)")
        for name, goal in zip(names, goals, strict=True)
    ]
    if len(names) > 1:
        marks = axes.scatter(drawn[:, 1], drawn[:, 0], c=drawn[:, 2], cmap="viridis", s=34, zorder=3)
        bar = figure.colorbar(marks, ax=axes)
        bar.set_label(labels[1], fontsize=scale_points(11), color=INK)
        disable_offset(bar.ax.yaxis)
    else:
        # The dominated region is bounded by steps, not by lines between candidates.
        x, y = drawn[order, 1], drawn[order, 0]
        where: Literal["pre", "post"] = "pre" if goals[0] == "maximize" else "post"
        axes.step(x, y, where=where, color=COLORS[0], linewidth=scale_points(0.8), alpha=0.5, zorder=2)
        axes.scatter(drawn[:, 1], drawn[:, 0], color=COLORS[0], s=34, zorder=3)
    style_axes(axes, x=labels[0], y="fitness (more is better)")
    title = f"{len(values):,} candidate{'s' if len(values) > 1 else ''} not dominated by any other"
    if len(names) > 2:
        title += f"; a projection: 3 of {1 + len(names)} objectives are shown,\nnot " + escape_line(
            ", ".join(names[2:])
        )
    axes.set_title(title, loc="left", fontsize=scale_points(10.5), color=SOFT)
    return figure
