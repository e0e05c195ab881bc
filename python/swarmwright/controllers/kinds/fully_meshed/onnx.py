"""Fully meshed networks as graphs of ONNX."""

from onnx import TensorProto

from swarmwright.controllers.source import Evolved
from swarmwright.controllers.source.in_onnx import Graph, actuators, layer


def add(controller: Evolved, graph: Graph) -> None:
    """Add a controller to a graph."""
    specification = controller.specification
    sensors, hidden = int(specification["sensors"]), int(specification["hidden"])
    computed = hidden + int(specification["actuators"])
    rows = controller.weights.reshape(computed, 1 + sensors + computed)
    outputs, iterations = "state", int(specification["iterations"])
    for _ in range(iterations):
        values = graph.add("Concat", "sensors", outputs, axis=1)
        outputs = layer(specification["activation"], graph, rows, values, "nodes")
    graph.add("Identity", outputs, result="next_state")
    columns = [graph.whole(number) for number in (hidden, computed, 1)]
    actuators(controller, graph, graph.add("Slice", outputs, *columns))
    graph.state = (TensorProto.FLOAT, ["agents", computed])
    graph.initial_state = f"np.zeros((1, {computed}), np.float32)"
