"""The figures of an archive of elites and of a front of trade-offs."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from swarmwright.core.plain_figures import plain
from swarmwright.core.untrusted import one_line
from swarmwright.figures.style import COLORS, GRID, INK, SOFT, drawable, dress, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    Values = NDArray[np.float64]


@plain()
def archive(
    values: "Values", names: Sequence[str], ranges: Sequence[tuple[float, float]], shape: Sequence[int]
) -> "Figure":
    """Return a heat map of fitness over the first two measures; of one measure, bars of cells.

    Args:
        values: fitness and measures of the elites, (n, 1 + measures), n >= 1.
        names: of the measures.
        ranges: lowest and highest value of each measure.
        shape: bins of each measure.
    """
    two = len(names) > 1
    figure = new_figure(7.6, 6.0 if two else 3.2)
    axes = figure.subplots()
    rows = shape[1] if two else 1
    best = np.full((rows, shape[0]), np.nan)
    for row in drawable(values):
        x = _bin(row[1], ranges[0], shape[0])
        y = _bin(row[2], ranges[1], rows) if two else 0
        best[y, x] = np.fmax(best[y, x], row[0])
    extent = (*ranges[0], *(ranges[1] if two else (0.0, 1.0)))
    axes.set_facecolor(GRID)
    image = axes.imshow(
        np.ma.masked_invalid(best), origin="lower", aspect="auto", extent=extent, cmap="viridis",
        interpolation="none",
    )  # fmt: skip
    bar = figure.colorbar(image, ax=axes)
    bar.set_label("fitness (more is better)", fontsize=11, color=INK)
    dress(axes, x=one_line(names[0]), y=one_line(names[1]) if two else "")
    axes.grid(visible=False)
    if not two:
        axes.set_yticks([])
    cells = int(np.prod(shape))
    filled = f"{len(values):,} of {cells:,} cells have an elite (grey: none)"
    more = "; of each, the best over the other measures" if len(names) > 2 else ""
    axes.set_title(filled + more, loc="left", fontsize=10.5, color=SOFT)
    return figure


def _bin(value: float, limits: tuple[float, float], bins: int) -> int:
    low, high = limits
    return int(np.clip(np.floor((value - low) / (high - low) * bins), 0, bins - 1))


@plain()
def front(values: "Values", names: Sequence[str], goals: Sequence[str]) -> "Figure":
    """Return the points of a front: fitness over the first metric, in colours of the second one.

    Args:
        values: fitness and metrics of the candidates, (n, 1 + metrics), n >= 1.
        names: of the metrics.
        goals: "maximize" or "minimize" for each.
    """
    figure = new_figure(7.6, 5.6)
    axes = figure.subplots()
    drawn = drawable(values)
    order = np.lexsort((drawn[:, 0], drawn[:, 1]))
    labels = [
        one_line(f"{name} ({'more' if goal == 'maximize' else 'less'} is better)")
        for name, goal in zip(names, goals, strict=True)
    ]
    if len(names) > 1:
        points = axes.scatter(drawn[:, 1], drawn[:, 0], c=drawn[:, 2], cmap="viridis", s=34, zorder=3)
        bar = figure.colorbar(points, ax=axes)
        bar.set_label(labels[1], fontsize=11, color=INK)
    else:
        axes.plot(drawn[order, 1], drawn[order, 0], color=COLORS[0], linewidth=0.8, alpha=0.5, zorder=2)
        axes.scatter(drawn[:, 1], drawn[:, 0], color=COLORS[0], s=34, zorder=3)
    dress(axes, x=labels[0], y="fitness (more is better)")
    title = f"{len(values):,} candidate{'s' if len(values) > 1 else ''} that no other one dominates"
    axes.set_title(title, loc="left", fontsize=10.5, color=SOFT)
    return figure
