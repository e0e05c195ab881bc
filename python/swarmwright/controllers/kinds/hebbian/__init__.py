"""Networks with Hebbian learning: FREVO's HebbNet."""

from collections.abc import Sequence
from typing import Any, ClassVar, Literal

import numpy as np
from pydantic import Field

from swarmwright.common.arrays import Genome, Genomes, Limits
from swarmwright.common.random_numbers import Stream, Streams
from swarmwright.controllers._base import RepresentationOptions
from swarmwright.controllers.networks import NodeNetwork


class HebbianOptions(RepresentationOptions):
    """A recurrent network, every node connected with all nodes, whose weights learn in each step."""

    kind: Literal["hebbian"] = "hebbian"
    hidden: int = Field(default=2, ge=0, le=10_000)
    """Number of hidden nodes."""
    iterations: int = Field(default=2, ge=1, le=1000)
    """How often all nodes are computed in each step; weights learn once, after the last iteration."""
    learning_range: float = Field(default=0.01, gt=0, le=1e6)
    """The initial learning rate is uniform in 0..learning_range, also the size of a mutation of severity 1.
    """
    weight_range: float = Field(default=2.0, gt=0, le=1e6)
    """Initial weights are uniform in +-weight_range, also the size of a mutation of severity 1."""
    bias_range: float = Field(default=2.0, gt=0, le=1e6)
    """Initial biases are uniform in +-bias_range, also the size of a mutation of severity 1."""
    mutation: Literal["uniform", "proportional"] = "uniform"
    """How a gene is changed: `uniform` within +-severity * range, `proportional` within a fifth of its
    size (at least 0.1; the learning rate at least learning_range / bias_range times as much), whatever the
    severity."""


class Hebbian(NodeNetwork):
    """FREVO's HebbNet: a network whose weights start as the genes and change by Hebb's rule.

    Genes: the learning rate, which may be of either sign, then node after node (hidden, then outputs): the
    bias, then a weight from every node (inputs, hidden, outputs). Nodes are clipped to 0..1, which is mapped
    to actuators in -1..1. Learnt weights are discarded at the end of an episode; genes do not change.

    Operators are those of the other networks. The learning rate counts as a node without weights, whose
    moves are scaled by learning_range / bias_range. In FREVO it never mutates: the range of its change is
    rounded to 0.
    """

    kind: ClassVar[str] = "hebbian"
    options_model = HebbianOptions
    options: HebbianOptions  # type: ignore[assignment] # has the options that the operators use

    def node_sizes(self) -> Sequence[int]:
        """Return 0 for the learning rate, and the number of all nodes for each node that is not an input."""
        computed = self.options.hidden + self.actuators
        return [0, *[self.sensors + computed] * computed]

    @property
    def initial_range(self) -> Limits:
        """0 to learning_range, then the +-range of each gene."""
        low, high = super().initial_range
        low[0], high[0] = 0.0, self.options.learning_range
        return low, high

    def initial(self, stream: Stream) -> Genome:
        """Return a genome uniform in its range."""
        genome: Genome = self._scale_learning_rates(super().initial(stream)[np.newaxis])[0]
        return genome

    def initials(self, streams: Streams) -> Genomes:
        """Return a genome uniform in its range for each stream."""
        return self._scale_learning_rates(super().initials(streams))

    def mutate(self, genome: Genome, stream: Stream, *, severity: float, probability: float) -> Genome:
        """Return a copy in which each gene is moved with `probability`, see the class."""
        moved = super().mutate(genome, stream, severity=severity, probability=probability)
        child: Genome = self._scale_rate_moves(genome[np.newaxis], moved[np.newaxis])[0]
        return child

    def mutations(
        self, parents: Genomes, streams: Streams, *, severity: float, probability: float
    ) -> Genomes:
        """Return a mutated copy of each parent."""
        moved = super().mutations(parents, streams, severity=severity, probability=probability)
        return self._scale_rate_moves(parents, moved)

    def _scale_learning_rates(self, genomes: Genomes) -> Genomes:
        """Return genomes whose first gene is scaled from +-bias_range to 0..learning_range."""
        share = np.abs(genomes[:, 0].astype(np.float64)) / self.options.bias_range
        genomes[:, 0] = np.minimum(share, 1.0) * self.options.learning_range
        return genomes

    def _scale_rate_moves(self, parents: Genomes, genomes: Genomes) -> Genomes:
        """Return genomes whose first gene moves by the smaller step of the learning rate."""
        before = parents[:, 0].astype(np.float64)
        move = (genomes[:, 0] - before) * (self.options.learning_range / self.options.bias_range)
        genomes[:, 0] = np.where(genomes[:, 0] == parents[:, 0], before, before + move)
        return genomes

    def architecture(self) -> dict[str, Any]:
        """Return the specification of all controllers, without weights."""
        return {
            "version": 1,
            "kind": self.kind,
            "sensors": self.sensors,
            "actuators": self.actuators,
            "hidden": self.options.hidden,
            "iterations": self.options.iterations,
        }
