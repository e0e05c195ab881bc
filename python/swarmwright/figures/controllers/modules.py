"""Machines of modules: states on a circle, an arrow for each transition, all of it in words; and trees."""

import textwrap
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from swarmwright.core.modules import State, condition_words, is_tree, states_of, words_of
from swarmwright.figures.controllers.state_machine import RADIUS, arc, loop, place_of
from swarmwright.figures.style import COLORS, INK, PAPER, SOFT, new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_WIDTH = 62
"""Characters in a line of the list."""
_LINE = 0.2  # inches


def draw(specification: Mapping[str, Any], title: str) -> "Figure":
    """Return the figure of a machine or tree of `modules`."""
    states = states_of(specification)
    if is_tree(specification):
        return _tree(states, title)
    lines = _list(states)
    figure = new_figure(12.0, min(max(5.6, 1.4 + _LINE * len(lines)), 20.0))
    left, right = figure.subplots(1, 2, width_ratios=[1, 1])
    _circle(left, states)
    right.axis("off")
    right.text(
        0, 1, "\n".join(lines), transform=right.transAxes, va="top", fontsize=9.5, color=INK,
        linespacing=1.35, parse_math=False, family="monospace",
    )  # fmt: skip
    figure.suptitle(title, x=0.012, ha="left", fontsize=13, fontweight="bold", color=INK, parse_math=False)
    count = sum(len(state.transitions) for state in states)
    plural = "s" if len(states) > 1 else ""
    left.set_title(
        f"modules, {len(states)} state{plural}, {count} transitions; numbers of transitions as in the list",
        loc="left", fontsize=10, color=SOFT,
    )  # fmt: skip
    return figure


def _tree(subtrees: tuple[State, ...], title: str) -> "Figure":
    """Return the figure of a tree: the root, a selector for each subtree, its condition and its behaviour."""
    count = len(subtrees)
    figure = new_figure(max(9.0, 3.4 * count), 4.6)
    axes = figure.subplots()
    root = ((count - 1) / 2, 2.0)
    box: dict[str, Any] = {"boxstyle": "round,pad=0.35", "facecolor": PAPER, "edgecolor": INK}
    text: dict[str, Any] = {"ha": "center", "va": "center", "color": INK, "fontsize": 9.5, "zorder": 5}
    axes.text(*root, "sequence*", bbox=box, **text)
    for index, subtree in enumerate(subtrees):
        select = (float(index), 1.15)
        axes.plot([root[0], select[0]], [root[1], select[1]], color=SOFT, linewidth=1.4, zorder=1)
        axes.text(*select, "?", bbox=box, **text)
        for side, words, color in (
            (-0.22, condition_words(subtree), COLORS[0]),
            (0.22, words_of(subtree), COLORS[1]),
        ):
            leaf = (index + side, 0.2)
            axes.plot([select[0], leaf[0]], [select[1], leaf[1]], color=SOFT, linewidth=1.4, zorder=1)
            axes.text(*leaf, textwrap.fill(words, 13), bbox={**box, "edgecolor": color}, **text)
    axes.set_xlim(-0.6, count - 0.4)
    axes.set_ylim(-0.35, 2.3)
    axes.axis("off")
    figure.suptitle(title, x=0.012, ha="left", fontsize=13, fontweight="bold", color=INK, parse_math=False)
    plural = "s" if count > 1 else ""
    axes.set_title(
        f"modules, tree of {count} subtree{plural}: the next one if the condition on the left holds, "
        "else the behaviour on the right",
        loc="left", fontsize=10, color=SOFT,
    )  # fmt: skip
    return figure


def _circle(axes: "Axes", states: tuple[State, ...]) -> None:
    from matplotlib.patches import Circle, FancyArrowPatch

    places = [place_of(index, len(states)) for index in range(len(states))]
    for index, state in enumerate(states):
        for target in sorted({one.target for one in state.transitions}):
            numbers = [str(k) for k, one in enumerate(state.transitions, 1) if one.target == target]
            path, label = loop(places[index]) if target == index else arc(places[index], places[target])
            arrow: dict[str, Any] = {"arrowstyle": "-|>", "mutation_scale": 14, "linewidth": 1.4}
            axes.add_patch(FancyArrowPatch(path=path, color=COLORS[0], alpha=0.75, zorder=2, **arrow))
            axes.text(
                *label, ", ".join(numbers), ha="center", va="center", fontsize=9, color=INK, zorder=6,
                bbox={"boxstyle": "round,pad=0.15", "facecolor": PAPER, "edgecolor": "none", "alpha": 0.85},
            )  # fmt: skip
    for index, (place, state) in enumerate(zip(places, states, strict=True)):
        line = 2.6 if index == 0 else 1.4
        axes.add_patch(Circle(place, RADIUS, facecolor=PAPER, edgecolor=INK, zorder=5, linewidth=line))
        text: dict[str, Any] = {"ha": "center", "color": INK, "zorder": 7}
        axes.text(*place, str(index), va="center", fontsize=13, fontweight="bold", **text)
        below = (place[0], place[1] - RADIUS - 0.05)
        axes.text(*below, state.behaviour.replace("_", "-"), va="top", fontsize=9.5, **text)
    axes.set_xlim(-1.75, 1.75)
    axes.set_ylim(-1.75, 1.75)
    axes.set_aspect("equal", anchor="N")
    axes.axis("off")
    words = "bold ring: state 0, in which every episode begins"
    axes.text(0, -1.72, words, ha="center", fontsize=9, color=SOFT)


def _list(states: tuple[State, ...]) -> list[str]:
    lines = []
    for index, state in enumerate(states):
        lines.append(f"state {index}: {words_of(state)}")
        for k, one in enumerate(state.transitions, 1):
            text = f"{k} {words_of(one)}"
            lines += textwrap.wrap(text, _WIDTH, initial_indent="  ", subsequent_indent="      ")
    return lines
