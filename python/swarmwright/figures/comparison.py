"""The figure of a comparison: curves of the groups, and what is compared of every run."""

import re
import textwrap
from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from swarmwright.core.formatting import p_value
from swarmwright.core.plain_figures import plain
from swarmwright.figures.curves import Curve, bands, best_so_far, indicator_so_far, together
from swarmwright.figures.style import (
    AXES,
    INK,
    PAPER,
    SOFT,
    drawable,
    dress,
    look,
    new_figure,
    thousands,
    zoom,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from swarmwright.analysis.comparison import Comparison, Group

Drawn = tuple[np.ndarray[Any, Any], np.ndarray[Any, Any], np.ndarray[Any, Any]]
_LABEL = 34
"""Characters in a line of the legend."""
_NAME = 18
"""Characters in a line of a name below a box; the parts of a name are in separate lines."""
_PARTS = re.compile(r", (?![^\[]*\])")  # not those within a list
_SLANTED = 44
"""Characters of a name that is slanted, in one line."""
_CHARACTER = 0.088
"""Inches that a character of a name needs."""
_WIDEST = 6.0
"""Inches of the boxes' axes beyond which their names are slanted."""
_CLEAR = 3
"""Groups up to which the worst and best runs are shaded as well; more would be illegible."""


@plain()
def draw(comparison: "Comparison", *, x: str = "evaluations") -> "Figure":
    """Return the figure. x: "evaluations" or "generations"."""
    groups = comparison.groups
    names, slanted, width = _names([one.label for one in groups])
    height = 5.4 + (0.6 * _CHARACTER * max(map(len, names)) if slanted else 0.0)
    figure = new_figure(7.0 + width, height)
    left, right = figure.subplots(1, 2, width_ratios=[6.0, width])
    drawn = []
    indicator = comparison.indicator
    curve = partial(indicator_so_far, indicator) if indicator.has_curve else best_so_far
    for index, one in enumerate(groups):
        drawn.append(_curve(left, one, index, x, curve, extremes=len(groups) <= _CLEAR))
        _final(right, one, index)
    zoom(left, drawn)
    subject = (
        f"{indicator.words} (more is better)"
        if indicator.has_curve
        else "best fitness so far (more is better)"
    )
    dress(left, x=AXES[x], y=subject)
    thousands(left.xaxis)
    left.margins(x=0.01)
    if comparison.at is not None and x == "evaluations":
        left.axvline(comparison.at, color=SOFT, linewidth=1, linestyle=":")
    if comparison.held_out:
        when = "on held-out seeds"
    else:
        when = "at the end" if comparison.at is None else f"after {comparison.at:,} evaluations"
    what = indicator.words
    if indicator.by == "fitness":
        what = "fitness of the best" if comparison.held_out else "best fitness"
    dress(right, y=f"{what} of each run, {when}")
    style: dict[str, Any] = {"rotation": 40, "ha": "right", "rotation_mode": "anchor"} if slanted else {}
    right.set_xticks(range(len(groups)), names, **style)
    for text in right.get_xticklabels():
        text.set_parse_math(False)
    right.set_xlim(-0.6, len(groups) - 0.4)
    right.grid(visible=False, axis="x")
    right.set_title(_verdict(comparison), loc="left", fontsize=10, color=SOFT)
    simulations = sorted({one.runs[0].experiment.label for one in groups})
    figure.suptitle(
        f"{', '.join(simulations)}: {sum(len(one.runs) for one in groups)} runs",
        x=0.012, ha="left", fontsize=14, fontweight="bold", color=INK, parse_math=False,
    )  # fmt: skip
    _legend(figure, left, groups)
    return figure


def _verdict(comparison: "Comparison") -> str:
    if comparison.kruskal is not None:
        return f"Kruskal-Wallis p {p_value(comparison.kruskal.p)}"
    if not comparison.pairs:
        return ""
    found = comparison.pairs[0].difference
    return f"Mann-Whitney p {p_value(found.p)}, A12 {found.effect:.2f}"


def _names(labels: Sequence[str]) -> tuple[list[str], bool, float]:
    """Return names of groups for below their boxes, whether they are slanted, and inches that the axes need.

    Names that would overlap are slanted.
    """
    lines = [
        [line for part in _PARTS.split(label) for line in textwrap.wrap(part, _NAME)] for label in labels
    ]
    longest = max((len(line) for words in lines for line in words), default=0)
    width = len(labels) * (_CHARACTER * longest + 0.15)
    if width <= _WIDEST:
        return ["\n".join(words) for words in lines], False, max(width, 3.0)
    slanted = [textwrap.shorten(label, _SLANTED, placeholder=" …") for label in labels]
    return slanted, True, max(0.42 * len(labels), 3.0)


def _legend(figure: "Figure", axes: "Axes", groups: "tuple[Group, ...]") -> None:
    handles, _ = axes.get_legend_handles_labels()
    labels = [
        "\n".join(textwrap.wrap(f"{one.label} ({len(one.runs)})", _LABEL, subsequent_indent="    "))
        for one in groups
    ]
    # matplotlib fills columns; the order of the boxes is read row by row.
    columns = min(3, len(groups))
    order = [index for column in range(columns) for index in range(column, len(groups), columns)]
    legend = figure.legend(
        [handles[index] for index in order], [labels[index] for index in order],
        loc="outside lower left", ncols=columns, fontsize=10, frameon=False,
        labelcolor=INK,
    )  # fmt: skip
    for text in legend.get_texts():
        text.set_parse_math(False)
    shades = "dark: middle half · light: all" if len(groups) <= _CLEAR else "shaded: middle half"
    meaning = f"line: median of the runs · {shades}"
    if any(len(one.runs) > 1 for one in groups):
        axes.set_title(meaning, loc="left", fontsize=10, color=SOFT)


def _curve(axes: "Axes", one: "Group", index: int, x: str, curve: Curve, *, extremes: bool) -> Drawn:
    """Draw a group's curve; return x, and the least and the greatest that is drawn there."""
    color, dashes = look(index)
    places, values, shortest = together(one.runs, x, curve)
    low, lower, middle, upper, high = map(drawable, bands(values))
    if len(one.runs) > 1:
        steps: dict[str, Any] = {"step": "post", "color": color, "linewidth": 0}
        if extremes:
            axes.fill_between(places, low, high, alpha=0.10, **steps)
        axes.fill_between(places, lower, upper, alpha=0.22, **steps)
    marker = "o" if np.count_nonzero(~np.isnan(middle)) == 1 else None
    sure = places <= shortest
    axes.step(
        places[sure], middle[sure], where="post", color=color, linestyle=dashes, linewidth=2.2, marker=marker,
        label=one.label,
    )  # fmt: skip
    # Where runs have ended, their last values are used.
    rest = places >= places[sure][-1]
    if np.count_nonzero(rest) > 1:
        axes.step(places[rest], middle[rest], where="post", color=color, linewidth=1.0, alpha=0.7)
    return (places, low, high) if extremes else (places, lower, upper)


def _final(axes: "Axes", one: "Group", index: int) -> None:
    color, _ = look(index)
    values = drawable(one.final[~np.isnan(one.final)])
    if not len(values):
        axes.text(index, 0.5, "all failed", transform=axes.get_xaxis_transform(), ha="center", rotation=90)
        return
    if len(values) > 1:
        low, middle, high = np.quantile(values, [0.25, 0.5, 0.75])
        axes.fill_between([index - 0.3, index + 0.3], low, high, color=color, alpha=0.18, linewidth=0)
        axes.hlines([low, high], index - 0.3, index + 0.3, color=color, linewidth=1.0)
        axes.hlines(middle, index - 0.3, index + 0.3, color=color, linewidth=2.4)
    axes.plot(
        index + apart(values), values, "o", markersize=6, color=color, alpha=0.85, markeredgecolor=PAPER,
        markeredgewidth=0.7, clip_on=False,
    )  # fmt: skip


def apart(values: np.ndarray[Any, np.dtype[np.float64]]) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Return places beside the middle at which points of about the same value do not cover each other."""
    extent = float(np.ptp(values)) if np.isfinite(np.ptp(values)) else 0.0
    near = np.round((values - values.min()) / (extent / 25)) if extent > 0 else np.zeros(len(values))
    places = np.zeros(len(values))
    for level in np.unique(near):
        rows = np.flatnonzero(near == level)
        width = min(0.24, 0.06 * (len(rows) - 1))
        places[rows] = np.linspace(-width, width, len(rows)) if len(rows) > 1 else 0.0
    return places
