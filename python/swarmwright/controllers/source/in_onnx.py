"""Controllers as graphs of ONNX, in the operations of decision 002."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from swarmwright.controllers.activations import STEEP, STEEPNESS
from swarmwright.controllers.source import Evolved

_TANH_P = (4.2581547e-8, 7.970824e-5, 0.015736774, 0.5)
_TANH_Q = (2.7218455e-6, 0.0013933508, 0.11480684, 1.0)


class Node(NamedTuple):
    """An operation."""

    operator: str
    inputs: tuple[str, ...]
    result: str
    attributes: dict[str, Any]


@dataclass
class Graph:
    """A graph under construction: each operation adds a node and returns the name of its result."""

    nodes: list[Node] = field(default_factory=list)
    constants: dict[str, NDArray[Any]] = field(default_factory=dict)
    state: tuple[type[np.generic], list[str | int]] | None = None
    """Type and shape of the state; None for stateless controllers."""
    initial_state: str = ""
    """Initial state of one agent, as a NumPy expression."""
    largest_tensor_elements: int = 1
    """Largest intermediate result for one agent, in elements."""

    def add(self, operator: str, *inputs: str, result: str = "", **attributes: Any) -> str:  # noqa: ANN401 - as ONNX
        """Add a node; return the name of its result."""
        name = result or f"{operator.lower()}_{len(self.nodes)}"
        self.nodes.append(Node(operator, inputs, name, attributes))
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

    def limit(self, value: str, low: str | None, high: str | None) -> str:
        """Clip a value to limits; NaN stays NaN."""
        if high is not None:
            value = self.add("Where", self.add("Greater", value, high), high, value)
        if low is not None:
            value = self.add("Where", self.add("Less", value, low), low, value)
        return value


def layer(activation: str, graph: Graph, rows: NDArray[np.float32], below: str, name: str) -> str:
    """Add a layer: sums in the order of the terms, starting at 0, then the bias, then the activation."""
    nodes, width = rows.shape[0], rows.shape[1] - 1
    graph.largest_tensor_elements = max(graph.largest_tensor_elements, nodes * rows.shape[1])
    weights = graph.constant(np.ascontiguousarray(rows[:, 1:]), f"weights_{name}")
    biases = graph.constant(np.ascontiguousarray(rows[:, 0]), f"biases_{name}")
    products = graph.add("Mul", weights, graph.add("Unsqueeze", below, graph.whole(1)))
    # CumSum adds in order, which MatMul does not; the first sum is 0 plus the first product.
    terms = graph.add("Pad", products, graph.whole(0, 0, 1, 0, 0, 0))
    sums = graph.add("CumSum", terms, graph.constant(np.array(2, np.int64), "axis"))
    total = graph.add("Gather", sums, graph.constant(np.array(width, np.int64), f"last_{width}"), axis=2)
    return ACTIVATIONS[activation](graph, graph.add("Add", biases, total))


def _tanh(graph: Graph, x: str) -> str:
    y = graph.limit(x, graph.number(-9.15), graph.number(9.15))
    z = graph.add("Mul", y, y)
    p, q = _polynomial(graph, z, _TANH_P), _polynomial(graph, z, _TANH_Q)
    t = graph.add("Div", graph.add("Mul", y, p), q)
    below = graph.add("Add", graph.number(1), graph.add("Mul", t, t))
    h = graph.add("Div", graph.add("Add", t, t), below)
    return graph.limit(h, graph.number(-1), graph.number(1))


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


ACTIVATIONS: dict[str, Callable[[Graph, str], str]] = {
    "tanh": _tanh,
    "sigmoid": _sigmoid,
    STEEP: lambda graph, x: _sigmoid(graph, graph.add("Mul", graph.number(STEEPNESS), x)),
    "relu": lambda graph, x: graph.limit(x, graph.number(0), None),
    "clamp": _clamp,
    "linear": lambda _, x: x,
}


def actuators(controller: Evolved, graph: Graph, outputs: str) -> None:
    """Add the mapping of the network's outputs to actuators."""
    low, high = np.array(controller.specification["output_range"], np.float32)
    a = outputs
    if (low, high) == (0, 1):
        a = graph.add("Sub", graph.add("Mul", graph.number(2), a), graph.number(1))
    elif (low, high) != (-1, 1):
        above = graph.add("Sub", a, graph.number(float(low)))
        share = graph.add("Div", above, graph.number(float(high - low)))
        a = graph.add("Sub", graph.add("Mul", share, graph.number(2)), graph.number(1))
    a = graph.add("Where", graph.add("IsNaN", a), graph.number(0), a)
    graph.add("Identity", graph.limit(a, graph.number(-1), graph.number(1)), result="actuators")
