"""The figure of a fully meshed network."""

from typing import TYPE_CHECKING

import numpy as np

from swarmwright.controllers.drawing import Drawing
from swarmwright.controllers.networks.figure import (
    Layer,
    Network,
    column_sizes,
    draw_network,
    format_facts,
    node_indices,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def draw(drawing: Drawing, activation: str = "") -> "Figure":
    """Return the figure of a `fully_meshed` network; activation: in words."""
    specification = drawing.specification
    sizes = column_sizes(specification)
    weights = np.array(specification["weights"], dtype=np.float64)
    nodes = node_indices(sizes)
    rows = weights.reshape(sum(sizes[1:]), len(nodes) + 1)
    layers = []
    start = 0
    for column, size in enumerate(sizes[1:], 1):
        block = rows[start : start + size]
        layers.append(Layer(nodes, column, 0, block[:, 0], block[:, 1:]))
        start += size
    network = Network(sizes, layers, format_facts(specification, sizes, activation), recurrent=True)
    return draw_network(network, drawing)
