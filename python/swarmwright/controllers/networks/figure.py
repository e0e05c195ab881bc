"""Neural networks as nodes and lines: colour and width are the weight, fill is the bias.

Networks of many nodes are drawn as matrices: a row for each node, its bias and weights as colours.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from swarmwright.controllers.activations import describe_activations
from swarmwright.controllers.drawing import Drawing, Names
from swarmwright.display.figures.style import INK, PAPER, SOFT, draw_whole_title, new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.colors import LinearSegmentedColormap
    from matplotlib.figure import Figure

NEGATIVE, NOTHING, POSITIVE = "#D55E00", "#F2F2EE", "#0072B2"
"""From Okabe and Ito's palette, which is safe for colour-blind readers."""
_MOST_NODES, _MOST_LINES = 26, 900
"""Largest number of nodes in a column, and of lines in all; beyond, matrices are drawn instead."""
_RADIUS = 0.17
_BETWEEN = 3.0  # columns
_APART = 0.56  # nodes
_NAMED = 40
"""Largest number of nodes that are named individually on the axis."""


@dataclass(frozen=True)
class Layer:
    """Nodes that are computed together, and their inputs."""

    sources: tuple[tuple[int, int], ...]
    """(column, index) of each input; column 0 holds the sensors."""
    column: int
    """Column in which they are drawn; the last holds the actuators."""
    first: int
    """Index of the first node in the column."""
    bias: NDArray[np.float64]
    """(nodes,)"""
    weights: NDArray[np.float64]
    """(nodes, sources)"""


def column_sizes(specification: Mapping[str, Any]) -> list[int]:
    """Return the number of nodes of each column: sensors, hidden nodes, actuators."""
    hidden = specification["hidden"]
    between = list(hidden) if isinstance(hidden, list) else [hidden] if hidden else []
    return [specification["sensors"], *between, specification["actuators"]]


@dataclass(frozen=True)
class Network:
    """A network to be drawn."""

    columns: list[int]
    """Number of nodes of each column: sensors, hidden nodes, actuators."""
    layers: list[Layer]
    facts: str
    """Its kind, sizes and activations, below the title."""
    recurrent: bool = False
    """Whether nodes may be connected with any node."""
    matrices: list[Layer] | None = None
    """A layer for each column, if `layers` is organized differently."""


def format_facts(specification: Mapping[str, Any], sizes: list[int], activation: str = "") -> str:
    """Return the line below the title; activation: in words, by default those of the specification."""
    kind = f"{specification['kind']} {'-'.join(map(str, sizes))}"
    return f"{kind}, {activation or describe_activations(specification)}"


def node_indices(sizes: list[int]) -> tuple[tuple[int, int], ...]:
    """Return the (column, index) of every node."""
    return tuple((column, index) for column, size in enumerate(sizes) for index in range(size))


def draw_network(network: Network, drawing: Drawing) -> "Figure":
    """Return the figure of a network."""
    sizes, layers = network.columns, network.layers
    if max(sizes) > _MOST_NODES or sum(layer.weights.size for layer in layers) > _MOST_LINES:
        return _draw_matrices(network, drawing.names, drawing.title)
    title, iterations = drawing.title, drawing.specification.get("iterations")
    positions = [
        [
            (column * _BETWEEN, (size - 1 - 2 * index) / 2 * _node_distance(size, max(sizes)))
            for index in range(size)
        ]
        for column, size in enumerate(sizes)
    ]
    rows = max(max(abs(y) for _, y in column) for column in positions) * 2
    width = 3.6 + 2.1 * (len(sizes) - 1)
    figure = new_figure(max(7.0, width), min(max(3.6, rows * 0.72 + 2.0), 14))
    axes = figure.add_subplot()
    unit = _largest(np.concatenate([layer.weights.ravel() for layer in layers]))
    bias_unit = _largest(np.concatenate([layer.bias for layer in layers]))
    _draw_lines(axes, layers, positions, unit)
    _draw_nodes(axes, layers, positions, bias_unit)
    _draw_labels(axes, positions, drawing.names)
    # As data and not as limits: the axes are as wide as the figure, their title is below the figure's.
    axes.update_datalim([(-1.6, -rows / 2 - 0.55), ((len(sizes) - 1) * _BETWEEN + 1.5, rows / 2 + 0.55)])
    axes.margins(0)
    axes.autoscale_view()
    axes.set_aspect("equal", adjustable="datalim")
    axes.axis("off")
    draw_whole_title(figure, title)
    computed = f", computed {iterations} times in each step" if iterations else ""
    axes.set_title(f"{network.facts}{computed}", loc="left", fontsize=10, color=SOFT)
    _draw_legend(figure, unit, bias_unit, network.recurrent)
    return figure


