"""Mealy machines as state machines: states on a circle, an arrow for all rows with one target, and a list.

A summary of a Mealy machine's table: transitions, their conditions and outputs.
"""

import math
import textwrap
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from swarmwright.controllers.diagram import Arrow, Diagram, Node, new_figure_with_list
from swarmwright.controllers.drawing import Drawing, Names
from swarmwright.display.figures.style import INK, PAPER

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


Box = list[tuple[int, int]]
"""First and last interval of each sensor."""

_MOST_BOXES = 3
"""Largest number of parts of a condition that is written in full."""
_BEGINNINGS = 8
"""Number of combinations from which boxes are grown."""


@dataclass(frozen=True)
class Transition:
    """All rows of the table that lead from one state to another."""

    source: int
    target: int
    rows: int
    """Combinations of intervals that lead there."""
    total: int
    """All combinations of intervals."""
    condition: str
    """`goal x > 0, defender y ≤ 0.5; or goal y > 0`; only its largest part if it is not exact."""
    exact: bool
    """Whether the condition holds for exactly these rows."""
    lowest: NDArray[np.float64]
    """(actuators,), lowest output on the way."""
    highest: NDArray[np.float64]
    """(actuators,), highest output on the way."""


def find_transitions(specification: Mapping[str, Any], names: Names) -> list[Transition]:
    """Return the transitions of a `mealy_fsm`, by source and then by target."""
    states, thresholds = specification["states"], specification["thresholds"]
    sizes = [len(edges) + 1 for edges in thresholds]
    combinations = math.prod(sizes)
    table = np.array(specification["weights"], dtype=np.float64).reshape(states, combinations, -1)
    targets = np.clip(np.floor(table[:, :, 0]), 0, states - 1).astype(int)
    outputs = np.clip(table[:, :, 1:], -1.0, 1.0)
    transitions = []
    for source in range(states):
        for target in np.unique(targets[source]):
            chosen = targets[source] == target
            boxes, exact = _cover_with_boxes(chosen.reshape(sizes))
            words = [_describe_condition(box, thresholds, names, sizes) for box in boxes]
            chosen_outputs = outputs[source][chosen]
            transitions.append(
                Transition(
                    source, int(target), int(chosen.sum()), combinations,
                    "; or ".join(words) if exact else words[0], exact,
                    chosen_outputs.min(axis=0), chosen_outputs.max(axis=0),
                )
            )  # fmt: skip
    return transitions


def find_reachable(transitions: list[Transition]) -> set[int]:
    """Return the states that an episode, which begins in state 0, can reach."""
    reached, new = {0}, {0}
    while new:
        new = {transition.target for transition in transitions if transition.source in new} - reached
        reached |= new
    return reached


def _cover_with_boxes(chosen: NDArray[np.bool_]) -> tuple[list[Box], bool]:
    """Cover combinations of intervals with boxes, greedily, largest first.

    chosen: an axis for each sensor; at least one is true.

    Returns:
        At most a few boxes, and whether they cover everything.
    """
    uncovered = chosen.copy()
    boxes: list[Box] = []
    while uncovered.any() and len(boxes) < _MOST_BOXES:
        beginnings = np.argwhere(uncovered)[:_BEGINNINGS]
        axes = range(chosen.ndim)
        candidates = [
            _grow_box(chosen, tuple(map(int, beginning)), order)
            for beginning in beginnings
            for order in (axes, reversed(axes))
        ]
        best = max(candidates, key=lambda box: int(uncovered[_slices(box)].sum()))
        boxes.append(best)
        uncovered[_slices(best)] = False
    return boxes, not uncovered.any()


def _grow_box(chosen: NDArray[np.bool_], beginning: tuple[int, ...], order: Iterable[int]) -> Box:
    """Widen a combination axis by axis while it contains chosen combinations only."""
    box = [(index, index) for index in beginning]
    for axis in order:
        for step in (1, -1):
            while True:
                low, high = box[axis]
                wider = (low, high + 1) if step > 0 else (low - 1, high)
                if wider[0] < 0 or wider[1] >= chosen.shape[axis]:
                    break
                if not chosen[_slices([*box[:axis], wider, *box[axis + 1 :]])].all():
                    break
                box[axis] = wider
    return box


def _slices(box: Box) -> tuple[slice, ...]:
    return tuple(slice(low, high + 1) for low, high in box)


def _describe_condition(box: Box, thresholds: list[list[float]], names: Names, sizes: list[int]) -> str:
    words = []
    for name, edges, size, (low, high) in zip(names.sensors, thresholds, sizes, box, strict=True):
        # A sensor is in interval i when i thresholds are less than it.
        if low == 0 and high == size - 1:
            continue
        if low == 0:
            words.append(f"{name} ≤ {edges[high]:.3g}")
        elif high == size - 1:
            words.append(f"{name} > {edges[low - 1]:.3g}")
        else:
            words.append(f"{edges[low - 1]:.3g} < {name} ≤ {edges[high]:.3g}")
    return ", ".join(words)


