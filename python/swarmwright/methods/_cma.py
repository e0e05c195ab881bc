"""CMA-ES: what its two variants share."""

import math
from typing import ClassVar, Literal

import numpy as np
from pydantic import Field

from swarmwright import _engine
from swarmwright.core.random_numbers import Stream
from swarmwright.methods._base import Method, MethodOptions
from swarmwright.methods._gaussian import logarithm
from swarmwright.methods._numbers import DISCRETE, center_and_reach
from swarmwright.representations._base import Representation
from swarmwright.typing import Fitness, Genomes


class CmaOptions(MethodOptions):
    """Options of both variants."""

    population: int | None = Field(default=None, ge=3, le=1_000_000)
    """Genomes in each generation. Default: 4 + 3 ln(genes), rounded down."""
    step: float = Field(default=0.3, gt=0, le=1000)
    """Initial standard deviation, as a share of half the initial range of a gene."""
    restart: Literal["none", "ipop", "bipop"] = "ipop"
    """What happens when going on makes no sense, see the page on methods. none: samples of the same
    distribution until the budget is used. ipop: a new start from a random genome with twice the population.
    bipop: such starts, and between them starts with small populations and steps, which get as many
    evaluations."""


class Cma(Method):
    """The distribution of a normal sample follows the best half of each generation.

    Every number is made by the engine, by single IEEE 754 operations in a fixed order, so it has the same
    bits on every machine. It learns from the points that it drew, not from their rounding to binary32:
    rounding is part of the function. Failed candidates are worse than all others; a generation that failed
    as a whole teaches nothing, and another sample of the same distribution follows.

    A run ends with the generation in which `generations` x `population` evaluations are reached: starts with
    larger populations use up the budget in fewer generations.
    """

    options: CmaOptions
    options_model: ClassVar[type[CmaOptions]]
    start_as = "center"
    generational_because = "its distribution is learned from the ranks within a generation"
    diagonal: ClassVar[bool]
    """Whether the covariance matrix stays diagonal."""

    def __init__(self, options: CmaOptions, representation: Representation, *, seed: int) -> None:
        super().__init__(options, representation, seed=seed)
        self.population = options.population or 4 + int(3 * logarithm(representation.genome_size))
        """Genomes in each generation of the first start."""
        self.starts = 0
        """How often the search has begun, the first time included."""
        self.stopped: list[str] = []
        """By which criterion each start has ended."""
        self._fitness: Fitness = np.empty(0)
        self._regimes = Regimes(options.restart, self.population)
        self._size = self.population
        self._search: _engine.Cma | None = None

    @classmethod
    def unsuitable(cls, representation: Representation) -> str | None:
        """Refuse genes that are not numbers to compute with, and a single one."""
        if representation.genome_size < 2:
            return "there is a single gene, too few to learn how genes change; take de, pso or nnga"
        return None if representation.continuous else DISCRETE

    @property
    def budget(self) -> int:
        """Number of evaluations with which the last generation ends, or a few less."""
        return self.population * self.options.generations

    @property
    def population_fitness(self) -> Fitness:
        """Fitness of the last sample."""
        return self._fitness

    def _ask(self) -> Genomes:
        if self._search is None:
            self._search = self._begin()
        return self._search.ask(self.streams(f"{self.kind}.direction", range(self._size)))

    def _tell(self, genomes: Genomes, fitness: Fitness) -> None:
        assert self._search is not None
        self._fitness = fitness
        self._regimes.spent(len(genomes))
        if np.isnan(fitness).all():
            return
        stop = self._search.tell(fitness)
        if stop is None and self._regimes.over:
            stop = "share"
        # Without restarts the same distribution is sampled on and on, as long as it can be.
        if stop == "infinite" or (stop is not None and self.options.restart != "none"):
            self.stopped.append(stop)
            self._search = None

    def _exhausted(self) -> bool:
        return self.evaluations >= self.budget

    def _begin(self) -> _engine.Cma:
        """Begin the search, or begin it anew."""
        center, reach = center_and_reach(self.representation)
        share = 1.0
        if len(self.start) and not self.starts:
            center = self.start[0].astype(np.float64)
        if self.starts:
            center = self.representation.initial(Stream(self.seed, "cma.start", self.starts)).astype(
                np.float64
            )
            self._size, share = self._regimes.begin(
                *Stream(self.seed, "cma.regime", self.starts).unit(2).tolist(),
                left=min(self.budget, self.options.evaluations or self.budget) - self.evaluations,
            )
        self.starts += 1
        lower, upper = self.representation.bounds
        return _engine.Cma(
            center,
            reach=reach,
            lower=lower.astype(np.float64),
            upper=upper.astype(np.float64),
            step=self.options.step * share,
            population=self._size,
            separable=self.diagonal,
        )


class Regimes:
    """How large the next start is: IPOP (Auger and Hansen, CEC 2005) and BIPOP (Hansen, GECCO 2009 BBOB).

    Args:
        restart: none, ipop or bipop.
        population: of the first start.
    """

    def __init__(self, restart: str, population: int) -> None:
        self._restart = restart
        self._population = population
        self._doublings = 0
        self._spent = {"small": 0, "large": 0}  # evaluations; the first start counts as small
        self._regime = "small"
        self._here = 0
        self._most = math.inf

    def spent(self, evaluations: int) -> None:
        """Count evaluations of the start that is under way."""
        self._spent[self._regime] += evaluations
        self._here += evaluations

    @property
    def over(self) -> bool:
        """Whether the start that is under way has had its share."""
        return self._here >= self._most

    def begin(self, one: float, other: float, *, left: int) -> tuple[int, float]:
        """Return the population and the share of the initial step of the next start.

        one, other: uniform in [0, 1). left: evaluations of the budget that are left, to which large
                populations are cut, though not below the first.
        """
        self._here, self._most = 0, math.inf
        if self._restart == "none":  # only where numbers have become infinite
            return self._population, 1.0
        if self._restart == "bipop" and self._spent["small"] < self._spent["large"]:
            self._regime = "small"
            self._most = self._spent["large"] / 2
            largest = self._population << self._doublings
            factor = _power(largest / 2 / self._population, one * one)
            return max(self._population, int(self._population * factor)), _power(10.0, -2 * other)
        self._regime = "large"
        self._doublings += 1
        doubled = self._population << self._doublings
        return max(self._population, min(doubled, left)), 1.0


def _power(base: float, exponent: float) -> float:
    """Return a power of a positive number, the same bits on every machine."""
    return float(_engine.exp(np.array([exponent * logarithm(base)]))[0])