def _node_distance(size: int, largest_size: int) -> float:
    """Return the distance between the nodes of a column; a few nodes are spread beside a long column."""
    return max(_APART, min(2.0, _APART * largest_size / (size + 0.5)))


def _draw_lines(
    axes: "Axes", layers: list[Layer], positions: list[list[tuple[float, float]]], unit: float
) -> None:
    from matplotlib.collections import LineCollection
    from matplotlib.patches import FancyArrowPatch

    straight = []
    for layer in layers:
        for node, row in enumerate(layer.weights):
            target = positions[layer.column][layer.first + node]
            for (column, index), weight in zip(layer.sources, row, strict=True):
                source = positions[column][index]
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
    if not straight:  # nodes without inputs
        return
    straight.sort(key=lambda line: line[0])  # strong weights above weak ones
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
    """Return colour, width and opacity of a weight; share: share of the largest one, -1..1."""
    return POSITIVE if share > 0 else NEGATIVE, 0.4 + 3.8 * abs(share), 0.25 + 0.65 * abs(share)


def _loop(position: tuple[float, float]) -> Any:  # noqa: ANN401 - a path of matplotlib
    """Return the path of an arrow from a node to itself, above it."""
    from matplotlib.path import Path

    x, y = position
    r = _RADIUS * 1.15
    points = [(x - 0.7 * r, y + 0.75 * r), (x - 2.6 * r, y + 3.6 * r), (x + 2.6 * r, y + 3.6 * r)]
    return Path([*points, (x + 0.75 * r, y + 0.85 * r)], [Path.MOVETO, Path.CURVE4, Path.CURVE4, Path.CURVE4])


def _draw_nodes(
    axes: "Axes", layers: list[Layer], positions: list[list[tuple[float, float]]], unit: float
) -> None:
    from matplotlib.patches import Circle

    colors = _colormap()
    for position in positions[0]:
        axes.add_patch(
            Circle(position, _RADIUS * 0.6, facecolor=PAPER, edgecolor=INK, linewidth=1.2, zorder=5)
        )
    for layer in layers:
        for node, bias in enumerate(layer.bias):
            position = positions[layer.column][layer.first + node]
            share = bias / unit
            axes.add_patch(
                Circle(
                    position,
                    _RADIUS,
                    facecolor=colors(0.5 + share / 2),
                    edgecolor=INK,
                    linewidth=1.2,
                    zorder=5,
                )
            )


def _draw_labels(axes: "Axes", positions: list[list[tuple[float, float]]], names: Names) -> None:
    text: dict[str, Any] = {"va": "center", "fontsize": 10.5, "color": INK, "parse_math": False}
    for (x, y), name in zip(positions[0], names.sensors, strict=True):
        axes.text(x - 0.24, y, name, ha="right", **text)
    # Arrows between outputs may be behind them.
    ground = {"facecolor": PAPER, "edgecolor": "none", "pad": 1.5, "alpha": 0.85}
    for (x, y), name in zip(positions[-1], names.actuators, strict=True):
        axes.text(x + 0.32, y, name, ha="left", zorder=6, bbox=ground, **text)


