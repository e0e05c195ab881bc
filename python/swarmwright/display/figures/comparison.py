"""The figure of a comparison: curves of the groups, and the compared value of every run."""

import re
import textwrap
from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from swarmwright.common.formatting import format_count, format_p_value, shorten
from swarmwright.display.figures.run import Curve, align_runs, best_so_far, compute_bands, indicator_so_far
from swarmwright.display.figures.style import (
    AXES,
    INK,
    PAPER,
    SOFT,
    clip_drawable,
    current_page,
    cut_axis,
    draw_title,
    fit_columns,
    group_style,
    new_figure,
    scale_points,
    set_integer_ticks,
    style_axes,
    use_style_fonts,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from swarmwright.analysis.comparison import Comparison, Group, Task
    from swarmwright.analysis.designs import Design

Drawn = tuple[np.ndarray[Any, Any], np.ndarray[Any, Any], np.ndarray[Any, Any]]
_COLUMNS = 3
"""Largest number of columns of the legend."""
_LABEL = 34
"""Longest line of the legend, in characters."""
_NAME = 18
"""Longest line of a name below a box, in characters; parts of a name are on separate lines."""
_PARTS = re.compile(r", (?![^\[]*\])")  # not those within a list
_BREAKS = re.compile(r"(\s+|(?<=\w[.-])(?=[^\W\d]))")
"""Possible line breaks, not inside numbers."""
_NO_BREAK = "\u00a0"
_SLANTED = 44
"""Longest slanted name, in characters."""
_CHARACTER = 0.088
"""Inches per character of a name."""
_NAME_GAP_INCHES = 0.2
"""Inches between two names."""
_MARGINS = 0.2
"""Margin beside the outer boxes, relative to the space of a box."""
_OTHER_WIDTH_INCHES = 8.0
"""Inches of the figure without the boxes' axes: the curves, and labels of all axes."""
_LEVEL_NAMES_INCHES = 6.0
"""Largest width of the boxes' axes with horizontal names, in inches."""
_NARROW_ROW = 0.62
"""Height of axes with labels in a column, relative to its width."""
_LEAST_ROW = 2.4
"""Least height of these axes in inches, for texts as large as on screens."""
_VERTICAL_LETTER = 0.125
"""Inches per letter of the label of a vertical axis, which is at most as long as the axis."""
_BOXES_SHARE = 0.38
"""Width of the boxes beside the curves, relative to the page."""
_AXIS_INCHES = 0.7
"""Inches for the labels of a vertical axis."""
_ROW = 3.8
"""Height of a task in inches, if there are several."""
_MOST_TASKS = 20
"""Largest number of tasks with separate axes; more would make the figure too high."""
_TASK = 60
"""Longest task name, in characters."""
_AXIS = 24
"""Longest line of the label of a vertical axis, in characters, with several tasks."""
_AXIS_ALONE = 46
"""The same with a single task, whose axes are higher."""
_LEGEND_LINE_INCHES = 0.2
"""Height of a line of the legend, in inches."""
_MOST_SUBJECTS = 2
"""Largest number of simulations whose missions are in the title; with more, it lists the simulations only."""
_MOST_SHADED_GROUPS = 3
"""Largest number of groups with shading from the worst to the best run; more would be illegible."""


@use_style_fonts()
def draw(
    comparison: "Comparison",
    designs: "Sequence[Design]",
    *,
    x: str = "evaluations",
) -> "Figure":
    """Return the figure.

    Args:
        comparison: drawn in the order of its tasks and groups.
        designs: designs of its groups, which determine the colours.
        x: "evaluations" or "generations".
    """
    design_of = {id(group): design for design in designs for group in design.groups}
    tasks = comparison.tasks
    rows = [list(task.groups) for task in tasks]  # fitness has different units in different tasks
    if len(tasks) > _MOST_TASKS:
        rows = [[member for row in rows for member in row]]
    named_designs = [[design_of[id(member)].name for member in row] for row in rows]
    page = current_page()
    names = [_format_names(row) for row in named_designs]
    width = max(name.width for name in names)
    if names[-1].slanted and not page.narrow and all(row == named_designs[-1] for row in named_designs):
        # Rows share the names below the last row.
        names[:-1] = [_Names([""] * len(name.names), slanted=False, width=name.width) for name in names[:-1]]
    least = 5.4 if len(rows) == 1 else _ROW
    slanted = sum(
        0.6 * scale_points(_CHARACTER) * max(map(len, name.names)) for name in names if name.slanted
    )
    entries = [_format_entry(column) for column in designs]
    below = (
        _LEGEND_LINE_INCHES * sum(entry.count("\n") + 1 for entry in entries[::_COLUMNS])
        if len(rows) > 1
        else 0.0
    )
    characters = _AXIS if len(rows) > 1 or page.width is not None else _AXIS_ALONE
    if page.width is not None and page.narrow:  # boxes below the curves
        row_height = max(_NARROW_ROW * page.width, scale_points(_LEAST_ROW))
        characters = min(characters, int(row_height / scale_points(_VERTICAL_LETTER)))
        figure = new_figure(page.width, 2 * row_height * len(rows) + slanted + scale_points(below))
        axes = figure.subplots(2 * len(rows), 1, squeeze=False).reshape(-1, 2)
    else:
        figure = new_figure(_OTHER_WIDTH_INCHES + width, least * len(rows) + slanted + below)
        axes = figure.subplots(len(rows), 2, width_ratios=[6.0, width], squeeze=False)
    for (left, right), row, named in zip(axes, rows, names, strict=True):
        _draw_row(comparison, row, named, left, right, [design_of[id(member)] for member in row], x)
        for axis in (left.yaxis, right.yaxis):
            axis.set_label_text(textwrap.fill(axis.get_label_text(), characters))
    if len(rows) > 1:
        for (left, _), task in zip(axes, tasks, strict=True):
            title = shorten(task.label, _TASK)
            left.set_title(title, loc="left", fontsize=scale_points(11), color=INK, parse_math=False)
    if len(rows) == len(tasks):
        for (_, right), task in zip(axes, tasks, strict=True):
            right.set_title(_describe_test(task), loc="left", fontsize=scale_points(10), color=SOFT)
    groups = comparison.groups
    experiments = [group.runs[0].experiment for group in groups]
    subjects = sorted({experiment.subject for experiment in experiments})
    if len(subjects) > _MOST_SUBJECTS:
        subjects = sorted({experiment.label for experiment in experiments})
    draw_title(
        figure, f"{'; '.join(subjects)}: {format_count(sum(len(group.runs) for group in groups), 'run')}"
    )
    _draw_legend(figure, designs, entries, _describe_curves(groups))
    return figure


def _draw_row(
    comparison: "Comparison",
    groups: "Sequence[Group]",
    row_names: "_Names",
    left: "Axes",
    right: "Axes",
    designs: "Sequence[Design]",
    x: str,
) -> None:
    """Draw the curves of groups, and the compared values of their runs.

    designs: designs of the groups.
    """
    drawn = []
    indicator = comparison.indicator
    curve = partial(indicator_so_far, indicator) if indicator.has_curve else best_so_far
    for position, (group, design) in enumerate(zip(groups, designs, strict=True)):
        extremes = len(comparison.groups) <= _MOST_SHADED_GROUPS
        drawn.append(_draw_curve(left, group, design, x, curve, extremes=extremes))
        _draw_final(right, group, position, design.number)
    cut_axis(left, drawn)
    falls = any(run.best_words != "best so far" for group in groups for run in group.runs)
    best = "recorded fitness of the returned candidate" if falls else "best recorded fitness so far"
    subject = f"{indicator.words if indicator.has_curve else best} (more is better)"
    style_axes(left, x=AXES[x], y=subject)
    set_integer_ticks(left.xaxis, np.unique(np.concatenate([xs for xs, _, _ in drawn])))
    left.margins(x=0.01)
    if comparison.at is not None and x == "evaluations":
        left.axvline(comparison.at, color=SOFT, linewidth=scale_points(1), linestyle=":")
    if comparison.held_out:
        when = "on held-out seeds"
    else:
        when = "at the end" if comparison.at is None else f"after {comparison.at:,} evaluations"
        if comparison.at_episodes is not None:
            when = f"after {comparison.at_episodes:,} episodes"
    label = f"{indicator.words} of each run"
    if indicator.by == "fitness":
        label = "recorded fitness of the best of each run" if falls else "best recorded fitness of each run"
        if comparison.held_out:
            label = "fitness of each run's best"
    style_axes(right, y=f"{label}, {when}")
    style: dict[str, Any] = (
        {"rotation": 40, "ha": "right", "rotation_mode": "anchor"} if row_names.slanted else {}
    )
    right.set_xticks(range(len(groups)), row_names.names, **style)
    for text in right.get_xticklabels():
        text.set_parse_math(False)
    right.set_xlim(-0.5 - _MARGINS / 2, len(groups) - 0.5 + _MARGINS / 2)
    right.grid(visible=False, axis="x")


def _describe_test(task: "Task") -> str:
    """Describe the test of a task: the first box against the second, as in the table."""
    if task.kruskal is not None:  # a test of all runs can be significant with too few runs per pair
        return f"Kruskal-Wallis p {format_p_value(task.kruskal.p)}"
    if not task.pairs:
        return ""
    pair = task.pairs[0]
    if pair.difference.interval is None:
        return "too few runs for a test"
    return f"Mann-Whitney p {format_p_value(pair.difference.p)}, A12 {pair.difference.effect:.2f}"


class _Names(NamedTuple):
    """Names of groups below their boxes."""

    names: list[str]
    slanted: bool
    width: float
    """Required width of the axes in inches."""


def _format_names(labels: Sequence[str]) -> _Names:
    """Return the names below the boxes; they are slanted if they would overlap."""
    lines = [[line for part in _PARTS.split(label) for line in _wrap_name(part)] for label in labels]
    longest = max((len(line) for words in lines for line in words), default=0)
    width = (len(labels) + _MARGINS) * scale_points(_CHARACTER * longest + _NAME_GAP_INCHES)
    page = current_page()
    share = 1.0 if page.narrow else _BOXES_SHARE
    room = _LEVEL_NAMES_INCHES if page.width is None else share * (page.width - _AXIS_INCHES)
    if width <= room:
        return _Names(["\n".join(words) for words in lines], slanted=False, width=max(width, 3.0))
    slanted = [shorten(label, _SLANTED) for label in labels]
    return _Names(slanted, slanted=True, width=max(0.42 * len(labels), 3.0))


def _format_entry(design: "Design") -> str:
    """Return the wrapped legend entry of a design; its number of runs is not broken."""
    name, _, count = design.entry.rpartition(" (")
    whole = f"{name} ({count.replace(' ', _NO_BREAK)}"
    return "\n".join(textwrap.wrap(whole, _LABEL, subsequent_indent="    ")).replace(_NO_BREAK, " ")


class _Wrapper(textwrap.TextWrapper):
    """Breaks long words, such as keys of experiments, after dots and hyphens."""

    wordsep_re = _BREAKS


def _wrap_name(name: str) -> list[str]:
    return _Wrapper(_NAME).wrap(name)


def _describe_curves(groups: "tuple[Group, ...]") -> str:
    """Describe lines and shades of the curves; empty if each group has a single run."""
    if all(len(group.runs) == 1 for group in groups):
        return ""
    shades = "dark: middle half · light: all" if len(groups) <= _MOST_SHADED_GROUPS else "shaded: middle half"
    return f"line: median of the runs · {shades}"


def _draw_legend(figure: "Figure", designs: "Sequence[Design]", entries: Sequence[str], meaning: str) -> None:
    """Draw the legend of colours and shades below all axes."""
    from matplotlib.lines import Line2D

    handles = []
    for design in designs:
        color, dashes = group_style(design.number)
        style: dict[str, Any] = {"color": color, "linestyle": dashes, "linewidth": scale_points(2.2)}
        handles.append(Line2D([], [], **style))
    # Matplotlib fills columns, but the boxes are read row by row.
    columns = fit_columns(entries, _COLUMNS)
    order = [index for column in range(columns) for index in range(column, len(entries), columns)]
    meaning = textwrap.fill(meaning, int(figure.get_figwidth() / scale_points(_CHARACTER)))
    legend = figure.legend(
        [handles[index] for index in order], [entries[index] for index in order],
        loc="outside lower left", ncols=columns, fontsize=scale_points(10), frameon=False, labelcolor=INK,
        title=meaning or None, title_fontsize=scale_points(10), alignment="left",
    )  # fmt: skip
    legend.get_title().set_color(SOFT)
    for text in legend.get_texts():
        text.set_parse_math(False)


def _draw_curve(
    axes: "Axes", group: "Group", design: "Design", x: str, curve: Curve, *, extremes: bool
) -> Drawn:
    """Draw a group's curve; return x, and the smallest and largest drawn value at each x."""
    color, dashes = group_style(design.number)
    xs, values, shortest = align_runs(group.runs, x, curve)
    low, lower, middle, upper, high = map(clip_drawable, compute_bands(values))
    if len(group.runs) > 1:
        steps: dict[str, Any] = {"step": "post", "color": color, "linewidth": 0}
        if extremes:
            axes.fill_between(xs, low, high, alpha=0.10, **steps)
        axes.fill_between(xs, lower, upper, alpha=0.22, **steps)
    marker = "o" if np.count_nonzero(~np.isnan(middle)) == 1 else None
    sure = xs <= shortest
    axes.step(
        xs[sure], middle[sure], where="post", color=color, linestyle=dashes, linewidth=scale_points(2.2),
        marker=marker, label=design.name,
    )  # fmt: skip
    # Ended runs keep their last value.
    ended = xs >= xs[sure][-1]
    if np.count_nonzero(ended) > 1:
        axes.step(xs[ended], middle[ended], where="post", color=color, linewidth=scale_points(1.0), alpha=0.7)
    return (xs, low, high) if extremes else (xs, lower, upper)


def _draw_final(axes: "Axes", group: "Group", position: int, number: int) -> None:
    """Draw the compared values of a group's runs; number: index of its colour."""
    color, _ = group_style(number)
    values = clip_drawable(group.final[~np.isnan(group.final)])
    if not len(values):
        axes.text(position, 0.5, "all failed", transform=axes.get_xaxis_transform(), ha="center", rotation=90)
        return
    if len(values) > 1:
        low, middle, high = np.quantile(values, [0.25, 0.5, 0.75])
        axes.fill_between([position - 0.3, position + 0.3], low, high, color=color, alpha=0.18, linewidth=0)
        axes.hlines([low, high], position - 0.3, position + 0.3, color=color, linewidth=scale_points(1.0))
        axes.hlines(middle, position - 0.3, position + 0.3, color=color, linewidth=scale_points(2.4))
    axes.plot(
        position + spread_points(values), values, "o", markersize=scale_points(6), color=color, alpha=0.85,
        markeredgecolor=PAPER, markeredgewidth=scale_points(0.7), clip_on=False,
    )  # fmt: skip


def spread_points(values: np.ndarray[Any, np.dtype[np.float64]]) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Return horizontal offsets at which points of similar values do not overlap."""
    extent = float(np.ptp(values)) if np.isfinite(np.ptp(values)) else 0.0
    levels = np.round((values - values.min()) / (extent / 25)) if extent > 0 else np.zeros(len(values))
    offsets = np.zeros(len(values))
    for level in np.unique(levels):
        rows = np.flatnonzero(levels == level)
        width = min(0.24, 0.06 * (len(rows) - 1))
        offsets[rows] = np.linspace(-width, width, len(rows)) if len(rows) > 1 else 0.0
    return offsets
