"""The figure of a comparison of two controllers in the same episodes."""

from typing import TYPE_CHECKING

import numpy as np

from swarmwright.common.formatting import format_count, shorten
from swarmwright.display.figures.style import (
    COLORS,
    INK,
    PAPER,
    SOFT,
    clip_drawable,
    draw_title,
    new_figure,
    scale_points,
    set_integer_ticks,
    style_axes,
    use_style_fonts,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from swarmwright.analysis.paired import ControllerComparison, Values

_A, _B, _EQUAL = COLORS[0], COLORS[1], SOFT
_NAME = 40
"""Longest name of a controller, in characters."""


@use_style_fonts()
def draw(comparison: "ControllerComparison") -> "Figure":
    """Return the figure: fitness of A over that of B, and all differences in ascending order."""
    counts = ~np.isnan(comparison.differences)
    first, second = (
        clip_drawable(evaluation.ranking.replace_failures(evaluation.episodes)[counts])
        for evaluation in (comparison.first, comparison.second)
    )
    figure = new_figure(11, 5.2)
    pairs, ordered = figure.subplots(1, 2)
    names = [shorten(name, _NAME) for name in comparison.names]
    a, b = (
        letter if letter == name else f"{letter}: {name}" for letter, name in zip("AB", names, strict=True)
    )
    _draw_pairs(pairs, first, second)
    style_axes(pairs, x=f"fitness of {b}", y=f"fitness of {a}")
    pairs.set_title(
        "one point per episode; dotted: equal fitness", loc="left", fontsize=scale_points(10.5), color=SOFT
    )
    _draw_differences(ordered, comparison)
    style_axes(ordered, x="episodes, by their difference", y="difference of fitness, A - B")
    ordered.set_title(
        f"{format_count(len(first), 'episode')}, the same for both{_describe_failures(comparison)}",
        loc="left", fontsize=scale_points(10.5), color=SOFT,
    )  # fmt: skip
    draw_title(figure, f"{comparison.experiment.subject}: A against B")
    figure.legend(
        *ordered.get_legend_handles_labels(), loc="outside lower center", ncols=5,
        fontsize=scale_points(10.5), frameon=False, labelcolor=INK,
    )  # fmt: skip
    return figure


def _describe_failures(comparison: "ControllerComparison") -> str:
    """Describe how failed episodes count; empty without failures."""
    value = comparison.first.ranking.options.failure_fitness
    failed = comparison.first.failed + comparison.second.failed
    if not failed:
        return ""
    if value is None:
        return f"; {len(comparison.left_out):,} excluded: a controller failed"
    return f"; {format_count(failed, 'failure')} count{'s' if failed == 1 else ''} as {value:g}"


def _draw_pairs(axes: "Axes", first: "Values", second: "Values") -> None:
    """Draw the fitness of A over that of B, with equal axes."""
    for _, color, mask in _split_outcomes(first - second):
        axes.plot(
            second[mask], first[mask], "o", color=color, markersize=scale_points(5), alpha=0.75,
            markeredgecolor=PAPER, markeredgewidth=scale_points(0.5),
        )  # fmt: skip
    values = np.concatenate([first, second])
    low, high = (float(values.min()), float(values.max())) if len(values) else (0.0, 1.0)
    margin = 0.06 * (high - low) or 0.5
    low, high = low - margin, high + margin
    axes.plot([low, high], [low, high], color=SOFT, linewidth=scale_points(1), linestyle=":", zorder=1)
    axes.set_xlim(low, high)
    axes.set_ylim(low, high)
    axes.set_aspect("equal")
    axes.locator_params(nbins=6)


def _draw_differences(axes: "Axes", comparison: "ControllerComparison") -> None:
    """Draw all differences in ascending order, their mean and its interval."""
    values = clip_drawable(np.sort(comparison.paired))
    places = np.arange(1.0, len(values) + 1)
    mean = comparison.difference
    if mean.low is not None and mean.high is not None:
        axes.axhspan(*clip_drawable(np.array([mean.low, mean.high])), color=INK, alpha=0.12, linewidth=0,
                     label="95 % interval of the mean")  # fmt: skip
    if len(values):
        middle = float(clip_drawable(np.array([mean.mean]))[0])
        axes.axhline(middle, color=INK, linewidth=scale_points(1.8), label="mean difference")
    axes.axhline(0.0, color=SOFT, linewidth=scale_points(1), linestyle=":", zorder=1)
    for name, color, mask in _split_outcomes(values):
        if mask.any():
            axes.vlines(places[mask], 0.0, values[mask], color=color, linewidth=scale_points(1.2), alpha=0.6)
            axes.plot(places[mask], values[mask], "o", color=color, markersize=scale_points(4), label=name)
    set_integer_ticks(axes.xaxis, places)
    axes.margins(x=0.02)


def _split_outcomes(differences: "Values") -> "list[tuple[str, str, np.typing.NDArray[np.bool_]]]":
    """Return label, colour and mask of episodes for each outcome."""
    return [
        ("A is better", _A, differences > 0),
        ("B is better", _B, differences < 0),
        ("equal", _EQUAL, differences == 0),
    ]
