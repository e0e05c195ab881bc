"""The figure of a network of NEAT."""

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from swarmwright.controllers.drawing import Drawing
from swarmwright.controllers.kinds.neat.code import rows
from swarmwright.controllers.networks.figure import Layer, Network, columns, draw_network, everything, facts

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def draw(drawing: Drawing) -> "Figure":
    """Return the figure of a `neat` network."""
    specification = drawing.specification
    hidden = len(specification["sources"]) - int(specification["actuators"])
    sizes = columns({**specification, "hidden": hidden})
    found = list(_connected(specification, sizes))
    about = facts(specification, sizes, "tanh, at the actuators sigmoid")
    network = Network(sizes, found, about, recurrent=True, matrices=_matrices(found, sizes))
    return draw_network(network, drawing)


def _connected(specification: Mapping[str, Any], sizes: list[int]) -> Iterator[Layer]:
    """Yield each node; the slopes of actuators are left out."""
    places = everything(sizes)
    weights = np.array(specification["weights"], dtype=np.float32)
    for (column, index), (seen, numbers, _) in zip(
        places[sizes[0] :], rows(specification, weights), strict=True
    ):
        incoming = numbers[np.newaxis, 1 : 1 + len(seen)].astype(np.float64)
        yield Layer(
            tuple(places[source] for source in seen), column, index, numbers[:1].astype(np.float64), incoming
        )


def _matrices(found: list[Layer], sizes: list[int]) -> list[Layer]:
    """Return a layer for each column: its matrix has 0 without a connection."""
    nodes = everything(sizes)
    places = {place: index for index, place in enumerate(nodes)}
    result = []
    for column, size in enumerate(sizes[1:], 1):
        weights = np.zeros((size, len(nodes)))
        of_column = [layer for layer in found if layer.column == column]
        for row, layer in zip(weights, of_column, strict=True):
            np.add.at(row, [places[source] for source in layer.sources], layer.weights[0])
        bias = np.concatenate([layer.bias for layer in of_column])
        result.append(Layer(nodes, column, 0, bias, weights))
    return result
