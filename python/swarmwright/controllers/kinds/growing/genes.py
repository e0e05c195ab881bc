"""The nodes and connections of a growing network, read from its weights."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

ACTIVATIONS = ("steep_sigmoid", "tanh", "sigmoid", "relu", "clamp", "linear")
"""Activation functions by their numbers in a genome."""
_OF_NODE = 3
"""Numbers of a hidden node: innovation number, activation, number of inputs."""
_OF_CONNECTION = 3
"""Numbers of a connection: source, weight, whether it is enabled."""


@dataclass(frozen=True)
class Node:
    """A node that is not an input, with its enabled connections."""

    activation: str
    sources: list[int]
    """Numbers of nodes: sensors, the bias, hidden nodes, actuators."""
    weights: NDArray[np.float32]
    """(sources,)"""


@dataclass(frozen=True)
class Genes:
    """A growing network without the genes that are not in use.

    Connections of feed-forward networks from nodes that are computed later, which are 0 then, are left out.
    """

    sensors: int
    actuators: int
    recurrent: bool
    nodes: list[Node]
    """Hidden nodes in the order of computation, then actuators."""

    @property
    def hidden(self) -> int:
        """Number of hidden nodes."""
        return len(self.nodes) - self.actuators

    @property
    def weights(self) -> NDArray[np.float32]:
        """The weights of all nodes."""
        return np.concatenate([node.weights for node in self.nodes])

    @property
    def activations(self) -> list[str]:
        """The activation functions that nodes have, each once."""
        return sorted({node.activation for node in self.nodes}, key=ACTIVATIONS.index)


def read(specification: Mapping[str, Any]) -> Genes:
    """Read the network of a specification."""
    sensors, actuators = int(specification["sensors"]), int(specification["actuators"])
    weights = np.array(specification["weights"], np.float32)
    hidden = _clamp(weights[0], int(specification["nodes"]))
    inputs, rest = np.split(weights[1:], [actuators])
    rows, connections = np.split(rest, [_OF_NODE * int(specification["nodes"])])
    rows = rows.reshape(-1, _OF_NODE)[:hidden]
    left = connections.reshape(-1, _OF_CONNECTION)
    nodes = []
    targets = [*((row[1], row[2]) for row in rows), *((None, count) for count in inputs)]
    for rank, (number, count) in enumerate(targets):
        own, left = np.split(left, [_clamp(count, len(left))])
        own = own[[_clamp(enabled, 1) == 1 for enabled in own[:, 2]]]
        sources = [
            _rank(_clamp(source, sensors + actuators + hidden), sensors, actuators, hidden)
            for source in own[:, 0]
        ]
        is_used = [specification["recurrent"] or source < sensors + 1 + rank for source in sources]
        nodes.append(
            Node(
                str(specification["output_activation"])
                if number is None
                else ACTIVATIONS[_clamp(number, len(ACTIVATIONS) - 1)],
                [source for source, keep in zip(sources, is_used, strict=True) if keep],
                own[is_used, 1],
            )
        )
    return Genes(sensors, actuators, bool(specification["recurrent"]), nodes)


def _rank(source: int, sensors: int, actuators: int, hidden: int) -> int:
    """Return the number of a node if hidden nodes come before actuators, instead of after them."""
    if source <= sensors:
        return source
    return source + hidden if source <= sensors + actuators else source - actuators


def _clamp(gene: float, highest: int) -> int:
    return int(min(max(0.0, gene), highest))  # 0 for NaN


def describe(specification: Mapping[str, Any]) -> str:
    """Return kind, sizes and activations: `growing, 4-2-1, 9 connections, steep_sigmoid`."""
    parts = ["growing"]
    if "weights" in specification:
        genes = read(specification)
        parts.append(f"{genes.sensors}-{genes.hidden}-{genes.actuators}")
        parts.append(f"{len(genes.weights)} connections")
        parts.append(words(genes))
    else:
        parts.append(
            f"{specification.get('sensors')}-(0..{specification.get('nodes')})-{specification.get('actuators')}"
        )
    return ", ".join(parts)


def words(genes: Genes) -> str:
    """Return the activation functions and the form of a network in words."""
    return ", ".join([*_names(genes.activations), *(["recurrent"] if genes.recurrent else [])])


def _names(activations: Iterable[str]) -> list[str]:
    return [name.replace("_", " ") for name in activations]
