"""State machines as graphs of ONNX."""

import numpy as np
from onnx import TensorProto

from swarmwright.controllers.kinds.mealy_fsm.tables import machine_tables
from swarmwright.controllers.source import Evolved
from swarmwright.controllers.source.in_onnx import Graph


def add(controller: Evolved, graph: Graph) -> None:
    """Add a controller to a graph."""
    thresholds = [np.array(of_one, np.float32) for of_one in controller.specification["thresholds"]]
    most = max(1, *(len(of_one) for of_one in thresholds))
    # No sensor is above infinity.
    padded = np.array(
        [np.pad(of_one, (0, most - len(of_one)), constant_values=np.inf) for of_one in thresholds]
    )
    counts = [len(of_one) + 1 for of_one in thresholds]
    radix = np.array([int(np.prod(counts[index + 1 :])) for index in range(len(counts))], np.int64)
    graph.largest_tensor_elements = most * len(counts)
    column = graph.add("Unsqueeze", "sensors", graph.whole(2))
    over = graph.add("Less", graph.constant(padded.astype(np.float32), "thresholds"), column)
    # A selection and one sum: OpenVINO 2026.4 miscomputes a product behind a sum over an axis of length 1.
    places = np.broadcast_to(radix[:, np.newaxis], padded.shape)
    digits = graph.add(
        "Where", over, graph.constant(places, "radix"), graph.constant(np.array(0, np.int64), "none")
    )
    symbol = graph.add("ReduceSum", digits, graph.whole(1, 2), keepdims=0)
    of_state = graph.add("Mul", "state", graph.constant(np.array(np.prod(counts), np.int64), "symbols"))
    row = graph.add("Add", of_state, symbol)
    states, outputs = machine_tables(controller)
    graph.add("Gather", graph.constant(states, "next_states"), row, result="next_state")
    graph.add("Gather", graph.constant(outputs, "outputs"), row, result="actuators", axis=0)
    graph.state = (TensorProto.INT64, ["agents"])
    graph.initial_state = "np.zeros(1, np.int64)"
