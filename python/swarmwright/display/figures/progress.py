"""The figure of a competition's progress: champions of all generations against each other."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from swarmwright.common.untrusted import escape_line
from swarmwright.display.figures.style import (
    COLORS,
    INK,
    PAPER,
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
    from matplotlib.figure import Figure

    from swarmwright.analysis.competition import SideProgress, Values


_COLORS = {
    "red": "#D55E00", "blue": "#0072B2", "green": "#009E73", "magenta": "#CC79A7", "cyan": "#56B4E9",
    "yellow": "#E69F00",
}  # fmt: skip
"""Colours of `style.COLORS` that are nearest to those of robots."""


def choose_side_colors(names: Sequence[str | None]) -> list[str]:
    """Return a colour for each side: that of its robots in pictures, if it has one of its own.

    names: names of the robots' colours, such as `red`; None if a side has none.
    """
    if len(set(names)) == len(names) and all(name in _COLORS for name in names):
        return [_COLORS[str(name)] for name in names]
    return list(COLORS[: len(names)])


@use_style_fonts()
def draw_progress(sides: "Sequence[SideProgress]", heading: str, colors: Sequence[str]) -> "Figure":
    """Return a figure with a row for each side: its outcomes as a heat map, their means, and ratings.

    Args:
        sides: two or more, with champions of the same generations.
        heading: title of the figure.
        colors: of the sides.
    """
    figure = new_figure(13.4, 4.2 * len(sides))
    draw_title(figure, heading)
    axes = figure.subplots(len(sides), 3)
    generations = sides[0].generations
    first, last = generations[0], generations[-1]
    half = (last - first) / max(len(generations) - 1, 1) / 2
    extent = (first - half, last + half, first - half, last + half)
    for row, own in enumerate(sides):
        name = escape_line(own.side)
        image = axes[row, 0].imshow(
            clip_drawable(own.outcomes), origin="lower", aspect="auto", extent=extent, cmap="viridis",
            interpolation="none",
        )  # fmt: skip
        bar = figure.colorbar(image, ax=axes[row, 0])
        bar.set_label(f"fitness of {name}", fontsize=scale_points(10), color=INK)
        disable_offset(bar.ax.yaxis)
        style_axes(axes[row, 0], x=f"generation of {escape_line(own.opponents)}", y=f"generation of {name}")
        axes[row, 0].grid(visible=False)
        axes[row, 0].plot((first, last), (first, last), color=PAPER, lw=0.8, ls=":")
        _draw_line(axes[row, 1], generations, (own.low, own.means, own.high), colors[row])
        style_axes(axes[row, 1], x=f"generation of {name}", y="mean fitness")
        _draw_line(axes[row, 2], generations, (own.ratings_low, own.ratings, own.ratings_high), colors[row])
        style_axes(axes[row, 2], x=f"generation of {name}", y="rating (Bradley-Terry)")
        for column, words in ((1, "against all opponents"), (2, "among themselves")):
            axes[row, column].set_title(
                f"{name} {words}, 95 % interval", loc="left", fontsize=scale_points(10), color=SOFT
            )
    return figure


def _draw_line(
    axes: "Axes", generations: Sequence[int], values: "tuple[Values, Values, Values]", color: str
) -> None:
    """Draw values within their lower and upper limits."""
    low, middle, high = map(clip_drawable, values)
    axes.fill_between(generations, low, high, color=color, alpha=0.2, lw=0)
    axes.plot(generations, middle, color=color)
    disable_offset(axes.yaxis)
