"""The figure of a competition's progress: champions of all generations against each other."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from swarmwright.common.untrusted import escape_line
from swarmwright.display.figures.style import (
    COLORS,
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


class Champions(NamedTuple):
    """Champions of a side against those of the other."""

    side: str
    outcomes: "Values"
    """(generations, generations of the other side): fitness of this side."""
    means: "Values"
    """(generations,)"""
    low: "Values"
    high: "Values"


@use_style_fonts()
def draw_progress(sides: Sequence[Champions], generations: Sequence[int], heading: str) -> "Figure":
    """Return a figure with a row for each side: its outcomes as a heat map, and their means.

    Args:
        sides: two sides.
        generations: generations of the champions, the same for both sides.
        heading: title of the figure.
    """
    figure = new_figure(9.4, 8.4)
    draw_title(figure, heading)
    axes = figure.subplots(2, 2)
    first, last = generations[0], generations[-1]
    half = (last - first) / max(len(generations) - 1, 1) / 2
    extent = (first - half, last + half, first - half, last + half)
    for row, (own, other) in enumerate(zip(sides, reversed(sides), strict=True)):
        name = escape_line(own.side)
        image = axes[row, 0].imshow(
            clip_drawable(own.outcomes), origin="lower", aspect="auto", extent=extent, cmap="viridis",
            interpolation="none",
        )  # fmt: skip
        bar = figure.colorbar(image, ax=axes[row, 0])
        bar.set_label(f"fitness of {name}", fontsize=scale_points(10), color=INK)
        disable_offset(bar.ax.yaxis)
        style_axes(axes[row, 0], x=f"generation of {escape_line(other.side)}", y=f"generation of {name}")
        axes[row, 0].grid(visible=False)
        axes[row, 1].fill_between(
            generations, clip_drawable(own.low), clip_drawable(own.high), color=COLORS[row], alpha=0.2, lw=0
        )
        axes[row, 1].plot(generations, clip_drawable(own.means), color=COLORS[row])
        style_axes(axes[row, 1], x=f"generation of {name}", y="mean fitness")
        disable_offset(axes[row, 1].yaxis)
        axes[row, 1].set_title(
            f"{name} against all opponents, 95 % interval", loc="left", fontsize=scale_points(10), color=SOFT
        )
    return figure
