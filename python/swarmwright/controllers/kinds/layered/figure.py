"""The figure of a layered network."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from swarmwright.controllers.drawing import Drawing
from swarmwright.controllers.networks.figure import Layer, Network, columns, draw_network, facts

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def draw(drawing: Drawing) -> "Figure":
    """Return the figure of a `layered` network."""
    specification = drawing.specification
    sizes = columns(specification)
    return draw_network(Network(sizes, layers(specification), facts(specification, sizes)), drawing)


def layers(specification: Mapping[str, Any]) -> list[Layer]:
    """Return the layers of a network."""
    sizes = columns(specification)
    weights = np.array(specification["weights"], dtype=np.float64)
    found = []
    start = 0
    for column, size in enumerate(sizes[1:], 1):
        seen = tuple((column - 1, index) for index in range(sizes[column - 1]))
        rows = weights[start : start + size * (len(seen) + 1)].reshape(size, len(seen) + 1)
        found.append(Layer(seen, column, 0, rows[:, 0], rows[:, 1:]))
        start += rows.size
    return found
