"""Mealy machines as state machines: states on a circle, an arrow for all rows with one target, and a list."""

import math
import textwrap
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from swarmwright.figures.controllers.names import Names
from swarmwright.figures.controllers.transitions import Transition, reachable, transitions
from swarmwright.figures.style import COLORS, INK, PAPER, SOFT, new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_MOST_STATES = 16
"""On a circle; beyond, transitions are drawn as a matrix."""
_MOST_LINES = 44
"""Lines of the list, what is below is left out."""
_LONGEST = 4
"""Sensors in an example of a condition; longer ones are not informative."""
_WIDTH = 78
"""Characters in a line of the list."""
RADIUS = 0.17  # of a state, where the circle of states has 1
_LINE = 0.18  # inches


def draw(specification: Mapping[str, Any], names: Names, title: str) -> "Figure":
    """Return the figure of a `mealy_fsm`."""
    found = transitions(specification, names)
    states = specification["states"]
    lines = _list(found, states, names)
    figure = new_figure(13.0, min(max(5.6, 1.4 + _LINE * len(lines)), 14.0))
    left, right = figure.subplots(1, 2, width_ratios=[1, 1.2])
    if states <= _MOST_STATES:
        _circle(left, found, states)
    else:
        _matrix(left, found, states)
    right.axis("off")
    right.text(
        0, 1, "\n".join(lines), transform=right.transAxes, va="top", fontsize=9.5, color=INK,
        linespacing=1.35, parse_math=False, family="monospace",
    )  # fmt: skip
    figure.suptitle(title, x=0.012, ha="left", fontsize=13, fontweight="bold", color=INK, parse_math=False)
    rows = len(specification["weights"]) // (1 + specification["actuators"])
    left.set_title(
        f"{states} state{'s' if states > 1 else ''}, {rows:,} rows in its table; "
        "numbers: cases, combinations of what is sensed",
        loc="left", fontsize=10, color=SOFT,
    )  # fmt: skip
    return figure


def _circle(axes: "Axes", found: list[Transition], states: int) -> None:
    from matplotlib.patches import Circle, FancyArrowPatch

    places = [place_of(index, states) for index in range(states)]
    reached = reachable(found)
    for one in found:
        share = one.rows / one.of
        alive = one.source in reached
        color = COLORS[0] if alive else SOFT
        line = 0.8 + 3.2 * share
        arrow: dict[str, Any] = {
            "arrowstyle": "-|>", "mutation_scale": 9 + 2.5 * line, "color": color, "linewidth": line,
            "alpha": 0.75 if alive else 0.3, "zorder": 2,
        }  # fmt: skip
        if one.source == one.target:
            path, label = loop(places[one.source])
            axes.add_patch(FancyArrowPatch(path=path, **arrow))
        else:
            path, label = arc(places[one.source], places[one.target])
            axes.add_patch(FancyArrowPatch(path=path, **arrow))
        if not alive:
            continue
        axes.text(
            *label, f"{one.rows}", ha="center", va="center", fontsize=9, color=INK, zorder=6,
            bbox={"boxstyle": "round,pad=0.15", "facecolor": PAPER, "edgecolor": "none", "alpha": 0.85},
        )  # fmt: skip
    for index, place in enumerate(places):
        alive = index in reached
        axes.add_patch(
            Circle(
                place, RADIUS, facecolor=PAPER, edgecolor=INK if alive else SOFT, zorder=5,
                linewidth=2.6 if index == 0 else 1.4, linestyle="-" if alive else "--",
            )
        )  # fmt: skip
        text = {"ha": "center", "va": "center", "fontsize": 13, "fontweight": "bold", "zorder": 7}
        axes.text(*place, str(index), color=INK if alive else SOFT, **text)  # type: ignore[arg-type]
    axes.set_xlim(-1.75, 1.75)
    axes.set_ylim(-1.75, 1.75)
    axes.set_aspect("equal", anchor="N")
    axes.axis("off")
    axes.text(
        0, -1.72, "bold ring: state 0, in which every episode begins · dashed: never reached", ha="center",
        fontsize=9, color=SOFT,
    )  # fmt: skip


