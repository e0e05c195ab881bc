"""Base class of the neural representations: networks of nodes with a bias and weights."""

from abc import abstractmethod
from collections.abc import Sequence
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, field_validator

from swarmwright import _engine
from swarmwright.common.arrays import Genome, Genomes, Limits
from swarmwright.common.random_numbers import Stream, Streams
from swarmwright.controllers._base import Representation, RepresentationOptions

OUTPUT_RANGE = {
    "tanh": (-1.0, 1.0),
    "relu": (-1.0, 1.0),
    "linear": (-1.0, 1.0),
    "clamp": (0.0, 1.0),
    "sigmoid": (0.0, 1.0),
    "steep_sigmoid": (0.0, 1.0),
}
"""Range of a node's output that is mapped to actuators in -1..1, by activation."""


def number_names(noun: str, count: int) -> list[str]:
    """Return a name for each of several things: `sensor 0`, `sensor 1`, .."""
    return [f"{noun} {number}" for number in range(count)]


class NetworkOptions(RepresentationOptions):
    """Options of all networks; those of the genetic operators follow FREVO's FullyMeshedNet."""

    output_range: list[float] | None = Field(default=None, min_length=2, max_length=2)
    """Outputs that are mapped to the actuators -1 and 1; values beyond are clamped. Default: 0 and 1 for
    output nodes with clamp and sigmoid, otherwise -1 and 1.
    """

    weight_range: float = Field(default=2.0, gt=0, le=1e6)
    """Initial weights are uniform in +-weight_range, also the size of a mutation of severity 1."""
    bias_range: float = Field(default=2.0, gt=0, le=1e6)
    """Initial biases are uniform in +-bias_range, also the size of a mutation of severity 1."""
    mutation: Literal["uniform", "proportional"] = "uniform"
    """How a gene is changed: `uniform` within +-severity * range, `proportional` within a fifth of its
    size (at least 0.1), whatever the severity."""

    @field_validator("output_range")
    @classmethod
    def _check_ascending(cls, value: list[float] | None) -> list[float] | None:
        if value is not None and not _is_range(*value):
            raise ValueError(f"must be two finite numbers, the lower one first, not {value}")
        return value

    @property
    def outputs(self) -> list[float]:
        """Outputs of the network that are mapped to the actuators -1 and 1."""
        return list(self.output_range or OUTPUT_RANGE[self.last_activation])

    @property
    def last_activation(self) -> str:
        """Activation function of the output nodes."""
        activation: str = self.activation  # type: ignore[attr-defined] # every network's options have it
        return activation


def _is_range(low: float, high: float) -> bool:
    """Whether the engine, which computes in binary32, accepts the range."""
    with np.errstate(over="ignore", invalid="ignore"):
        width = np.float32(high) - np.float32(low)
    return bool(np.isfinite(width) and width > 0)


