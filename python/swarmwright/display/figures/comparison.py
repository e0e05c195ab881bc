"""The figure of a comparison: curves of the groups, and what is compared of every run."""

import re
import textwrap
from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from swarmwright.common.formatting import format_count, format_p_value, shorten
from swarmwright.display.figures.curves import Curve, bands, best_so_far, indicator_so_far, together
from swarmwright.display.figures.style import (
    AXES,
    INK,
    PAPER,
    SOFT,
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
    zoom,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from swarmwright.analysis.comparison import Comparison, Group, Task
    from swarmwright.analysis.designs import Design

Drawn = tuple[np.ndarray[Any, Any], np.ndarray[Any, Any], np.ndarray[Any, Any]]
_COLUMNS = 3
"""Columns of the legend, at most."""
_LABEL = 34
"""Characters in a line of the legend."""
_NAME = 18
"""Characters in a line of a name below a box; the parts of a name are in separate lines."""
_PARTS = re.compile(r", (?![^\[]*\])")  # not those within a list
_BREAKS = re.compile(r"(\s+|(?<=\w[.-])(?=[^\W\d]))")
"""Where such a line may end: a number stays whole."""
_NO_BREAK = "\u00a0"
_SLANTED = 44
"""Characters of a name that is slanted, in one line."""
_CHARACTER = 0.088
"""Inches that a character of a name needs."""
_NAME_GAP_INCHES = 0.2
"""Inches between two names."""
_MARGINS = 0.2
"""Room beside the outer boxes, as a share of that of a box."""
_OTHER_WIDTH_INCHES = 8.0
"""Inches of the figure beside the boxes' axes: the curves, and labels of all axes."""
_LEVEL_NAMES_INCHES = 6.0
"""Inches of the boxes' axes beyond which their names are slanted."""
_NARROW_ROW = 0.62
"""Height of axes with their labels in a column, as a share of its width."""
_LEAST_ROW = 2.4
"""Inches of the same at least, with texts as large as on screens."""
_VERTICAL_LETTER = 0.125
"""Inches of it that a letter of the label of a vertical axis takes, which is as long as the axis at most."""
_BOXES_SHARE = 0.38
"""Share of a page's width that boxes have beside curves."""
_AXIS_INCHES = 0.7
"""Inches that the labels of a vertical axis need."""
_ROW = 3.8
"""Inches of the height of a task, where there are several."""
_MOST_TASKS = 20
"""Tasks up to which each has axes of its own; more would make the figure too high."""
_TASK = 60
"""Characters of a task's name."""
_AXIS = 24
"""Characters in a line of the label of a vertical axis, where there are several tasks."""
_AXIS_ALONE = 46
"""The same where there is one task, whose axes are higher."""
_LEGEND_LINE_INCHES = 0.2
"""Inches of a line of the legend."""
_MOST_SUBJECTS = 2
"""Simulations with a mission that a title names; of more, it has the simulations alone."""
_MOST_SHADED_GROUPS = 3
"""Groups up to which the worst and best runs are shaded as well; more would be illegible."""


@styled()
def draw(
    comparison: "Comparison",
    designs: "Sequence[Design]",
    *,
    x: str = "evaluations",
) -> "Figure":
    """Return the figure.

    Args:
        comparison: what is drawn, in the order of its tasks and groups.
        designs: those of its groups, by which groups have colours.
        x: "evaluations" or "generations".
    """
    design_of = {id(group): design for design in designs for group in design.groups}
    tasks = comparison.tasks
    rows = [list(task.groups) for task in tasks]  # fitness of unlike tasks has unlike units
    if len(tasks) > _MOST_TASKS:
        rows = [[member for row in rows for member in row]]
    named_designs = [[design_of[id(member)].name for member in row] for row in rows]
    page = current()
    names = [_names(row) for row in named_designs]
    width = max(name.width for name in names)
    if names[-1].slanted and not page.narrow and all(row == named_designs[-1] for row in named_designs):
        # One below the other: the names of the last row are those of all.
        names[:-1] = [_Names([""] * len(name.names), slanted=False, width=name.width) for name in names[:-1]]
    least = 5.4 if len(rows) == 1 else _ROW
    slanted = sum(0.6 * points(_CHARACTER) * max(map(len, name.names)) for name in names if name.slanted)
    entries = [_entry(column) for column in designs]
    below = (
        _LEGEND_LINE_INCHES * sum(entry.count("\n") + 1 for entry in entries[::_COLUMNS])
        if len(rows) > 1
        else 0.0
    )
    characters = _AXIS if len(rows) > 1 or page.width is not None else _AXIS_ALONE
    if page.width is not None and page.narrow:  # boxes below the curves
        row_height = max(_NARROW_ROW * page.width, points(_LEAST_ROW))
        characters = min(characters, int(row_height / points(_VERTICAL_LETTER)))
        figure = new_figure(page.width, 2 * row_height * len(rows) + slanted + points(below))
        axes = figure.subplots(2 * len(rows), 1, squeeze=False).reshape(-1, 2)
    else:
        figure = new_figure(_OTHER_WIDTH_INCHES + width, least * len(rows) + slanted + below)
        axes = figure.subplots(len(rows), 2, width_ratios=[6.0, width], squeeze=False)
    for (left, right), row, named in zip(axes, rows, names, strict=True):
        _row(comparison, row, named, left, right, [design_of[id(member)] for member in row], x)
        for axis in (left.yaxis, right.yaxis):
            axis.set_label_text(textwrap.fill(axis.get_label_text(), characters))
    if len(rows) > 1:
        for (left, _), task in zip(axes, tasks, strict=True):
            title = shorten(task.label, _TASK)
            left.set_title(title, loc="left", fontsize=points(11), color=INK, parse_math=False)
    if len(rows) == len(tasks):
        for (_, right), task in zip(axes, tasks, strict=True):
            right.set_title(_verdict(task), loc="left", fontsize=points(10), color=SOFT)
    groups = comparison.groups
    experiments = [group.runs[0].experiment for group in groups]
    subjects = sorted({experiment.subject for experiment in experiments})
    if len(subjects) > _MOST_SUBJECTS:
        subjects = sorted({experiment.label for experiment in experiments})
    entitle(figure, f"{'; '.join(subjects)}: {format_count(sum(len(group.runs) for group in groups), 'run')}")
    _legend(figure, designs, entries, _meaning(groups))
    return figure


def _row(
    comparison: "Comparison",
    groups: "Sequence[Group]",
    named: "_Names",
    left: "Axes",
    right: "Axes",
    designs: "Sequence[Design]",
    x: str,
) -> None:
    """Draw the curves of groups, and what is compared of their runs.

    designs: those of the groups.
    """
    drawn = []
    indicator = comparison.indicator
    curve = partial(indicator_so_far, indicator) if indicator.has_curve else best_so_far
    for place, (group, design) in enumerate(zip(groups, designs, strict=True)):
        extremes = len(comparison.groups) <= _MOST_SHADED_GROUPS
        drawn.append(_curve(left, group, design, x, curve, extremes=extremes))
        _final(right, group, place, design.number)
    zoom(left, drawn)
    falls = any(run.best_words != "best so far" for group in groups for run in group.runs)
    best = "recorded fitness of the returned candidate" if falls else "best recorded fitness so far"
    subject = f"{indicator.words if indicator.has_curve else best} (more is better)"
    dress(left, x=AXES[x], y=subject)
    whole_ticks(left.xaxis, np.unique(np.concatenate([places for places, _, _ in drawn])))
    left.margins(x=0.01)
    if comparison.at is not None and x == "evaluations":
        left.axvline(comparison.at, color=SOFT, linewidth=points(1), linestyle=":")
    if comparison.held_out:
        when = "on held-out seeds"
    else:
        when = "at the end" if comparison.at is None else f"after {comparison.at:,} evaluations"
        if comparison.at_episodes is not None:
            when = f"after {comparison.at_episodes:,} episodes"
    what = f"{indicator.words} of each run"
    if indicator.by == "fitness":
        what = "recorded fitness of the best of each run" if falls else "best recorded fitness of each run"
        if comparison.held_out:
            what = "fitness of each run's best"
    dress(right, y=f"{what}, {when}")
    style: dict[str, Any] = (
        {"rotation": 40, "ha": "right", "rotation_mode": "anchor"} if named.slanted else {}
    )
    right.set_xticks(range(len(groups)), named.names, **style)
    for text in right.get_xticklabels():
        text.set_parse_math(False)
    right.set_xlim(-0.5 - _MARGINS / 2, len(groups) - 0.5 + _MARGINS / 2)
    right.grid(visible=False, axis="x")


def _verdict(task: "Task") -> str:
    """Return the test of a task in words, of the first box against the second as in the table."""
    if task.kruskal is not None:  # of all runs: it can be significant where those of each pair are too few
        return f"Kruskal-Wallis p {format_p_value(task.kruskal.p)}"
    if not task.pairs:
        return ""
    pair = task.pairs[0]
    if pair.difference.interval is None:
        return "too few runs for a test"
    return f"Mann-Whitney p {format_p_value(pair.difference.p)}, A12 {pair.difference.effect:.2f}"


class _Names(NamedTuple):
    """Names of groups for below their boxes."""

    names: list[str]
    slanted: bool
    width: float
    """Inches that the axes need."""


def _names(labels: Sequence[str]) -> _Names:
    """Return names of groups for below their boxes; those that would overlap are slanted."""
    lines = [[line for part in _PARTS.split(label) for line in _wrapped(part)] for label in labels]
    longest = max((len(line) for words in lines for line in words), default=0)
    width = (len(labels) + _MARGINS) * points(_CHARACTER * longest + _NAME_GAP_INCHES)
    page = current()
    share = 1.0 if page.narrow else _BOXES_SHARE
    room = _LEVEL_NAMES_INCHES if page.width is None else share * (page.width - _AXIS_INCHES)
    if width <= room:
        return _Names(["\n".join(words) for words in lines], slanted=False, width=max(width, 3.0))
    slanted = [shorten(label, _SLANTED) for label in labels]
    return _Names(slanted, slanted=True, width=max(0.42 * len(labels), 3.0))


def _entry(design: "Design") -> str:
    """Return what the legend calls a design, in lines; the number of runs is not broken."""
    name, _, count = design.entry.rpartition(" (")
    whole = f"{name} ({count.replace(' ', _NO_BREAK)}"
    return "\n".join(textwrap.wrap(whole, _LABEL, subsequent_indent="    ")).replace(_NO_BREAK, " ")


class _Wrapper(textwrap.TextWrapper):
    """Breaks long words, such as keys of experiments, behind points and hyphens."""

    wordsep_re = _BREAKS


def _wrapped(name: str) -> list[str]:
    return _Wrapper(_NAME).wrap(name)


def _meaning(groups: "tuple[Group, ...]") -> str:
    """Return what lines and shades of the curves mean; nothing where each group is one run."""
    if all(len(group.runs) == 1 for group in groups):
        return ""
    shades = "dark: middle half · light: all" if len(groups) <= _MOST_SHADED_GROUPS else "shaded: middle half"
    return f"line: median of the runs · {shades}"


def _legend(figure: "Figure", designs: "Sequence[Design]", entries: Sequence[str], meaning: str) -> None:
    """Explain the colours of designs, and the shades, below all axes."""
    from matplotlib.lines import Line2D

    handles = []
    for design in designs:
        color, dashes = look(design.number)
        style: dict[str, Any] = {"color": color, "linestyle": dashes, "linewidth": points(2.2)}
        handles.append(Line2D([], [], **style))
    # matplotlib fills columns; the order of the boxes is read row by row.
    columns = fitting_columns(entries, _COLUMNS)
    order = [index for column in range(columns) for index in range(column, len(entries), columns)]
    meaning = textwrap.fill(meaning, int(figure.get_figwidth() / points(_CHARACTER)))
    legend = figure.legend(
        [handles[index] for index in order], [entries[index] for index in order],
        loc="outside lower left", ncols=columns, fontsize=points(10), frameon=False, labelcolor=INK,
        title=meaning or None, title_fontsize=points(10), alignment="left",
    )  # fmt: skip
    legend.get_title().set_color(SOFT)
    for text in legend.get_texts():
        text.set_parse_math(False)


def _curve(axes: "Axes", group: "Group", design: "Design", x: str, curve: Curve, *, extremes: bool) -> Drawn:
    """Draw a group's curve; return x, and the least and the greatest that is drawn there."""
    color, dashes = look(design.number)
    places, values, shortest = together(group.runs, x, curve)
    low, lower, middle, upper, high = map(drawable, bands(values))
    if len(group.runs) > 1:
        steps: dict[str, Any] = {"step": "post", "color": color, "linewidth": 0}
        if extremes:
            axes.fill_between(places, low, high, alpha=0.10, **steps)
        axes.fill_between(places, lower, upper, alpha=0.22, **steps)
    marker = "o" if np.count_nonzero(~np.isnan(middle)) == 1 else None
    sure = places <= shortest
    axes.step(
        places[sure], middle[sure], where="post", color=color, linestyle=dashes, linewidth=points(2.2),
        marker=marker, label=design.name,
    )  # fmt: skip
    # Where runs have ended, their last values are used.
    rest = places >= places[sure][-1]
    if np.count_nonzero(rest) > 1:
        axes.step(places[rest], middle[rest], where="post", color=color, linewidth=points(1.0), alpha=0.7)
    return (places, low, high) if extremes else (places, lower, upper)


def _final(axes: "Axes", group: "Group", place: int, number: int) -> None:
    """Draw what is compared of a group's runs; number: of its colour."""
    color, _ = look(number)
    values = drawable(group.final[~np.isnan(group.final)])
    if not len(values):
        axes.text(place, 0.5, "all failed", transform=axes.get_xaxis_transform(), ha="center", rotation=90)
        return
    if len(values) > 1:
        low, middle, high = np.quantile(values, [0.25, 0.5, 0.75])
        axes.fill_between([place - 0.3, place + 0.3], low, high, color=color, alpha=0.18, linewidth=0)
        axes.hlines([low, high], place - 0.3, place + 0.3, color=color, linewidth=points(1.0))
        axes.hlines(middle, place - 0.3, place + 0.3, color=color, linewidth=points(2.4))
    axes.plot(
        place + apart(values), values, "o", markersize=points(6), color=color, alpha=0.85,
        markeredgecolor=PAPER, markeredgewidth=points(0.7), clip_on=False,
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
