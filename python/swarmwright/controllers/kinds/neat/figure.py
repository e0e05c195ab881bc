"""The figure of a network of NEAT."""

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from swarmwright.controllers.drawing import Drawing
from swarmwright.controllers.kinds.neat.code import iterate_nodes, prune
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


def draw(drawing: Drawing) -> "Figure":
    """Return the figure of a `neat` network."""
    specification = prune(drawing.specification)
    hidden = len(specification["sources"]) - int(specification["actuators"])
    sizes = column_sizes({**specification, "hidden": hidden})
    layers = list(_node_layers(specification, sizes))
    facts = format_facts(specification, sizes, "tanh, at the actuators sigmoid")
    network = Network(sizes, layers, facts, recurrent=True, matrices=_column_layers(layers, sizes))
    return draw_network(network, drawing)


def _node_layers(specification: Mapping[str, Any], sizes: list[int]) -> Iterator[Layer]:
    """Yield each node; the slopes of actuators are left out."""
    indices = node_indices(sizes)
    weights = np.array(specification["weights"], dtype=np.float32)
    for (column, index), (inputs, numbers, _) in zip(
        indices[sizes[0] :], iterate_nodes(specification, weights), strict=True
    ):
        incoming = numbers[np.newaxis, 1 : 1 + len(inputs)].astype(np.float64)
        yield Layer(
            tuple(indices[source] for source in inputs),
            column,
            index,
            numbers[:1].astype(np.float64),
            incoming,
        )


def _column_layers(layers: list[Layer], sizes: list[int]) -> list[Layer]:
    """Return a layer for each column, with weight 0 where there is no connection."""
    nodes = node_indices(sizes)
    positions = {node: index for index, node in enumerate(nodes)}
    result = []
    for column, size in enumerate(sizes[1:], 1):
        weights = np.zeros((size, len(nodes)))
        column_layers = [layer for layer in layers if layer.column == column]
        for row, layer in zip(weights, column_layers, strict=True):
            np.add.at(row, [positions[source] for source in layer.sources], layer.weights[0])
        bias = np.concatenate([layer.bias for layer in column_layers])
        result.append(Layer(nodes, column, 0, bias, weights))
    return result
