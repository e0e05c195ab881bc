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
    from matplotlib.axes import Axes
    from matplotlib.cm import ScalarMappable
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
    figure, axes = _begin(heading, 6.4 if two else 3.6)
    rows = clip_drawable(np.atleast_2d(best.T))
    extent = (*limits[0], *(limits[1] if two else (0.0, 1.0)))
    axes.set_facecolor(GRID)
    image = axes.imshow(
        np.ma.masked_invalid(rows), origin="lower", aspect="auto", extent=extent, cmap="viridis",
        interpolation="none",
    )  # fmt: skip
    _add_bar(figure, axes, image)
    style_axes(axes, x=escape_line(names[0]), y=escape_line(names[1]) if two else "")
    axes.grid(visible=False)
    if not two:
        axes.set_yticks([])
    more = "; of each, the best over the other measures" if len(names) > 2 else ""
    _add_count(axes, filled, " (grey: empty)" + more)
    return figure


@use_style_fonts()
def draw_voronoi(
    best: "Values",
    centroids: "Values",
    names: Sequence[str],
    limits: Sequence[tuple[float, float]],
    filled: tuple[int, int],
    heading: str,
) -> "Figure":
    """Return a map of the Voronoi cells of two measures, coloured by fitness.

    Args:
        best: fitness of each cell, NaN for empty cells, (cells,).
        centroids: (cells, 2), within the limits.
        names: names of both measures.
        limits: lowest and highest value of both.
        filled: number of cells with an elite, and of all cells.
        heading: title of the figure.
    """
    from matplotlib.collections import PolyCollection

    figure, axes = _begin(heading, 6.4)
    axes.set_facecolor(GRID)
    drawn = np.flatnonzero(np.isfinite(best))
    (left, right), (bottom, top) = limits
    corner, size = np.array([left, bottom]), np.array([right - left, top - bottom])
    polygons = _clip_cells((centroids - corner) / size)
    cells = PolyCollection(
        [polygons[cell] * size + corner for cell in drawn.tolist()],
        array=clip_drawable(best[drawn]), cmap="viridis", edgecolors=GRID, linewidths=scale_points(0.3),
    )  # fmt: skip
    axes.add_collection(cells)
    axes.set_xlim(left, right)
    axes.set_ylim(bottom, top)
    _add_bar(figure, axes, cells)
    style_axes(axes, x=escape_line(names[0]), y=escape_line(names[1]))
    axes.grid(visible=False)
    _add_count(axes, filled, " (grey: empty)")
    return figure


def _clip_cells(points: "Values") -> "list[Values]":
    """Return the corners of the Voronoi cells of points within the unit square."""
    from scipy.spatial import Voronoi

    # Mirrored at each side of the square, points have cells that end there.
    mirrored = [points]
    for axis in (0, 1):
        for side in (0.0, 2.0):
            copy = points.copy()
            copy[:, axis] = side - copy[:, axis]
            mirrored.append(copy)
    diagram = Voronoi(np.concatenate(mirrored))
    regions = [diagram.regions[diagram.point_region[cell]] for cell in range(len(points))]
    return [diagram.vertices[[corner for corner in region if corner >= 0]] for region in regions]


@use_style_fonts()
def draw_points(
    values: "Values",
    names: Sequence[str],
    limits: Sequence[tuple[float, float]],
    filled: tuple[int, int],
    heading: str,
) -> "Figure":
    """Return the elites as points over the first two measures coloured by fitness, or fitness over one.

    Args:
        values: fitness and measures of the elites, (n, 1 + measures), n >= 1.
        names: names of all measures.
        limits: lowest and highest value of the drawn measures; empty to fit the elites.
        filled: number of elites, and of all cells; 0 if there are no cells.
        heading: title of the figure.
    """
    two = len(names) > 1
    figure, axes = _begin(heading, 6.4)
    drawn = clip_drawable(values)
    order = np.argsort(drawn[:, 0], kind="stable")  # the best are drawn last
    fitness, x, y = drawn[order, 0], drawn[order, 1], drawn[order, 2 if two else 0]
    marks = axes.scatter(x, y, c=fitness, cmap="viridis", s=16 if len(values) < 2000 else 6, zorder=3)
    if limits:
        axes.set_xlim(*limits[0])
    if len(limits) > 1:
        axes.set_ylim(*limits[1])
    if two:
        _add_bar(figure, axes, marks)
    style_axes(axes, x=escape_line(names[0]), y=escape_line(names[1]) if two else "fitness (more is better)")
    _add_count(axes, filled, f"; 2 of {len(names)} measures are shown" if len(names) > 2 else "")
    return figure


def _begin(heading: str, height: float) -> "tuple[Figure, Axes]":
    """Return a figure with a title, and its axes."""
    figure = new_figure(7.6, height)
    draw_title(figure, heading)
    return figure, figure.subplots()


def _add_bar(figure: "Figure", axes: "Axes", colored: "ScalarMappable") -> None:
    """Add the bar that explains the colours."""
    bar = figure.colorbar(colored, ax=axes)
    bar.set_label("fitness (more is better)", fontsize=scale_points(11), color=INK)
    disable_offset(bar.ax.yaxis)


def _add_count(axes: "Axes", filled: tuple[int, int], more: str) -> None:
    """Add the number of elites, and of cells, above the axes."""
    count, cells = filled
    title = f"{count:,} of {cells:,} cells have an elite" if cells else f"{count:,} elites"
    axes.set_title(title + more, loc="left", fontsize=scale_points(10.5), color=SOFT)


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