def _draw_legend(figure: "Figure", unit: float, bias_unit: float, recurrent: bool) -> None:
    from matplotlib.lines import Line2D

    handles = []
    for share in (-1.0, -0.5, 0.5, 1.0):
        color, line, alpha = _weight_style(share)
        handles.append(Line2D([], [], color=color, linewidth=line, alpha=alpha, label=f"{share * unit:.2g}"))
    colors = _colormap()
    handles += [
        Line2D(
            [], [], linestyle="", marker="o", markersize=11, markerfacecolor=colors(0.5 + share / 2),
            markeredgecolor=INK, label=f"bias {share * bias_unit:.2g}",
        )
        for share in (-1.0, 1.0)
    ]  # fmt: skip
    title = "weights (arrows: back, sideways and to itself)" if recurrent else "weights"
    figure.legend(
        handles=handles, title=title, loc="outside lower center", ncols=len(handles), fontsize=10,
        title_fontsize=10, frameon=False, labelcolor=INK,
    )  # fmt: skip


def _draw_matrices(network: Network, names: Names, title: str) -> "Figure":
    sizes, layers = network.columns, network.matrices or network.layers
    unit = _largest(np.concatenate([np.column_stack([node.bias, node.weights]).ravel() for node in layers]))
    figure = new_figure(10, 2.2 + sum(_matrix_height(node) for node in layers))
    grid = figure.subplots(
        len(layers), 1, height_ratios=[_matrix_height(node) for node in layers], squeeze=False
    )
    image = None
    for axes, layer in zip(grid[:, 0], layers, strict=True):
        image = axes.imshow(
            np.column_stack([layer.bias, layer.weights]), cmap=_colormap(), vmin=-unit, vmax=unit,
            aspect="auto", interpolation="nearest",
        )  # fmt: skip
        _name_axes(axes, layer, sizes, names)
    assert image is not None
    bar = figure.colorbar(image, ax=list(grid[:, 0]), shrink=0.8, pad=0.02)
    bar.ax.tick_params(labelsize=9, colors=INK)
    bar.set_label("weight", fontsize=10, color=INK)
    draw_whole_title(figure, title)
    grid[0, 0].set_title(network.facts, loc="left", fontsize=10, color=SOFT)
    return figure


def _matrix_height(layer: Layer) -> float:
    return min(max(1.0, 0.24 * len(layer.bias)), 4.5)


def _name_axes(axes: "Axes", layer: Layer, sizes: list[int], names: Names) -> None:
    last = len(sizes) - 1
    sources = ["bias", *(_label(column, index, last, names) for column, index in layer.sources)]
    nodes = [_label(layer.column, index, last, names) for index in range(len(layer.bias))]
    for labels, axis in ((sources, axes.xaxis), (nodes, axes.yaxis)):
        if len(labels) <= _NAMED:
            axis.set_ticks(range(len(labels)), labels)
    axes.tick_params(labelsize=8, colors=INK, length=2)
    axes.tick_params(axis="x", rotation=90 if len(sources) <= _NAMED else 0)
    axes.set_ylabel("actuators" if layer.column == last else f"layer {layer.column}", fontsize=10, color=INK)
    if len(sources) > _NAMED:
        axes.set_xlabel("bias, then inputs of the nodes", fontsize=10, color=INK)


def _label(column: int, index: int, last: int, names: Names) -> str:
    if column == 0:
        return names.sensors[index]
    return (
        names.actuators[index]
        if column == last
        else f"hidden {column}.{index}"
        if last > 2
        else f"hidden {index}"
    )


def _colormap() -> "LinearSegmentedColormap":
    """Return the colour map from negative through zero to positive."""
    from matplotlib.colors import LinearSegmentedColormap

    return LinearSegmentedColormap.from_list("weights", [NEGATIVE, NOTHING, POSITIVE])


def _largest(values: NDArray[np.float64]) -> float:
    """Return the largest absolute value, 1 when all are 0."""
    return float(np.abs(values).max(initial=0.0)) or 1.0
