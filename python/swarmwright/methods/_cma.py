"""The common base of both variants of CMA-ES."""

from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from swarmwright import _engine
from swarmwright.common.random_numbers import Stream
from swarmwright.controllers import Representation
from swarmwright.methods._base import MethodOptions
from swarmwright.methods._gaussian import logarithm
from swarmwright.methods._numbers import center_and_reach, explain_discrete
from swarmwright.methods.search import SearchMethod


class CmaOptions(MethodOptions):
    """Options of both variants."""

    population: int | None = Field(default=None, ge=3, le=1_000_000)
    """Genomes in each generation. Default: 4 + 3 ln(genes), rounded down."""
    step: float = Field(default=0.3, gt=0, le=1000)
    """Initial standard deviation, as a share of half the initial range of a gene."""
    restart: Literal["none", "ipop", "bipop"] = "ipop"
    """Reaction to a stopping criterion. none: continue. ipop: restart from a random genome with twice the
    population. bipop: alternate between ipop's restarts and those with small populations and steps, with
    equal evaluations.
    """


class Cma(SearchMethod):
    """A normal distribution that follows the best half of each generation.

    It learns from the drawn points, not from their rounding to binary32. Failed candidates are worse than all
    others; after a generation that failed completely, the distribution is sampled again.

    A run has at most `generations` x `population` evaluations, which larger populations use up in fewer
    generations.
    """

    options: CmaOptions
    options_model: ClassVar[type[CmaOptions]]
    start_as = "center"
    generational_because = "its distribution is learned from the ranks within a generation"
    diagonal: ClassVar[bool]
    """Whether the covariance matrix stays diagonal."""

    def __init__(self, options: CmaOptions, representation: Representation, *, seed: int) -> None:
        super().__init__(options, representation, seed=seed)
        self.population = _population(options, representation)
        """Genomes in each generation of the first start."""

    @classmethod
    def first_generation(cls, options: MethodOptions, representation: Representation | None) -> int | None:
        """Return the population, which depends on the number of genes by default."""
        if representation is None or not isinstance(options, CmaOptions):
            return super().first_generation(options, representation)
        return _population(options, representation)

    @classmethod
    def unsuitable(cls, representation: Representation) -> str | None:
        """Refuse genes that are not numbers to compute with, and a single one."""
        if representation.genome_size < 2:
            return "it has a single gene, too few to learn a covariance; use de, pso or nnga"
        return explain_discrete(representation)

    @property
    def budget(self) -> int:
        """Number of evaluations of the whole run."""
        return self.population * self.options.generations

    @property
    def evaluation_limit(self) -> int | None:
        """Largest number of candidates that a run evaluates, see `Method.evaluation_limit`."""
        if self.options.restart == "none":
            return super().evaluation_limit
        return min(self.budget, self.options.evaluations or self.budget)

    @property
    def starts(self) -> int:
        """Number of starts, including the first."""
        return int(self._state("starts")[0])

    @property
    def stopped(self) -> list[str]:
        """Stopping criterion of each ended start."""
        return self.search.stopped

    def _is_exhausted(self) -> bool:
        return self.evaluations >= self.budget

    def _begin(self) -> _engine.Search:
        center, reach = center_and_reach(self.representation)
        lower, upper = self.representation.bounds
        return _engine.Search.cma(
            self.seed,
            self.kind,
            center=self.start[0].astype(np.float64) if len(self.start) else center,
            starts=self._new_start,
            reach=reach,
            lower=lower.astype(np.float64),
            upper=upper.astype(np.float64),
            step=self.options.step,
            population=self.population,
            separable=self.diagonal,
            restart=self.options.restart,
            budget=min(self.budget, self.options.evaluations or self.budget),
        )

    def _new_start(self, number: int) -> NDArray[np.float64]:
        """Return the center of a start, counted from 0."""
        return self.representation.initial(Stream(self.seed, "cma.start", number)).astype(np.float64)


def _population(options: CmaOptions, representation: Representation) -> int:
    return options.population or 4 + int(3 * logarithm(representation.genome_size))
