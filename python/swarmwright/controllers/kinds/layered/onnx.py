"""Layered networks as graphs of ONNX."""

from itertools import pairwise

from swarmwright.controllers.activations import of_nodes
from swarmwright.controllers.source import Evolved
from swarmwright.controllers.source.in_onnx import Graph, actuators, layer


def add(controller: Evolved, graph: Graph) -> None:
    """Add a controller to a graph."""
    specification = controller.specification
    sizes = [int(specification[name]) for name in ("sensors", "actuators")]
    sizes[1:1] = [int(nodes) for nodes in specification["hidden"]]
    functions = of_nodes(specification)
    values, at = "sensors", 0
    for number, (below, nodes) in enumerate(pairwise(sizes), 1):
        count = nodes * (below + 1)
        rows = controller.weights[at : at + count].reshape(nodes, below + 1)
        activation = functions[number == len(sizes) - 1]
        values = layer(activation, graph, rows, values, f"layer_{number}")
        at += count
    actuators(controller, graph, values)
