"""Layered networks: feed-forward, no state."""

from collections.abc import Sequence
from itertools import pairwise
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field

from swarmwright.controllers.networks import NetworkOptions, NodeNetwork, number_names

Size = Annotated[int, Field(ge=1, le=10_000)]


class LayeredOptions(NetworkOptions):
    """A feed-forward network: every node of a layer is connected with all nodes of the previous layer."""

    kind: Literal["layered"] = "layered"
    hidden: list[Size] = Field(default=[8], max_length=100)
    """Number of nodes of each hidden layer; an empty list connects the sensors to the actuators directly."""
    activation: Literal["tanh", "sigmoid", "relu", "clamp", "linear"] = "tanh"
    """Function of every node. tanh, relu and linear are actuators directly (limited to -1..1); clamp
    (to 0..1) and sigmoid are mapped from 0..1 to -1..1."""
    output_activation: Literal["tanh", "sigmoid", "relu", "clamp", "linear"] | None = None
    """Function of the output nodes, if it is not that of all nodes: `linear` for most networks that were
    trained by reinforcement learning."""

    @property
    def last_activation(self) -> str:
        """Activation function of the output nodes."""
        return self.output_activation or self.activation


class Layered(NodeNetwork):
    """Feed-forward network, sensors in, actuators out.

    Genes: layer after layer, node after node, bias first.
    """

    kind: ClassVar[str] = "layered"
    options_model = LayeredOptions
    options: LayeredOptions

    def node_sizes(self) -> Sequence[int]:
        """Return the size of the previous layer, for each node."""
        layers = [self.sensors, *self.options.hidden, self.actuators]
        return [inputs for inputs, nodes in pairwise(layers) for _ in range(nodes)]

    def node_names(self) -> Sequence[tuple[str, Sequence[str]]]:
        """Return the name of each node and those of its inputs, in the genome's order."""
        hidden = [
            number_names("hidden" if len(self.options.hidden) == 1 else f"layer {layer} node", size)
            for layer, size in enumerate(self.options.hidden)
        ]
        layers = [
            number_names("sensor", self.sensors),
            *hidden,
            number_names("actuator", self.actuators),
        ]
        return [(node, sources) for sources, nodes in pairwise(layers) for node in nodes]

    def architecture(self) -> dict[str, Any]:
        """Return the specification of all controllers, without weights."""
        output = self.options.output_activation
        return {
            "version": 1,
            "kind": self.kind,
            "sensors": self.sensors,
            "actuators": self.actuators,
            "hidden": list(self.options.hidden),
            "activation": self.options.activation,
            **({} if output is None else {"output_activation": output}),
            "output_range": self.options.outputs,
        }
