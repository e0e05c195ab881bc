"""EvoStick's network: no hidden nodes, steep logistic outputs."""

from collections.abc import Sequence
from typing import Any, ClassVar, Literal

import numpy as np
from pydantic import Field

from swarmwright.common.arrays import Genome, Genomes, Limits
from swarmwright.common.random_numbers import Stream, Streams
from swarmwright.controllers._base import RepresentationOptions
from swarmwright.controllers.networks import NodeNetwork, number_names


class EvostickOptions(RepresentationOptions):
    """A network without hidden nodes whose outputs are steep logistic functions."""

    kind: Literal["evostick"] = "evostick"
    weight_range: float = Field(default=5.0, gt=0, le=1e6)
    """Weights stay within +-weight_range, and start uniform in it; also the size of a mutation of severity 1.
    """
    mutation: Literal["uniform", "proportional"] = "uniform"
    """How a gene is changed: `uniform` within +-severity * range, `proportional` within a fifth of its
    size (at least 0.1), whatever the severity."""

    @property
    def bias_range(self) -> float:
        """The range of biases, which equals that of weights."""
        return float(np.float32(self.weight_range))


class Evostick(NodeNetwork):
    """A weight from each sensor and from a bias, whose input is 1, to each actuator.

    Genes: sensor after sensor, then the bias, a weight for each actuator: 50 for 24 sensors and 2 actuators,
    in ARGoS's order. An output is the logistic function of 4.924273 times the sum, mapped from 0..1 to -1..1.

    Mutation and distance are those of the other networks, with weights clipped to their range; a crossover
    takes a run of genes from the father.

    Source: Francesca, Brambilla, Brutschy, Trianni and Birattari, "AutoMoDe: a novel approach to the
    automatic design of control software for robot swarms", Swarm Intelligence 8(2), 2014.
    """

    kind: ClassVar[str] = "evostick"
    options_model = EvostickOptions
    options: EvostickOptions  # type: ignore[assignment] # has the options that the operators use

    def node_sizes(self) -> Sequence[int]:
        """Return one node with all genes, so that crossover exchanges runs of genes."""
        return [(self.sensors + 1) * self.actuators - 1]

    @property
    def gene_names(self) -> tuple[str, ...]:
        """The actuator and the sensor of each weight."""
        sources = [*number_names("sensor", self.sensors), "bias"]
        nodes = number_names("actuator", self.actuators)
        return tuple(f"{node}, {source}" for source in sources for node in nodes)

    @property
    def bounds(self) -> Limits:
        """Weights stay within +-weight_range."""
        limit = np.full(self.genome_size, self.options.bias_range)
        return -limit, limit

    @property
    def initial_range(self) -> Limits:
        """The whole range."""
        return self.bounds

    def mutate(self, genome: Genome, stream: Stream, *, severity: float, probability: float) -> Genome:
        """Return a copy in which each gene is moved with `probability`, and clipped to its range."""
        return self._clip(super().mutate(genome, stream, severity=severity, probability=probability))

    def mutations(
        self, parents: Genomes, streams: Streams, *, severity: float, probability: float
    ) -> Genomes:
        """Return a mutated copy of each parent."""
        return self._clip(super().mutations(parents, streams, severity=severity, probability=probability))

    def _clip(self, genomes: Genomes) -> Genomes:
        limit = np.float32(self.options.bias_range)
        return np.clip(genomes, -limit, limit)

    def architecture(self) -> dict[str, Any]:
        """Return the specification of all controllers, without weights."""
        return {"version": 1, "kind": self.kind, "sensors": self.sensors, "actuators": self.actuators}
