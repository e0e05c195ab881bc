"""The common base of natural evolution strategies: samples, rank weights and restarts."""

from abc import abstractmethod
from typing import ClassVar, Literal

import numpy as np
from pydantic import Field

from swarmwright import _engine
from swarmwright.common.arrays import Genome
from swarmwright.common.random_numbers import Streams
from swarmwright.controllers import Representation
from swarmwright.methods._base import MethodOptions
from swarmwright.methods._gaussian import Gaussian, Numbers, logarithm


class NesOptions(MethodOptions):
    """Options of natural evolution strategies."""

    population: int | None = Field(default=None, ge=4, le=10_000_000)
    """Genomes in each generation. Default: 4 + 3 ln(genes), rounded down, and at least 20."""
    step: float = Field(default=0.2, gt=0, le=1000)
    """Initial standard deviation, as a share of half the initial range of a gene."""
    rate: float | None = Field(default=None, gt=0, le=1)
    """Learning rate of standard deviations. Default: that of the paper, by the number of genes."""
    restart: Literal["none", "same", "ipop"] = "same"
    """Reaction when all standard deviations fall below a thousandth of `step`, or the best fitness stays the
    same for 10 + 30 genes / population generations. none: continue. same: restart from a random genome. ipop:
    restart with twice the population, for many local optima."""


class Nes(Gaussian):
    """A normal distribution that follows the natural gradient of the expected fitness.

    A run has at most `generations` x `population` evaluations, which larger populations use up in fewer
    generations. Equal fitness has equal weight, so plateaus and generations that failed completely change
    nothing.
    """

    options: NesOptions
    generational_because = "its distribution is learned from the ranks within a generation"
    separable: ClassVar[bool]
    """Whether only the standard deviation of each gene is learned, without correlations."""

    def __init__(self, options: NesOptions, representation: Representation, *, seed: int) -> None:
        super().__init__(options, representation, seed=seed)
        genes = representation.genome_size
        self._first_population = _population(options, representation)
        self._budget = self._first_population * options.generations
        self._rate = options.rate or self._default_rate(genes)

    @classmethod
    def first_generation(cls, options: MethodOptions, representation: Representation | None) -> int | None:
        """Return the population, which depends on the number of genes by default."""
        if representation is None or not isinstance(options, NesOptions):
            return super().first_generation(options, representation)
        return _population(options, representation)

    @property
    def population(self) -> int:  # type: ignore[override] # it grows
        """Genomes in each generation of the current start."""
        return int(self._state("population")[0])

    @property
    def budget(self) -> int:
        """Number of evaluations of the whole run."""
        return self._budget

    @property
    def evaluation_limit(self) -> int | None:
        """Largest number of candidates that a run evaluates, see `Method.evaluation_limit`."""
        if self.options.restart != "ipop":
            return super().evaluation_limit
        return min(self._budget, self.options.evaluations or self._budget)

    @staticmethod
    @abstractmethod
    def _default_rate(genes: int) -> float:
        """Return the paper's learning rate of the standard deviations."""

    def _begin(self) -> _engine.Search:
        return _engine.Search.nes(
            self.seed,
            self.kind,
            space=self._space,
            start=self._start_center,
            starts=self._new_start,
            population=self._first_population,
            step=self.options.step,
            rate=self._rate,
            separable=self.separable,
            restart=self.options.restart,
        )

    def _new_start(self, generation: int) -> Numbers:
        """Return the center of a start after this generation."""
        if not generation and len(self.start):
            genome: Genome = self.start[0]
        else:
            genome = self.representation.initials(Streams(self.seed, "initial", generation, [0]))[0]
        return genome.astype(np.float64)

    def _is_exhausted(self) -> bool:
        return self.evaluations >= self._budget


def _population(options: NesOptions, representation: Representation) -> int:
    return options.population or max(4 + int(3 * logarithm(representation.genome_size)), 20)
