"""Fully meshed networks: FREVO's recurrent network."""

from collections.abc import Sequence
from typing import Any, ClassVar, Literal

from pydantic import Field

from swarmwright.controllers.networks import NetworkOptions, NodeNetwork, number_names


class FullyMeshedOptions(NetworkOptions):
    """A recurrent network in which every node is connected with all nodes, including itself."""

    kind: Literal["fully_meshed"] = "fully_meshed"
    hidden: int = Field(default=2, ge=0, le=10_000)
    """Number of hidden nodes."""
    activation: Literal["clamp", "sigmoid", "tanh", "relu"] = "clamp"
    """Function of every node. clamp (to 0..1, FREVO's LINEAR) and sigmoid are mapped from 0..1 to
    actuators in -1..1; tanh and relu are used directly (limited to -1..1)."""
    iterations: int = Field(default=2, ge=1, le=1000)
    """How often all nodes are computed in each step."""


class FullyMeshed(NodeNetwork):
    """FREVO's FullyMeshedNet: hidden and output nodes, each with a bias and a weight from every node.

    Genes: node after node (hidden, then outputs): the bias, then a weight from every node (inputs, hidden,
    outputs).
    """

    kind: ClassVar[str] = "fully_meshed"
    options_model = FullyMeshedOptions
    options: FullyMeshedOptions

    def node_sizes(self) -> Sequence[int]:
        """Return the number of all nodes, for each node that is not an input."""
        computed = self.options.hidden + self.actuators
        return [self.sensors + computed] * computed

    def node_names(self) -> Sequence[tuple[str, Sequence[str]]]:
        """Return the name of each node and those of its inputs, in the genome's order."""
        nodes = number_names("hidden", self.options.hidden) + number_names("actuator", self.actuators)
        return [(node, number_names("sensor", self.sensors) + nodes) for node in nodes]

    def architecture(self) -> dict[str, Any]:
        """Return the specification of all controllers, without weights."""
        return {
            "version": 1,
            "kind": self.kind,
            "sensors": self.sensors,
            "actuators": self.actuators,
            "hidden": self.options.hidden,
            "activation": self.options.activation,
            "iterations": self.options.iterations,
            "output_range": self.options.outputs,
        }
