"""Mealy machines as state machines: states on a circle, an arrow for all rows with one target, and a list."""

import textwrap
from typing import TYPE_CHECKING

from swarmwright.controllers.diagram import Arrow, Diagram, Node, figure_with_list
from swarmwright.controllers.drawing import Drawing, Names
from swarmwright.controllers.kinds.mealy_fsm.transitions import Transition, reachable, transitions
from swarmwright.display.figures.style import INK, PAPER

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_MOST_STATES = 16
"""On a circle; beyond, transitions are drawn as a matrix."""
_MOST_ARROWS = 72
"""Arrows between states whose numbers are legible; more transitions are a matrix, too."""
_MOST_WRITTEN = 24
"""States of a matrix with numbers in its cells."""
_HIGHEST = 13.8  # inches
_MOST_SENSORS = 4
"""Sensors in an example of a condition; longer ones are not informative."""
_LINE_CHARACTERS = 78
"""Characters in a line of the list."""


def draw(drawing: Drawing) -> "Figure":
    """Return the figure of a `mealy_fsm`."""
    specification, names, title = drawing.specification, drawing.names, drawing.title
    found = transitions(specification, names)
    states = specification["states"]
    rows = len(specification["weights"]) // (1 + specification["actuators"])
    about = (
        f"{states} state{'s' if states > 1 else ''}, {rows:,} rows in its table; "
        "numbers: cases, combinations of what is sensed"
    )
    blocks = _list(found, states, names)
    if states > _MOST_STATES or len(found) > _MOST_ARROWS:
        figure, axes = figure_with_list(title, about, 7.0, blocks, letters=_LINE_CHARACTERS, highest=_HIGHEST)
        # The numbers of its axes need space.
        left, low, width, height = axes.get_position().bounds
        axes.set_position((left + 0.09 * width, low + 0.09 * height, 0.9 * width, 0.9 * height))
        _matrix(axes, found, states)
        return figure
    reached = reachable(found)
    diagram = Diagram(
        [Node(faint=index not in reached) for index in range(states)],
        [_arrow(one, alive=one.source in reached) for one in found],
        drawing.first_color,
    )
    figure, axes = figure_with_list(
        title, about, diagram.size, blocks, letters=_LINE_CHARACTERS, highest=_HIGHEST
    )
    diagram.draw(axes, "bold ring: state 0, in which every episode begins · dashed: never reached")
    return figure


def _arrow(one: Transition, *, alive: bool) -> Arrow:
    width = 0.8 + 2.4 * one.rows / one.of
    return Arrow(one.source, one.target, str(one.rows) if alive else "", width, faint=not alive)


def _matrix(axes: "Axes", found: list[Transition], states: int) -> None:
    import numpy as np

    shares = np.zeros((states, states))
    for one in found:
        shares[one.source, one.target] = one.rows / one.of
    axes.imshow(shares, cmap="Blues", vmin=0, vmax=1, interpolation="nearest")
    if states <= _MOST_WRITTEN:
        for one in found:
            color = PAPER if one.rows > 0.6 * one.of else INK
            axes.text(
                one.target, one.source, str(one.rows), ha="center", va="center", fontsize=8, color=color
            )
        axes.set_xticks(range(states))
        axes.set_yticks(range(states))
    axes.set_xlabel("to state", fontsize=11, color=INK)
    axes.set_ylabel("from state (darker: for more of what is sensed)", fontsize=11, color=INK)


def _list(found: list[Transition], states: int, names: Names) -> list[list[str]]:
    """Return the transitions of each state in words."""
    blocks: list[list[str]] = []
    reached = reachable(found)
    for state in range(states):
        lines = [f"state {state}" + ("" if state in reached else " (never reached)")]
        for one in (one for one in found if one.source == state):
            lines += _words(one, names)
        blocks.append(lines)
    return blocks


def _words(one: Transition, names: Names) -> list[str]:
    if one.rows == one.of:
        when = "always"
    elif one.exact:
        when = f"when {one.condition}"
    else:
        short = one.condition.count(",") < _MOST_SENSORS
        when = f"in {one.rows} of {one.of} cases" + (f", such as {one.condition}" if short else "")
    does = ", ".join(
        f"{name} {low:.2g}" if low == high else f"{name} {low:.2g} to {high:.2g}"
        for name, low, high in zip(names.actuators, one.lowest, one.highest, strict=True)
    )
    text = f"→ {one.target}  {when}: {does}"
    return textwrap.wrap(text, _LINE_CHARACTERS, initial_indent="  ", subsequent_indent="       ")
