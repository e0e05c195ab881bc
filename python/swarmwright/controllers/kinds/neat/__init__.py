"""Networks with fixed connections, as those of FREVO's NEAT."""

from collections.abc import Sequence
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field

from swarmwright.common.problems import FieldError
from swarmwright.controllers._base import RepresentationOptions
from swarmwright.controllers.networks import NodeNetwork

_MOST_WEIGHTS = 1_000_000
"""Largest number of weights of a network."""


class NeatOptions(RepresentationOptions):
    """A recurrent network with fixed connections, as found by NEAT; its weights evolve."""

    kind: Literal["neat"] = "neat"
    sources: (
        Annotated[
            list[
                Annotated[
                    list[Annotated[int, Field(ge=0, le=2 * _MOST_WEIGHTS)]], Field(max_length=_MOST_WEIGHTS)
                ]
            ],
            Field(min_length=1, max_length=_MOST_WEIGHTS),
        ]
        | None
    ) = None
    """Input nodes of each hidden node, then of each actuator: [[0, 3], [0, 1, 2]] is a hidden node and an
    actuator. Sensors have the first numbers, from 0, then hidden nodes, then actuators. Default: no hidden
    nodes, all sensors connected with all actuators.
    """
    iterations: int = Field(default=3, ge=1, le=1000)
    """How often all nodes are computed in each step, one after the other."""
    weight_range: float = Field(default=1.0, gt=0, le=1e6)
    """Initial weights, and slopes of actuators, are uniform in +-weight_range, also the size of a mutation of
    severity 1.
    """
    bias_range: float = Field(default=1.0, gt=0, le=1e6)
    """Initial biases are uniform in +-bias_range, also the size of a mutation of severity 1."""
    mutation: Literal["uniform", "proportional"] = "uniform"
    """How a gene is changed: `uniform` within +-severity * range, `proportional` within a fifth of its
    size (at least 0.1), whatever the severity."""


class Neat(NodeNetwork):
    """The networks of FREVO's NEAT with a fixed list of connections.

    Genes: node after node (hidden, then outputs): the bias, a weight for each input node, and for an output
    the slope of its sigmoid. Hidden nodes are the tanh of their sum. All nodes are computed in order, from
    the current values of the others, and keep their values from step to step. Outputs in 0..1 are mapped to
    actuators in -1..1.

    Operators are those of the other networks; a slope is a weight. FREVO itself only adds connections and
    nodes: its mutations of weights, biases and slopes change copies that are not used.
    """

    kind: ClassVar[str] = "neat"
    options_model = NeatOptions
    options: NeatOptions  # type: ignore[assignment] # has the options that the operators use

    def __init__(self, options: RepresentationOptions, *, sensors: int, actuators: int) -> None:
        """Raise InputError when `sources` does not match the numbers of sensors and actuators."""
        super().__init__(options, sensors=sensors, actuators=actuators)
        rows = self.sources
        if len(rows) < actuators:
            raise FieldError(
                ("controller", "sources"),
                f"{len(rows)} lists for {actuators} actuators; give a list for each hidden node and each "
                "actuator",
            )
        nodes = sensors + len(rows)
        for row, inputs in enumerate(rows):
            missing = [source for source in inputs if source >= nodes]
            if missing:
                raise FieldError(
                    ("controller", "sources", row),
                    f"node {missing[0]} does not exist; with {sensors} sensors the last node is {nodes - 1}",
                )
        if self.genome_size > _MOST_WEIGHTS:
            raise FieldError(
                ("controller", "sources"),
                f"{self.genome_size} weights, but at most {_MOST_WEIGHTS} are supported",
            )

    @property
    def sources(self) -> list[list[int]]:
        """Input nodes of each node, hidden nodes first."""
        if self.options.sources is None:
            return [list(range(self.sensors))] * self.actuators
        return self.options.sources

    def node_sizes(self) -> Sequence[int]:
        """Return the number of inputs of each node, plus one for the slope of an output."""
        rows = self.sources
        hidden = len(rows) - self.actuators
        return [len(row) + (node >= hidden) for node, row in enumerate(rows)]

    def architecture(self) -> dict[str, Any]:
        """Return the specification of all controllers, without weights."""
        return {
            "version": 1,
            "kind": self.kind,
            "sensors": self.sensors,
            "actuators": self.actuators,
            "sources": self.sources,
            "iterations": self.options.iterations,
        }
