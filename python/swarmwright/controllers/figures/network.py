"""Neural networks as nodes and lines: colour and width are the weight, fill is the bias."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from swarmwright.common.activations import in_words
from swarmwright.controllers.figures.names import Names
from swarmwright.controllers.figures.weights import (
    NEGATIVE,
    POSITIVE,
    Layer,
    colormap,
    columns,
    is_recurrent,
    largest,
    layers,
)
from swarmwright.display.figures.style import INK, PAPER, SOFT, new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_MOST_NODES, _MOST_LINES = 26, 900
"""In a column, and altogether: beyond, matrices are drawn instead of lines."""
_RADIUS = 0.17
_BETWEEN = 3.0  # columns
_APART = 0.56  # nodes


def draw(specification: Mapping[str, Any], names: Names, title: str) -> "Figure":
    """Return the figure of a `layered`, `fully_meshed`, `hebbian` or `neat` network."""
    sizes, found = columns(specification), layers(specification)
    if max(sizes) > _MOST_NODES or sum(layer.weights.size for layer in found) > _MOST_LINES:
        from swarmwright.controllers.figures.matrix import draw as draw_matrix

        return draw_matrix(specification, names, title)
    recurrent = is_recurrent(specification)
    places = [
        [
            (column * _BETWEEN, (size - 1 - 2 * index) / 2 * _node_distance(size, max(sizes)))
            for index in range(size)
        ]
        for column, size in enumerate(sizes)
    ]
    rows = max(max(abs(y) for _, y in column) for column in places) * 2
    width = 3.6 + 2.1 * (len(sizes) - 1)
    figure = new_figure(max(7.0, width), min(max(3.6, rows * 0.72 + 2.0), 14))
    axes = figure.add_subplot()
    unit = largest(np.concatenate([layer.weights.ravel() for layer in found]))
    bias_unit = largest(np.concatenate([layer.bias for layer in found]))
    _lines(axes, found, places, unit)
    _nodes(axes, found, places, bias_unit)
    _labels(axes, places, names)
    # As data and not as limits: the axes are as wide as the figure, their title is below the figure's.
    axes.update_datalim([(-1.6, -rows / 2 - 0.55), ((len(sizes) - 1) * _BETWEEN + 1.5, rows / 2 + 0.55)])
    axes.margins(0)
    axes.autoscale_view()
    axes.set_aspect("equal", adjustable="datalim")
    axes.axis("off")
    figure.suptitle(title, x=0.012, ha="left", fontsize=13, fontweight="bold", color=INK, parse_math=False)
    axes.set_title(_facts(specification, sizes), loc="left", fontsize=10, color=SOFT)
    _legend(figure, unit, bias_unit, recurrent)
    return figure


def _node_distance(size: int, largest_size: int) -> float:
    """Return the distance between the nodes of a column: few of them spread beside a long column."""
    return max(_APART, min(2.0, _APART * largest_size / (size + 0.5)))


def _facts(specification: Mapping[str, Any], sizes: list[int]) -> str:
    facts = f"{specification['kind']} {'-'.join(map(str, sizes))}, {in_words(specification)}"
    iterations = specification.get("iterations")
    return facts + (f", computed {iterations} times in each step" if iterations else "")


def _lines(axes: "Axes", found: list[Layer], places: list[list[tuple[float, float]]], unit: float) -> None:
    from matplotlib.collections import LineCollection
    from matplotlib.patches import FancyArrowPatch

    straight = []
    for layer in found:
        for node, row in enumerate(layer.weights):
            target = places[layer.column][layer.first + node]
            for (column, index), weight in zip(layer.sources, row, strict=True):
                source = places[column][index]
                look = _weight_style(weight / unit)
                if column < layer.column:
                    straight.append((abs(weight), source, target, look))
                    continue
                color, line, alpha = look
                arrow: dict[str, Any] = {
                    "arrowstyle": "-|>", "mutation_scale": 7 + 2 * line, "color": color, "linewidth": line,
                    "alpha": alpha, "zorder": 1.5 + abs(weight) / unit,
                }  # fmt: skip
                if (column, index) == (layer.column, layer.first + node):
                    patch = FancyArrowPatch(path=_loop(source), **arrow)
                else:
                    bend = 0.42 if column == layer.column else 0.3
                    patch = FancyArrowPatch(
                        source, target, connectionstyle=f"arc3,rad={bend}", shrinkA=14, shrinkB=14, **arrow
                    )
                axes.add_patch(patch)
    straight.sort(key=lambda one: one[0])  # strong ones above weak ones
    axes.add_collection(
        LineCollection(
            [(source, target) for _, source, target, _ in straight],
            colors=[look[0] for *_, look in straight],
            linewidths=[look[1] for *_, look in straight],
            alpha=[look[2] for *_, look in straight],
            zorder=1,
        )
    )


def _weight_style(share: float) -> tuple[str, float, float]:
    """Return colour, width and opacity of a weight; share: of the largest one, -1..1."""
    return POSITIVE if share > 0 else NEGATIVE, 0.4 + 3.8 * abs(share), 0.25 + 0.65 * abs(share)


def _loop(place: tuple[float, float]) -> Any:  # noqa: ANN401 - a path of matplotlib
    """Return the way from a node to itself, above it."""
    from matplotlib.path import Path

    x, y = place
    r = _RADIUS * 1.15
    points = [(x - 0.7 * r, y + 0.75 * r), (x - 2.6 * r, y + 3.6 * r), (x + 2.6 * r, y + 3.6 * r)]
    return Path([*points, (x + 0.75 * r, y + 0.85 * r)], [Path.MOVETO, Path.CURVE4, Path.CURVE4, Path.CURVE4])


def _nodes(axes: "Axes", found: list[Layer], places: list[list[tuple[float, float]]], unit: float) -> None:
    from matplotlib.patches import Circle

    colors = colormap()
    for place in places[0]:
        axes.add_patch(Circle(place, _RADIUS * 0.6, facecolor=PAPER, edgecolor=INK, linewidth=1.2, zorder=5))
    for layer in found:
        for node, bias in enumerate(layer.bias):
            place = places[layer.column][layer.first + node]
            share = bias / unit
            axes.add_patch(
                Circle(
                    place, _RADIUS, facecolor=colors(0.5 + share / 2), edgecolor=INK, linewidth=1.2, zorder=5
                )
            )


def _labels(axes: "Axes", places: list[list[tuple[float, float]]], names: Names) -> None:
    text: dict[str, Any] = {"va": "center", "fontsize": 10.5, "color": INK, "parse_math": False}
    for (x, y), name in zip(places[0], names.sensors, strict=True):
        axes.text(x - 0.24, y, name, ha="right", **text)
    # Arrows between outputs may be behind them.
    ground = {"facecolor": PAPER, "edgecolor": "none", "pad": 1.5, "alpha": 0.85}
    for (x, y), name in zip(places[-1], names.actuators, strict=True):
        axes.text(x + 0.32, y, name, ha="left", zorder=6, bbox=ground, **text)


def _legend(figure: "Figure", unit: float, bias_unit: float, recurrent: bool) -> None:
    from matplotlib.lines import Line2D

    handles = []
    for share in (-1.0, -0.5, 0.5, 1.0):
        color, line, alpha = _weight_style(share)
        handles.append(Line2D([], [], color=color, linewidth=line, alpha=alpha, label=f"{share * unit:.2g}"))
    colors = colormap()
    handles += [
        Line2D(
            [], [], linestyle="", marker="o", markersize=11, markerfacecolor=colors(0.5 + share / 2),
            markeredgecolor=INK, label=f"bias {share * bias_unit:.2g}",
        )
        for share in (-1.0, 1.0)
    ]  # fmt: skip
    what = "weights (arrows: back, sideways and to itself)" if recurrent else "weights"
    figure.legend(
        handles=handles, title=what, loc="outside lower center", ncols=len(handles), fontsize=10,
        title_fontsize=10, frameon=False, labelcolor=INK,
    )  # fmt: skip