_MOST_STATES = 16
"""Largest number of states on a circle; larger machines are drawn as a matrix."""
_MOST_ARROWS = 72
"""Largest number of arrows with legible numbers; with more transitions, the machine is drawn as a matrix."""
_MOST_WRITTEN = 24
"""Largest number of states of a matrix with numbers in its cells."""
_HIGHEST = 13.8  # inches
_MOST_SENSORS = 4
"""Largest number of sensors in an example of a condition; longer examples are not informative."""
_LINE_CHARACTERS = 78
"""Characters in a line of the list."""


def draw(drawing: Drawing) -> "Figure":
    """Return the figure of a `mealy_fsm`."""
    specification, names, title = drawing.specification, drawing.names, drawing.title
    transitions = find_transitions(specification, names)
    states = specification["states"]
    rows = len(specification["weights"]) // (1 + specification["actuators"])
    about = (
        f"{states} state{'s' if states > 1 else ''}, {rows:,} rows in its table; "
        "numbers: cases, combinations of sensor intervals"
    )
    blocks = _list_transitions(transitions, states, names)
    if states > _MOST_STATES or len(transitions) > _MOST_ARROWS:
        figure, axes = new_figure_with_list(
            title, about, 7.0, blocks, letters=_LINE_CHARACTERS, highest=_HIGHEST
        )
        # Leave space for the labels of the axes.
        left, low, width, height = axes.get_position().bounds
        axes.set_position((left + 0.09 * width, low + 0.09 * height, 0.9 * width, 0.9 * height))
        _draw_matrix(axes, transitions, states)
        return figure
    reached = find_reachable(transitions)
    diagram = Diagram(
        [Node(faint=index not in reached) for index in range(states)],
        [_make_arrow(transition, alive=transition.source in reached) for transition in transitions],
        drawing.first_color,
    )
    figure, axes = new_figure_with_list(
        title, about, diagram.size, blocks, letters=_LINE_CHARACTERS, highest=_HIGHEST
    )
    diagram.draw(axes, "bold ring: state 0, in which every episode begins · dashed: never reached")
    return figure


def _make_arrow(transition: Transition, *, alive: bool) -> Arrow:
    width = 0.8 + 2.4 * transition.rows / transition.total
    return Arrow(
        transition.source, transition.target, str(transition.rows) if alive else "", width, faint=not alive
    )


def _draw_matrix(axes: "Axes", transitions: list[Transition], states: int) -> None:
    import numpy as np

    shares = np.zeros((states, states))
    for transition in transitions:
        shares[transition.source, transition.target] = transition.rows / transition.total
    axes.imshow(shares, cmap="Blues", vmin=0, vmax=1, interpolation="nearest")
    if states <= _MOST_WRITTEN:
        for transition in transitions:
            color = PAPER if transition.rows > 0.6 * transition.total else INK
            axes.text(
                transition.target,
                transition.source,
                str(transition.rows),
                ha="center",
                va="center",
                fontsize=8,
                color=color,
            )
        axes.set_xticks(range(states))
        axes.set_yticks(range(states))
    axes.set_xlabel("to state", fontsize=11, color=INK)
    axes.set_ylabel("from state (darker: in more cases)", fontsize=11, color=INK)


def _list_transitions(transitions: list[Transition], states: int, names: Names) -> list[list[str]]:
    """Return the transitions of each state in words."""
    blocks: list[list[str]] = []
    reached = find_reachable(transitions)
    for state in range(states):
        lines = [f"state {state}" + ("" if state in reached else " (never reached)")]
        for transition in (transition for transition in transitions if transition.source == state):
            lines += _describe_transition(transition, names)
        blocks.append(lines)
    return blocks


def _describe_transition(transition: Transition, names: Names) -> list[str]:
    if transition.rows == transition.total:
        when = "always"
    elif transition.exact:
        when = f"when {transition.condition}"
    else:
        short = transition.condition.count(",") < _MOST_SENSORS
        when = f"in {transition.rows} of {transition.total} cases" + (
            f", such as {transition.condition}" if short else ""
        )
    does = ", ".join(
        f"{name} {low:.2g}" if low == high else f"{name} {low:.2g} to {high:.2g}"
        for name, low, high in zip(names.actuators, transition.lowest, transition.highest, strict=True)
    )
    text = f"→ {transition.target}  {when}: {does}"
    return textwrap.wrap(text, _LINE_CHARACTERS, initial_indent="  ", subsequent_indent="       ")
