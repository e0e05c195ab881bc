"""The figure of a growing network."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from swarmwright.controllers.drawing import Drawing
from swarmwright.controllers.kinds.growing.genes import Genes, read, words
from swarmwright.controllers.networks.figure import Layer, Network, draw_network, node_indices

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def draw(drawing: Drawing) -> "Figure":
    """Return the figure of a `growing` network: hidden nodes in columns by their depth."""
    genes = read(drawing.specification)
    depths = _depths(genes)
    columns = [
        genes.sensors,
        *(depths.count(depth) for depth in range(1, max(depths, default=0) + 1)),
        genes.actuators,
    ]
    layers = list(_layers(genes, depths, len(columns) - 1))
    facts = f"{genes.hidden} hidden nodes, {len(genes.weights)} connections, {words(genes)}"
    network = Network(columns, layers, facts, recurrent=genes.recurrent, matrices=_matrices(layers, columns))
    return draw_network(network, drawing)


def _depths(genes: Genes) -> list[int]:
    """Return the column of each hidden node, from 1: after those of the nodes before it that it hears."""
    depths: list[int] = []
    first = genes.sensors + 1
    for rank, node in enumerate(genes.nodes[: genes.hidden]):
        before = [depths[source - first] for source in node.sources if first <= source < first + rank]
        depths.append(1 + max(before, default=0))
    return depths


def _layers(genes: Genes, depths: list[int], last: int) -> Iterator[Layer]:
    """Yield each node that is not an input; connections from the bias are its bias."""
    places = [(0, sensor) for sensor in range(genes.sensors)]
    indices = [depths[:rank].count(depth) for rank, depth in enumerate(depths)]
    own = [*zip(depths, indices, strict=True), *((last, actuator) for actuator in range(genes.actuators))]
    places += [(0, 0), *own]
    for (column, index), node in zip(own, genes.nodes, strict=True):
        is_bias = np.array(node.sources, dtype=np.int64) == genes.sensors
        weights = node.weights.astype(np.float64)
        yield Layer(
            tuple(places[source] for source in node.sources if source != genes.sensors),
            column,
            index,
            np.array([weights[is_bias].sum()]),
            weights[~is_bias][np.newaxis],
        )


def _matrices(layers: list[Layer], columns: list[int]) -> list[Layer]:
    """Return a layer for each column, with weight 0 where there is no connection."""
    nodes = node_indices(columns)
    positions = {node: index for index, node in enumerate(nodes)}
    result = []
    for column, size in enumerate(columns[1:], 1):
        weights, bias = np.zeros((size, len(nodes))), np.zeros(size)
        for layer in layers:
            if layer.column == column:
                np.add.at(
                    weights[layer.first], [positions[source] for source in layer.sources], layer.weights[0]
                )
                bias[layer.first] = layer.bias[0]
        result.append(Layer(nodes, column, 0, bias, weights))
    return result
