"""The common base of methods that sample from a learned normal distribution."""

import numpy as np
from numpy.typing import NDArray

from swarmwright import _engine
from swarmwright.controllers import Representation
from swarmwright.methods._numbers import center_and_reach, explain_discrete, limits
from swarmwright.methods.search import SearchMethod

Numbers = NDArray[np.float64]


class Gaussian(SearchMethod):
    """A distribution around a center, in units where the initial range of each gene is -1 to 1.

    It starts from the middle of the initial range, as evosax does, or from a given genome.
    """

    start_as = "center"
    population: int
    """Genomes in each generation."""

    @classmethod
    def unsuitable(cls, representation: Representation) -> str | None:
        """Refuse genes that are not numbers to compute with."""
        return explain_discrete(representation)

    @property
    def budget(self) -> int:
        """Number of evaluations of the whole run."""
        return self.population * self.options.generations

    @property
    def center(self) -> Numbers:
        """Center of the samples, as genes: (genome_size,)."""
        return self._state("center")

    @property
    def _space(self) -> tuple[Numbers, Numbers, Numbers, Numbers]:
        """Middle and reach of the genes, and their limits."""
        return (*center_and_reach(self.representation), *limits(self.representation))

    @property
    def _start_center(self) -> Numbers | None:
        """The center of a given genome, or None."""
        return self.start[0].astype(np.float64) if len(self.start) else None


class Pairs(Gaussian):
    """Pairs of samples on opposite sides of the center, candidates 2 i and 2 i + 1; Adam moves the center."""

    generational_because = "the center moves by the ranks within a generation"

    def _pairs(self, noise: float, step: float, learning: list[float]) -> _engine.Search:
        return _engine.Search.pairs(
            self.seed,
            self.kind,
            space=self._space,
            start=self._start_center,
            population=self.population,
            noise=noise,
            step=step,
            learning=learning,
        )


def logarithm(number: float) -> float:
    """Return the natural logarithm, the same bits on every machine."""
    return float(_engine.log(np.array([float(number)]))[0])
