"""The figure of a layered network."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from swarmwright.controllers.drawing import Drawing
from swarmwright.controllers.networks.figure import Layer, Network, column_sizes, draw_network, format_facts

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def draw(drawing: Drawing) -> "Figure":
    """Return the figure of a `layered` network."""
    specification = drawing.specification
    sizes = column_sizes(specification)
    return draw_network(Network(sizes, layers(specification), format_facts(specification, sizes)), drawing)


def layers(specification: Mapping[str, Any]) -> list[Layer]:
    """Return the layers of a network."""
    sizes = column_sizes(specification)
    weights = np.array(specification["weights"], dtype=np.float64)
    layers_ = []
    start = 0
    for column, size in enumerate(sizes[1:], 1):
        inputs = tuple((column - 1, index) for index in range(sizes[column - 1]))
        rows = weights[start : start + size * (len(inputs) + 1)].reshape(size, len(inputs) + 1)
        layers_.append(Layer(inputs, column, 0, rows[:, 0], rows[:, 1:]))
        start += rows.size
    return layers_