def place_of(index: int, states: int) -> tuple[float, float]:
    """Return where a state is on the circle, state 0 on top; a single one is in the middle."""
    if states == 1:
        return 0.0, 0.0
    return math.sin(2 * math.pi * index / states), math.cos(2 * math.pi * index / states)


def arc(source: tuple[float, float], target: tuple[float, float]) -> tuple[Any, tuple[float, float]]:
    """Return a way that keeps to its right, the way back lies beside it, and the position of its label."""
    from matplotlib.path import Path

    (x0, y0), (x1, y1) = source, target
    length = math.hypot(x1 - x0, y1 - y0)
    side = ((y1 - y0) / length, -(x1 - x0) / length)
    bend = 0.12 * length
    middle = ((x0 + x1) / 2 + bend * side[0], (y0 + y1) / 2 + bend * side[1])
    begin, end = _towards(source, middle), _towards(target, middle)
    # Nearer to the source: there arrows to different states are apart.
    t = 0.42
    label = tuple((1 - t) ** 2 * begin[i] + 2 * t * (1 - t) * middle[i] + t**2 * end[i] for i in (0, 1))
    return Path([begin, middle, end], [Path.MOVETO, Path.CURVE3, Path.CURVE3]), (label[0], label[1])


def _towards(place: tuple[float, float], other: tuple[float, float]) -> tuple[float, float]:
    """Return the point on a state's border in the direction of another place."""
    length = math.hypot(other[0] - place[0], other[1] - place[1])
    share = (RADIUS + 0.015) / length
    return place[0] + share * (other[0] - place[0]), place[1] + share * (other[1] - place[1])


def loop(place: tuple[float, float]) -> tuple[Any, tuple[float, float]]:
    """Return a way from a state outwards and back, and the position of its label."""
    from matplotlib.path import Path

    x, y = place
    direction = math.atan2(y, x) if (x, y) != (0.0, 0.0) else math.pi / 2

    def point(angle: float, radius: float) -> tuple[float, float]:
        return x + radius * math.cos(direction + angle), y + radius * math.sin(direction + angle)

    ways = [point(0.55, RADIUS), point(0.75, 0.62), point(-0.75, 0.62), point(-0.55, RADIUS + 0.015)]
    return Path(ways, [Path.MOVETO, Path.CURVE4, Path.CURVE4, Path.CURVE4]), point(0, 0.46)


def _matrix(axes: "Axes", found: list[Transition], states: int) -> None:
    import numpy as np

    shares = np.zeros((states, states))
    for one in found:
        shares[one.source, one.target] = one.rows / one.of
    axes.imshow(shares, cmap="Blues", vmin=0, vmax=1, interpolation="nearest")
    axes.set_xlabel("to state", fontsize=11, color=INK)
    axes.set_ylabel("from state (darker: for more of what is sensed)", fontsize=11, color=INK)


def _list(found: list[Transition], states: int, names: Names) -> list[str]:
    """Return the transitions in words."""
    lines: list[str] = []
    reached = reachable(found)
    for state in range(states):
        lines.append(f"state {state}" + ("" if state in reached else " (never reached)"))
        for one in (one for one in found if one.source == state):
            lines += _words(one, names)
    if len(lines) > _MOST_LINES:
        lines = [*lines[: _MOST_LINES - 1], f"and {len(lines) - _MOST_LINES + 1} lines more"]
    return lines


def _words(one: Transition, names: Names) -> list[str]:
    if one.rows == one.of:
        when = "always"
    elif one.exact:
        when = f"when {one.condition}"
    else:
        short = one.condition.count(",") < _LONGEST
        when = f"in {one.rows} of {one.of} cases" + (f", such as {one.condition}" if short else "")
    does = ", ".join(
        f"{name} {low:.2g}" if low == high else f"{name} {low:.2g} to {high:.2g}"
        for name, low, high in zip(names.actuators, one.lowest, one.highest, strict=True)
    )
    text = f"→ {one.target}  {when}: {does}"
    return textwrap.wrap(text, _WIDTH, initial_indent="  ", subsequent_indent="       ")
