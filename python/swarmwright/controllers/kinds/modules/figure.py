"""Figures of machines and trees of modules."""

import textwrap
from typing import TYPE_CHECKING, Any

from swarmwright.controllers.diagram import Arrow, Diagram, Node, new_figure_with_list
from swarmwright.controllers.drawing import Drawing
from swarmwright.controllers.modules.grammar import State, is_tree, states_of
from swarmwright.controllers.modules.machine_texts import condition_words, name_of, words_of
from swarmwright.display.figures.style import COLORS, INK, PAPER, SOFT, draw_whole_title, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_LINE_CHARACTERS = 62
"""Characters in a line of the list."""


def draw(drawing: Drawing) -> "Figure":
    """Return the figure of a machine or tree of `modules`."""
    specification, title = drawing.specification, drawing.title
    states = states_of(specification)
    if is_tree(specification):
        return _draw_tree(states, title)
    diagram = Diagram(
        [Node(name_of(state.behaviour)) for state in states],
        [
            Arrow(index, target, _format_transition_numbers(state, target))
            for index, state in enumerate(states)
            for target in sorted({transition.target for transition in state.transitions})
        ],
        drawing.first_color,
    )
    count = sum(len(state.transitions) for state in states)
    plural = "s" if len(states) > 1 else ""
    about = (
        f"modules, {len(states)} state{plural}, {count} transitions; numbers of transitions as in the list"
    )
    figure, axes = new_figure_with_list(
        title, about, diagram.size, _list_states(states), letters=_LINE_CHARACTERS
    )
    diagram.draw(axes, "bold ring: state 0, in which every episode begins")
    return figure


def _draw_tree(subtrees: tuple[State, ...], title: str) -> "Figure":
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
    draw_whole_title(figure, title)
    plural = "s" if count > 1 else ""
    axes.set_title(
        f"behaviour tree of {count} subtree{plural}: where the condition on the left holds, the next "
        "subtree, else the behaviour on the right",
        loc="left", fontsize=10, color=SOFT,
    )  # fmt: skip
    axes.text(
        0, 0, "sequence*: sequence with memory, goes on with the subtree of the step before · ?: selector",
        transform=axes.transAxes, fontsize=9, color=SOFT, va="bottom",
    )  # fmt: skip
    return figure


def _format_transition_numbers(state: State, target: int) -> str:
    """Return the numbers of the transitions that lead to a state."""
    return ", ".join(
        str(k) for k, transition in enumerate(state.transitions, 1) if transition.target == target
    )


def _list_states(states: tuple[State, ...]) -> list[list[str]]:
    """Return the lines of each state."""
    blocks = []
    for index, state in enumerate(states):
        lines = textwrap.wrap(
            f"state {index}: {words_of(state)}", _LINE_CHARACTERS, subsequent_indent="      "
        )
        for k, transition in enumerate(state.transitions, 1):
            text = f"{k} {words_of(transition)}"
            lines += textwrap.wrap(text, _LINE_CHARACTERS, initial_indent="  ", subsequent_indent="      ")
        blocks.append(lines)
    return blocks
