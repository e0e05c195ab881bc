"""What natural evolution strategies share: samples, weights by rank, and new starts."""

import math
from abc import abstractmethod
from typing import ClassVar, Literal

import numpy as np
from pydantic import Field

from swarmwright import _engine
from swarmwright.methods._base import MethodOptions
from swarmwright.methods._gaussian import Gaussian, Numbers, logarithm
from swarmwright.representations._base import Representation
from swarmwright.typing import Fitness

_CONVERGED = 1e-3


class NesOptions(MethodOptions):
    """Options of natural evolution strategies."""

    population: int | None = Field(default=None, ge=4, le=10_000_000)
    """Genomes in each generation. Default: 4 + 3 ln(genes), rounded down, and at least 20."""
    step: float = Field(default=0.2, gt=0, le=1000)
    """Initial standard deviation, as a share of half the initial range of a gene."""
    rate: float | None = Field(default=None, gt=0, le=1)
    """How fast standard deviations are learned. Default: the source's, by the number of genes."""
    restart: Literal["none", "same", "ipop"] = "same"
    """What happens when all standard deviations are below a thousandth of `step`, or the best fitness has
    been the same in 10 + 30 genes / population generations. none: the search goes on there until the budget
    is used. same: a new start from a random genome. ipop: such a start with twice the population, which
    helps where there are many local optima and a budget for it."""


class Nes(Gaussian):
    """A normal distribution that follows the natural gradient of the expected fitness.

    A run ends with the generation in which `generations` x `population` evaluations are reached: starts with
    larger populations use up the budget in fewer generations. Equal fitness has equal weight, so a plateau
    changes nothing; a generation that failed as a whole does not either.
    """

    options: NesOptions
    generational_because = "its distribution is learned from the ranks within a generation"
    mirrored: ClassVar[bool] = False

    def __init__(self, options: NesOptions, representation: Representation, *, seed: int) -> None:
        super().__init__(options, representation, seed=seed)
        genes = representation.genome_size
        self.population = options.population or max(4 + int(3 * logarithm(genes)), 20)
        self._budget = self.population * options.generations
        self._rate = options.rate or self._default_rate(genes)
        self._unchanged = 0
        self._best = math.nan
        self._begin()

    @property
    def budget(self) -> int:
        """Number of evaluations with which the last generation ends, or a few less."""
        return self._budget

    @abstractmethod
    def _begin(self) -> None:
        """Set the standard deviations of a start."""

    @staticmethod
    @abstractmethod
    def _default_rate(genes: int) -> float:
        """Return the source's learning rate of the standard deviations."""

    @abstractmethod
    def _follow(self, weights: Numbers) -> None:
        """Move the distribution by the weights (n,) of the last directions, which add up to 0."""

    @abstractmethod
    def _widest(self) -> float:
        """Return the largest standard deviation."""

    def _learn(self, fitness: Fitness) -> None:
        self._follow(_engine.utilities(fitness))
        best = float(np.nanmax(fitness))
        self._unchanged = self._unchanged + 1 if best == self._best else 0
        self._best = best
        if self.options.restart != "none" and self._is_over():
            if self.options.restart == "ipop":
                self.population *= 2
            self._unchanged = 0
            self._put_center(self.initials([0])[0])
            self._begin()

    def _is_over(self) -> bool:
        """Whether going on from here makes no sense."""
        patience = 10 + 30 * len(self._center) / self.population
        return self._unchanged >= patience or self._widest() < _CONVERGED * self.options.step

    def _exhausted(self) -> bool:
        return self.evaluations >= self._budget
