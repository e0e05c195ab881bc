"""The figure of a comparison: how the groups got on, and what every run came to."""

import textwrap
from typing import TYPE_CHECKING, Any

import numpy as np

from swarmwright._results._curves import bands, together
from swarmwright._results._style import INK, PAPER, SOFT, dress, look, new_figure, thousands
from swarmwright._results._table import p_words

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from swarmwright._results.comparison import Comparison, Group

_LABEL = 34
"""Characters in a line of the legend."""
_CLEAR = 3
"""Groups up to which the worst and best runs are shaded as well; of more, one would see nothing."""


def draw(comparison: "Comparison", *, x: str = "evaluations") -> "Figure":
    """Return the figure. x: "evaluations" or "generations"."""
    groups = comparison.groups
    figure = new_figure(max(10.0, 8.6 + 0.42 * len(groups)), 5.4)
    left, right = figure.subplots(1, 2, width_ratios=[2.4, max(1.0, 0.32 * len(groups))])
    for index, one in enumerate(groups):
        _course(left, one, index, x, extremes=len(groups) <= _CLEAR)
        _final(right, one, index)
    dress(left, x=x, y="best fitness so far (more is better)")
    thousands(left.xaxis)
    left.margins(x=0.01)
    if comparison.at is not None and x == "evaluations":
        left.axvline(comparison.at, color=SOFT, linewidth=1, linestyle=":")
    when = "at the end" if comparison.at is None else f"after {comparison.at:,} evaluations"
    dress(right, y=f"best fitness of each run, {when}")
    right.set_xticks(range(len(groups)), [str(index + 1) for index in range(len(groups))])
    right.set_xlim(-0.6, len(groups) - 0.4)
    right.grid(visible=False, axis="x")
    right.set_xlabel("group", fontsize=11, color=INK)
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
        return f"Kruskal-Wallis p {p_words(comparison.kruskal.p)}"
    if not comparison.pairs:
        return ""
    found = comparison.pairs[0].difference
    return f"Mann-Whitney p {p_words(found.p)}, A12 {found.effect:.2f}"


def _legend(figure: "Figure", axes: "Axes", groups: "tuple[Group, ...]") -> None:
    handles, _ = axes.get_legend_handles_labels()
    labels = [
        "\n".join(
            textwrap.wrap(f"{index + 1}  {one.label} ({len(one.runs)})", _LABEL, subsequent_indent="    ")
        )
        for index, one in enumerate(groups)
    ]
    legend = figure.legend(
        handles, labels, loc="outside lower left", ncols=min(3, len(groups)), fontsize=10, frameon=False,
        labelcolor=INK,
    )  # fmt: skip
    for text in legend.get_texts():
        text.set_parse_math(False)
    shades = "dark: middle half · light: all" if len(groups) <= _CLEAR else "shaded: middle half"
    meaning = f"line: median of the runs · {shades}"
    if any(len(one.runs) > 1 for one in groups):
        axes.set_title(meaning, loc="left", fontsize=10, color=SOFT)


def _course(axes: "Axes", one: "Group", index: int, x: str, *, extremes: bool) -> None:
    color, dashes = look(index)
    places, values, shortest = together(one.runs, x)
    low, lower, middle, upper, high = bands(values)
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
    # Where runs have ended, their last values stand in for them.
    rest = places >= places[sure][-1]
    if np.count_nonzero(rest) > 1:
        axes.step(places[rest], middle[rest], where="post", color=color, linewidth=1.0, alpha=0.7)


def _final(axes: "Axes", one: "Group", index: int) -> None:
    color, _ = look(index)
    values = one.final[~np.isnan(one.final)]
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
