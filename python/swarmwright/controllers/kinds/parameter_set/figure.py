"""The figure of a parameter set: each value within its range."""

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from swarmwright.controllers.drawing import Drawing
from swarmwright.display.figures.style import (
    COLORS,
    EDGE,
    GRID,
    INK,
    PAPER,
    SOFT,
    draw_whole_title,
    new_figure,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def draw(drawing: Drawing) -> "Figure":
    """Return the figure of a `parameter_set`, whose options have the ranges (`range`, `scale`)."""
    specification, title = drawing.specification, drawing.title
    ranges = drawing.options.get("parameters") or {}
    parameters = specification["parameters"]
    figure = new_figure(8, 1.5 + 0.52 * len(parameters))
    axes = figure.add_subplot()
    for row, (parameter, weight) in enumerate(zip(parameters, specification["weights"], strict=True)):
        options = ranges.get(parameter["name"], {})
        if parameter["type"] == "categorical":
            _draw_choices(axes, -row, parameter["choices"], math.floor(weight))
        else:
            value = math.floor(weight) if parameter["type"] == "integer" else weight
            _draw_value(axes, -row, float(value), options)
        axes.text(
            -0.03, -row, parameter["name"], ha="right", va="center", fontsize=11, color=INK, parse_math=False
        )
    axes.set_xlim(-0.02, 1.16)
    axes.set_ylim(-len(parameters) + 0.4, 0.6)
    axes.axis("off")
    draw_whole_title(figure, title)
    return figure


def _draw_value(axes: "Axes", y: float, value: float, options: Mapping[str, Any]) -> None:
    text: dict[str, Any] = {"va": "center", "color": INK, "fontsize": 11}
    axes.text(
        1.03, y, f"{value:.6g}", fontweight="bold", ha="left", **{k: v for k, v in text.items() if k != "ha"}
    )
    limits = options.get("range")
    if not limits:
        return
    low, high = map(float, limits)
    log = options.get("scale") == "log"
    axes.plot([0, 1], [y, y], color=GRID, linewidth=7, solid_capstyle="round", zorder=1)
    axes.plot(
        _share(value, low, high, log=log), y, "o", markersize=11, color=COLORS[0], markeredgecolor=PAPER
    )
    small: dict[str, Any] = {"fontsize": 8.5, "color": SOFT, "va": "top"}
    axes.text(0, y - 0.17, f"{low:.6g}", ha="left", **small)
    axes.text(1, y - 0.17, f"{high:.6g}", ha="right", **small)
    if log:
        axes.text(0.5, y - 0.17, "logarithmic", ha="center", **small)


def _share(value: float, low: float, high: float, *, log: bool) -> float:
    """Return the relative position of a value in its range, 0..1."""
    if log:
        value, low, high = math.log(max(value, low)), math.log(low), math.log(high)
    return min(max((value - low) / (high - low), 0.0), 1.0) if high > low else 0.5


def _draw_choices(axes: "Axes", y: float, choices: list[str], chosen: int) -> None:
    chosen = min(max(chosen, 0), len(choices) - 1)
    shown = range(len(choices)) if len(choices) <= 5 else [chosen]
    for slot, index in enumerate(shown):
        is_chosen = index == chosen
        name = choices[index] if len(choices[index]) <= 18 else f"{choices[index][:17]}…"
        axes.text(
            (slot + 0.5) / len(shown), y, name, ha="center", va="center", fontsize=10.5, parse_math=False,
            color=PAPER if is_chosen else SOFT, fontweight="bold" if is_chosen else "normal",
            bbox={
                "boxstyle": "round,pad=0.35", "facecolor": COLORS[0] if is_chosen else PAPER,
                "edgecolor": COLORS[0] if is_chosen else EDGE,
            },
        )  # fmt: skip
    if len(choices) > 5:
        axes.text(1.03, y, f"one of {len(choices)}", ha="left", va="center", fontsize=9, color=SOFT)
