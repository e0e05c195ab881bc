"""Representations that methods are tried with beside the registered ones: genes with bounds, and choices."""

from typing import Any, Literal

import numpy as np

from swarmwright.common.random_numbers import Stream
from swarmwright.common.typing import Genome, Limits
from swarmwright.controllers import Representation, RepresentationOptions

_GENES = 12
_VALUES = 4


class _Options(RepresentationOptions):
    """No options."""

    kind: Literal["sample"] = "sample"


class _Sample(Representation):
    """Genes drawn anew by mutations, exchanged one by one by crossovers; without a controller."""

    kind = "sample"
    options_model = _Options

    def __init__(self) -> None:
        super().__init__(_Options(), sensors=1, actuators=1)

    @property
    def genome_size(self) -> int:
        """Number of genes."""
        return _GENES

    def architecture(self) -> dict[str, Any]:
        """Return nothing: these genomes are not run."""
        raise NotImplementedError

    def mutate(self, genome: Genome, stream: Stream, *, severity: float, probability: float) -> Genome:
        """Return a copy in which genes are drawn anew with `probability`."""
        chosen = stream.unit(_GENES) < probability * min(severity, 1.0)
        return np.where(chosen, self.initial(stream), genome).astype(np.float32)

    def crossover(self, mother: Genome, father: Genome, stream: Stream) -> Genome:
        """Return a copy of `mother` with half of the genes of `father`."""
        return np.where(stream.unit(_GENES) < 0.5, mother, father).astype(np.float32)

    def distance(self, one: Genome, other: Genome) -> float:
        """Return how many genes differ."""
        return float((one != other).sum())


class BoundedGenes(_Sample):
    """Genes in 0..1, but for the last three: at least 2, at most -2, and free."""

    @property
    def bounds(self) -> Limits:
        """Lowest and highest value of each gene."""
        lower, upper = np.zeros(_GENES), np.ones(_GENES)
        lower[-3:] = [2, -np.inf, -np.inf]
        upper[-3:] = [np.inf, -2, np.inf]
        return lower, upper

    @property
    def initial_range(self) -> Limits:
        """Where genes start."""
        lower, upper = np.zeros(_GENES), np.ones(_GENES)
        lower[-3:], upper[-3:] = [2, -3, -1], [3, -2, 1]
        return lower, upper

    def initial(self, stream: Stream) -> Genome:
        """Return genes uniform in their initial range."""
        lower, upper = self.initial_range
        return (lower + (upper - lower) * stream.unit(_GENES)).astype(np.float32)


class Choices(_Sample):
    """Genes that are one of 0, 1, 2, 3, in no order."""

    continuous = False

    @property
    def bounds(self) -> Limits:
        """Lowest and highest value of each gene."""
        return np.zeros(_GENES), np.full(_GENES, _VALUES - 1.0)

    def initial(self, stream: Stream) -> Genome:
        """Return random choices."""
        return np.array(stream.integers(_VALUES, _GENES), dtype=np.float32)
