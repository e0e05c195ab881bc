"""The figure of a fully meshed network."""

from typing import TYPE_CHECKING

import numpy as np

from swarmwright.controllers.drawing import Drawing
from swarmwright.controllers.networks.figure import Layer, Network, columns, draw_network, everything, facts

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def draw(drawing: Drawing, activation: str = "") -> "Figure":
    """Return the figure of a `fully_meshed` network; activation: in words."""
    specification = drawing.specification
    sizes = columns(specification)
    weights = np.array(specification["weights"], dtype=np.float64)
    nodes = everything(sizes)
    rows = weights.reshape(sum(sizes[1:]), len(nodes) + 1)
    found = []
    start = 0
    for column, size in enumerate(sizes[1:], 1):
        block = rows[start : start + size]
        found.append(Layer(nodes, column, 0, block[:, 0], block[:, 1:]))
        start += size
    network = Network(sizes, found, facts(specification, sizes, activation), recurrent=True)
    return draw_network(network, drawing)