class NodeNetwork(Representation):
    """A genome is a row of nodes, each with its bias first and then its incoming weights.

    Operators follow FREVO (Components/Representations/FullyMeshedNet, method numbers 1 and 2): a mutation
    adds to each gene, with the given probability, a number uniform in +-severity times the gene's range; a
    crossover replaces a run of neighbouring nodes, at least one and not all, with the father's (the run ends
    at the last node); the distance is the sum of absolute differences. FREVO's method 2 gives negative
    weights only the smallest step and biases +-10; here `proportional` uses the absolute value for both. A
    network of a single node has no runs of nodes to exchange: it exchanges runs of genes. The engine computes
    them, in binary64, and rounds to binary32 at the end.
    """

    options: NetworkOptions

    @abstractmethod
    def node_sizes(self) -> Sequence[int]:
        """Return the number of weights of each node without its bias, in the genome's order."""

    @cached_property
    def _starts(self) -> NDArray[np.intp]:
        """Index of the first gene of each node, and the end of the last node."""
        sizes = np.array([0, *(size + 1 for size in self.node_sizes())], dtype=np.intp)
        starts: NDArray[np.intp] = np.cumsum(sizes)
        return starts

    @cached_property
    def _operators(self) -> _engine.NodeNetwork:
        return _engine.NodeNetwork(
            self.node_sizes(),
            weight_range=self.options.weight_range,
            bias_range=self.options.bias_range,
            mutation=self.options.mutation,
        )

    @property
    def operators(self) -> _engine.NodeNetwork | None:
        """The engine's operators; None if a subclass overrides them."""
        kind, names = type(self), ("initials", "mutations", "matings")
        inherited = all(getattr(kind, name) is getattr(NodeNetwork, name) for name in names)
        return self._operators if inherited else None

    @property
    def genome_size(self) -> int:
        """Number of genes: a bias for each node and its weights."""
        return int(self._starts[-1])

    def node_names(self) -> Sequence[tuple[str, Sequence[str]]]:
        """Return the name of each node and those of its inputs, in the genome's order; by default none."""
        return ()

    @property
    def gene_names(self) -> tuple[str, ...]:
        """The node and the input of each weight, such as `actuator 0, sensor 3`."""
        return tuple(
            f"{node}, {source}" for node, sources in self.node_names() for source in ("bias", *sources)
        )

    @property
    def initial_range(self) -> Limits:
        """The +-range of each gene."""
        ranges = np.full(self.genome_size, self.options.weight_range, dtype=np.float64)
        ranges[self._starts[:-1]] = self.options.bias_range
        return -ranges, ranges

    def initial(self, stream: Stream) -> Genome:
        """Return a genome uniform in +-range."""
        return self._operators.initial(stream)

    def initials(self, streams: Streams) -> Genomes:
        """Return a genome uniform in +-range for each stream."""
        return self._operators.initials(streams)

    def mutate(self, genome: Genome, stream: Stream, *, severity: float, probability: float) -> Genome:
        """Return a copy in which each gene is moved with `probability`, see the class."""
        return self._operators.mutate(genome, stream, severity=severity, probability=probability)

    def mutations(
        self, parents: Genomes, streams: Streams, *, severity: float, probability: float
    ) -> Genomes:
        """Return a mutated copy of each parent."""
        return self._operators.mutations(parents, streams, severity=severity, probability=probability)

    def crossover(self, mother: Genome, father: Genome, stream: Stream) -> Genome:
        """Return a copy of `mother` with a run of nodes of `father`."""
        return self._operators.crossover(mother, father, stream)

    def crossovers(self, mothers: Genomes, fathers: Genomes, streams: Streams) -> Genomes:
        """Return a child of each pair."""
        return self._operators.crossovers(mothers, fathers, streams)

    def matings(
        self, genomes: Genomes, mothers: NDArray[np.int64], partners: NDArray[np.int64], streams: Streams
    ) -> Genomes:
        """Return a child of each mother and its most distant partner."""
        return self._operators.matings(genomes, mothers, partners, streams)

    def distance(self, genome: Genome, other: Genome) -> float:
        """Return the sum of absolute differences, added in the genome's order in binary64."""
        return float(_distances(genome, other[np.newaxis])[0])

    def distances(self, genome: Genome, others: Genomes) -> NDArray[np.float64]:
        """Return the distance of one genome to each row of others, (k, D) to (k,)."""
        return _distances(genome, others)

    def distances_among(
        self, genomes: Genomes, indices: NDArray[np.int64], others: NDArray[np.int64]
    ) -> NDArray[np.float64]:
        """Return the distances between genomes, given by their indices."""
        return _engine.distances(genomes, indices, others)


def _distances(genome: Genome, others: Genomes) -> NDArray[np.float64]:
    # accumulate adds strictly one after another; sum() would add in an order that NumPy chooses.
    differences = np.abs(genome.astype(np.float64) - others)
    sums: NDArray[np.float64] = np.add.accumulate(differences, axis=1)[:, -1]
    return sums
