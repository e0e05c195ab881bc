"""Networks of nodes, each with a bias and weights: what the neural representations share."""

from collections.abc import Sequence
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from swarmwright._options import Options
from swarmwright._random import Stream
from swarmwright.representations._base import Genome, Genomes, Limits, Representation

_SHARE = 0.2
_LEAST = 0.1


class NetworkOptions(Options):
    """Options of the genetic operators, after FREVO's FullyMeshedNet."""

    weight_range: float = Field(default=2.0, gt=0, le=1e6)
    """Initial weights are uniform in +-weight_range; a mutation of severity 1 moves a weight by as much."""
    bias_range: float = Field(default=2.0, gt=0, le=1e6)
    """Initial biases are uniform in +-bias_range; a mutation of severity 1 moves a bias by as much."""
    mutation: Literal["uniform", "proportional"] = "uniform"
    """How a gene is changed: `uniform` within +-severity * range, `proportional` within a fifth of its own
    size (at least 0.1), whatever the severity."""


class NodeNetwork(Representation):
    """A genome is a row of nodes, each with its bias first and then its incoming weights.

    Operators after FREVO (Components/Representations/FullyMeshedNet, method numbers 1 and 2): a mutation adds
    to each gene, with the given probability, a number uniform in +-severity times the gene's range; a
    crossover replaces a run of neighbouring nodes, at least one and not all, with the father's (the run ends
    at the last node); the distance is the sum of absolute differences. FREVO's method 2 grants negative
    weights only the least step and biases +-10; here `proportional` goes by the absolute value for both. A
    network of a single node has no runs of nodes to
    exchange: it exchanges runs of genes.
    """

    options: NetworkOptions

    def node_sizes(self) -> Sequence[int]:
        """Return how many weights each node has, in the genome's order, its bias not counted."""
        raise NotImplementedError

    @cached_property
    def _starts(self) -> NDArray[np.intp]:
        """Where each node begins, and the end of the last one."""
        sizes = np.array([0, *(size + 1 for size in self.node_sizes())], dtype=np.intp)
        starts: NDArray[np.intp] = np.cumsum(sizes)
        return starts

    @cached_property
    def _ranges(self) -> NDArray[np.float64]:
        """The range of each gene."""
        ranges = np.full(self.genome_size, self.options.weight_range, dtype=np.float64)
        ranges[self._starts[:-1]] = self.options.bias_range
        return ranges

    @property
    def genome_size(self) -> int:
        """Number of genes: a bias for each node and its weights."""
        return int(self._starts[-1])

    @property
    def initial_range(self) -> Limits:
        """The +-range of each gene."""
        return -self._ranges, self._ranges.copy()

    def initial(self, stream: Stream) -> Genome:
        """Return a genome uniform in +-range."""
        return stream.uniform(self._ranges).astype(np.float32)

    def mutate(self, genome: Genome, stream: Stream, *, severity: float, probability: float) -> Genome:
        """Return a copy in which each gene is moved with `probability`, see the class."""
        chosen = stream.unit(self.genome_size) < probability
        if self.options.mutation == "uniform":
            border = self._ranges * severity
        else:
            border = np.maximum(np.abs(genome.astype(np.float64)) * _SHARE, _LEAST)
        moved = genome.astype(np.float64) + stream.uniform(border)
        return np.where(chosen, moved, genome).astype(np.float32)

    def crossover(self, mother: Genome, father: Genome, stream: Stream) -> Genome:
        """Return a copy of `mother` with a run of nodes of `father`."""
        starts = self._starts if len(self._starts) > 2 else np.arange(self.genome_size + 1)
        units = len(starts) - 1
        count = stream.integer(units - 1) + 1
        first = stream.integer(units)
        cut = slice(starts[first], starts[min(first + count, units)])
        child = mother.copy()
        child[cut] = father[cut]
        return child

    def distance(self, one: Genome, other: Genome) -> float:
        """Return the sum of absolute differences, added in the genome's order in binary64."""
        return float(self.distances(one, other[np.newaxis])[0])

    def distances(self, one: Genome, others: Genomes) -> NDArray[np.float64]:
        """Return the distance of one genome to each row of others, (k, D) to (k,)."""
        # accumulate adds strictly one after another; sum() would add in an order of NumPy's own.
        differences = np.abs(one.astype(np.float64) - others)
        sums: NDArray[np.float64] = np.add.accumulate(differences, axis=1)[:, -1]
        return sums
