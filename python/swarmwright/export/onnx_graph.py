"""Controllers as graphs of ONNX, in the operations of decision 002."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray
from onnx import ModelProto, NodeProto, TensorProto, checker, helper, numpy_helper

from swarmwright.common.activations import of_nodes
from swarmwright.controllers.kinds.evostick.network import STEEP, STEEPNESS, as_layered
from swarmwright.export._base import not_exported
from swarmwright.export.machine_tables import machine_tables
from swarmwright.export.subject import Subject

_OPSET = 17
_IR_VERSION = 8  # which belongs to that opset

_TANH_P = (4.2581547e-8, 7.970824e-5, 0.015736774, 0.5)
_TANH_Q = (2.7218455e-6, 0.0013933508, 0.11480684, 1.0)


@dataclass
class Graph:
    """A graph that is being made: each operation adds a node and returns the name of its result."""

    nodes: list[NodeProto] = field(default_factory=list)
    constants: dict[str, NDArray[Any]] = field(default_factory=dict)
    state: tuple[int, list[str | int]] | None = None
    """Type and shape of the state; None for what remembers nothing."""
    initial_state: str = ""
    """For one agent, as an expression of NumPy."""
    largest_tensor_elements: int = 1
    """Of intermediate results, for one agent."""

    def add(self, operator: str, *inputs: str, result: str = "", **attributes: Any) -> str:  # noqa: ANN401 - as ONNX
        """Add a node; return the name of its result."""
        name = result or f"{operator.lower()}_{len(self.nodes)}"
        self.nodes.append(helper.make_node(operator, list(inputs), [name], name=f"{name}_node", **attributes))
        return name

    def constant(self, value: NDArray[Any], name: str = "") -> str:
        """Add a tensor; return its name."""
        name = name or f"constant_{len(self.constants)}"
        self.constants[name] = value
        return name

    def number(self, value: float) -> str:
        """Return the name of a binary32 number."""
        return self.constant(np.array(value, np.float32), f"number_{np.float32(value)}")

    def whole(self, *values: int) -> str:
        """Return the name of whole numbers."""
        return self.constant(np.array(values, np.int64), f"whole_{'_'.join(map(str, values))}")

    def limited(self, value: str, low: str | None, high: str | None) -> str:
        """Return a value within limits; a NaN stays one."""
        if high is not None:
            value = self.add("Where", self.add("Greater", value, high), high, value)
        if low is not None:
            value = self.add("Where", self.add("Less", value, low), low, value)
        return value


def graph_of(subject: Subject) -> Graph:
    """Return the graph of a controller that steers agents. Raises InputError for an unknown kind."""
    make = _KINDS.get(subject.kind)
    if make is None:
        raise not_exported(subject, "ONNX", _KINDS)
    graph = Graph()
    make(subject, graph)
    return graph


def model(subject: Subject, graph: Graph, name: str, words: str) -> bytes:
    """Return a model as bytes, the same ones for the same graph. `words`: where it comes from."""
    sensors, actuators = len(subject.sensors), len(subject.actuators)
    inputs = [helper.make_tensor_value_info("sensors", TensorProto.FLOAT, ["agents", sensors])]
    outputs = [helper.make_tensor_value_info("actuators", TensorProto.FLOAT, ["agents", actuators])]
    if graph.state is not None:
        kind, shape = graph.state
        inputs.append(helper.make_tensor_value_info("state", kind, shape))
        outputs.append(helper.make_tensor_value_info("next_state", kind, shape))
    tensors = [numpy_helper.from_array(value, key) for key, value in graph.constants.items()]
    made = helper.make_graph(graph.nodes, name, inputs, outputs, tensors)
    opset = [helper.make_opsetid("", _OPSET)]
    whole: ModelProto = helper.make_model(
        made, opset_imports=opset, ir_version=_IR_VERSION, producer_name="Swarmwright", doc_string=words
    )
    properties = {
        **dict(subject.facts),
        "sensors": ", ".join(_channel(one) for one in subject.sensors),
        "actuators": ", ".join(_channel(one) for one in subject.actuators),
        **({"conversion": " ".join(subject.conversion)} if subject.conversion else {}),
        **({"step_seconds": repr(subject.step_size)} if subject.step_size else {}),
        "largest_tensor_elements": str(graph.largest_tensor_elements),
    }
    helper.set_model_props(whole, properties)
    checker.check_model(whole, full_check=True)
    data: bytes = whole.SerializeToString(deterministic=True)
    return data


def _channel(channel: Any) -> str:  # noqa: ANN401 - a Channel
    unit = f" in {channel.unit}" if channel.unit else ""
    return f"{channel.name}{unit} ({channel.limits})"


def _layered(subject: Subject, graph: Graph) -> None:
    specification = subject.specification
    sizes = [int(specification[name]) for name in ("sensors", "actuators")]
    sizes[1:1] = [int(nodes) for nodes in specification["hidden"]]
    functions = of_nodes(specification)
    values, at = "sensors", 0
    for layer, (below, nodes) in enumerate(pairwise(sizes), 1):
        count = nodes * (below + 1)
        rows = subject.weights[at : at + count].reshape(nodes, below + 1)
        activation = functions[layer == len(sizes) - 1]
        values = _layer(activation, graph, rows, values, f"layer_{layer}")
        at += count
    _actuators(subject, graph, values)


def _evostick(subject: Subject, graph: Graph) -> None:
    _layered(replace(subject, specification=as_layered(subject.specification)), graph)


def _fully_meshed(subject: Subject, graph: Graph) -> None:
    specification = subject.specification
    sensors, hidden = int(specification["sensors"]), int(specification["hidden"])
    computed = hidden + int(specification["actuators"])
    rows = subject.weights.reshape(computed, 1 + sensors + computed)
    outputs, iterations = "state", int(specification["iterations"])
    for _ in range(iterations):
        values = graph.add("Concat", "sensors", outputs, axis=1)
        outputs = _layer(specification["activation"], graph, rows, values, "nodes")
    graph.add("Identity", outputs, result="next_state")
    columns = [graph.whole(number) for number in (hidden, computed, 1)]
    _actuators(subject, graph, graph.add("Slice", outputs, *columns))
    graph.state = (TensorProto.FLOAT, ["agents", computed])
    graph.initial_state = f"np.zeros((1, {computed}), np.float32)"


def _layer(activation: str, graph: Graph, rows: NDArray[np.float32], below: str, name: str) -> str:
    """Add a layer: sums one term after the other, from 0, then the bias, then the activation."""
    nodes, width = rows.shape[0], rows.shape[1] - 1
    graph.largest_tensor_elements = max(graph.largest_tensor_elements, nodes * rows.shape[1])
    weights = graph.constant(np.ascontiguousarray(rows[:, 1:]), f"weights_{name}")
    biases = graph.constant(np.ascontiguousarray(rows[:, 0]), f"biases_{name}")
    products = graph.add("Mul", weights, graph.add("Unsqueeze", below, graph.whole(1)))
    # CumSum adds in order, which MatMul does not; the first sum is that of 0 and the first product.
    terms = graph.add("Pad", products, graph.whole(0, 0, 1, 0, 0, 0))
    sums = graph.add("CumSum", terms, graph.constant(np.array(2, np.int64), "axis"))
    total = graph.add("Gather", sums, graph.constant(np.array(width, np.int64), f"last_{width}"), axis=2)
    return _ACTIVATIONS[activation](graph, graph.add("Add", biases, total))


def _tanh(graph: Graph, x: str) -> str:
    y = graph.limited(x, graph.number(-9.15), graph.number(9.15))
    z = graph.add("Mul", y, y)
    p, q = _polynomial(graph, z, _TANH_P), _polynomial(graph, z, _TANH_Q)
    t = graph.add("Div", graph.add("Mul", y, p), q)
    below = graph.add("Add", graph.number(1), graph.add("Mul", t, t))
    h = graph.add("Div", graph.add("Add", t, t), below)
    return graph.limited(h, graph.number(-1), graph.number(1))


def _polynomial(graph: Graph, z: str, coefficients: tuple[float, ...]) -> str:
    value = graph.number(coefficients[0])
    for coefficient in coefficients[1:]:
        value = graph.add("Add", graph.add("Mul", value, z), graph.number(coefficient))
    return value


def _sigmoid(graph: Graph, x: str) -> str:
    half = graph.number(0.5)
    inner = _tanh(graph, graph.add("Mul", half, x))
    return graph.add("Add", half, graph.add("Mul", half, inner))


def _clamp(graph: Graph, x: str) -> str:
    low, high = graph.number(0), graph.number(1)
    below = graph.add("Where", graph.add("Less", x, low), low, x)
    return graph.add("Where", graph.add("Greater", below, high), high, below)


_ACTIVATIONS: dict[str, Callable[[Graph, str], str]] = {
    "tanh": _tanh,
    "sigmoid": _sigmoid,
    STEEP: lambda graph, x: _sigmoid(graph, graph.add("Mul", graph.number(STEEPNESS), x)),
    "relu": lambda graph, x: graph.limited(x, graph.number(0), None),
    "clamp": _clamp,
    "linear": lambda _, x: x,
}


def _actuators(subject: Subject, graph: Graph, outputs: str) -> None:
    low, high = np.array(subject.specification["output_range"], np.float32)
    a = outputs
    if (low, high) == (0, 1):
        a = graph.add("Sub", graph.add("Mul", graph.number(2), a), graph.number(1))
    elif (low, high) != (-1, 1):
        above = graph.add("Sub", a, graph.number(float(low)))
        share = graph.add("Div", above, graph.number(float(high - low)))
        a = graph.add("Sub", graph.add("Mul", share, graph.number(2)), graph.number(1))
    a = graph.add("Where", graph.add("IsNaN", a), graph.number(0), a)
    graph.add("Identity", graph.limited(a, graph.number(-1), graph.number(1)), result="actuators")


def _mealy_fsm(subject: Subject, graph: Graph) -> None:
    thresholds = [np.array(of_one, np.float32) for of_one in subject.specification["thresholds"]]
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
    states, outputs = machine_tables(subject)
    graph.add("Gather", graph.constant(states, "next_states"), row, result="next_state")
    graph.add("Gather", graph.constant(outputs, "outputs"), row, result="actuators", axis=0)
    graph.state = (TensorProto.INT64, ["agents"])
    graph.initial_state = "np.zeros(1, np.int64)"


_KINDS: dict[str, Callable[[Subject, Graph], None]] = {
    "evostick": _evostick,
    "fully_meshed": _fully_meshed,
    "layered": _layered,
    "mealy_fsm": _mealy_fsm,
}
