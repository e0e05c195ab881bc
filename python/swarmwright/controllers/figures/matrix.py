"""Networks of many nodes as matrices: a row for each node, its bias and weights as colours."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from swarmwright.common.activations import in_words
from swarmwright.controllers.figures.names import Names
from swarmwright.controllers.figures.weights import Layer, colormap, columns, largest, matrices
from swarmwright.display.figures.style import INK, SOFT, new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_NAMED = 40
"""Nodes up to which each has its name on the axis."""


def draw(specification: Mapping[str, Any], names: Names, title: str) -> "Figure":
    """Return the figure of a `layered`, `fully_meshed`, `hebbian` or `neat` network, as matrices."""
    sizes, found = columns(specification), matrices(specification)
    unit = largest(np.concatenate([np.column_stack([one.bias, one.weights]).ravel() for one in found]))
    figure = new_figure(10, 2.2 + sum(_height(one) for one in found))
    grid = figure.subplots(len(found), 1, height_ratios=[_height(one) for one in found], squeeze=False)
    image = None
    for axes, layer in zip(grid[:, 0], found, strict=True):
        image = axes.imshow(
            np.column_stack([layer.bias, layer.weights]), cmap=colormap(), vmin=-unit, vmax=unit,
            aspect="auto", interpolation="nearest",
        )  # fmt: skip
        _name(axes, layer, sizes, names)
    assert image is not None
    bar = figure.colorbar(image, ax=list(grid[:, 0]), shrink=0.8, pad=0.02)
    bar.ax.tick_params(labelsize=9, colors=INK)
    bar.set_label("weight", fontsize=10, color=INK)
    figure.suptitle(title, x=0.012, ha="left", fontsize=13, fontweight="bold", color=INK, parse_math=False)
    facts = f"{specification['kind']} {'-'.join(map(str, sizes))}, {in_words(specification)}"
    grid[0, 0].set_title(facts, loc="left", fontsize=10, color=SOFT)
    return figure


def _height(layer: Layer) -> float:
    return min(max(1.0, 0.24 * len(layer.bias)), 4.5)


def _name(axes: "Axes", layer: Layer, sizes: list[int], names: Names) -> None:
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
        axes.set_xlabel("bias, then what the nodes see", fontsize=10, color=INK)


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
