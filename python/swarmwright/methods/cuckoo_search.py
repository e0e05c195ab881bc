"""Cuckoo search: Lévy flights and abandoned nests."""

from collections.abc import Callable
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from swarmwright.common.arrays import Fitness, Genomes
from swarmwright.controllers import Representation
from swarmwright.methods._base import Method, MethodOptions
from swarmwright.methods._numbers import explain_discrete, limits

_SIGMA = 0.6965745025576968
"""Deviation of Mantegna's algorithm for Lévy flights with exponent 1.5: (gamma(2.5) sin(0.75 pi) /
(gamma(1.25) 1.5 2^0.25))^(1 / 1.5). Mantegna, Physical Review E 49(5), 1994."""
_BLOCK = 1_000_000
"""Genes that are moved at once, which takes some hundred bytes each."""
_NEWTON_STEPS = 6
"""Enough for the precision of binary64 from an initial error of 60 %."""


Move = Callable[[NDArray[np.int64]], NDArray[np.float64]]
"""Returns new genomes of nests, (n, genome_size), of indices, (n,)."""


class CuckooSearchOptions(MethodOptions):
    """Cuckoo search: long jumps relative to the best nest, and new nests from differences of others."""

    kind: Literal["cuckoo_search"] = "cuckoo_search"
    population: int = Field(default=50, ge=2, le=1_000_000)
    """Nests. Generations alternate between flights of all but the best nest, and discoveries."""
    discovery: float = Field(default=0.25, ge=0, le=1)
    """Probability that a nest is discovered and rebuilt; at least one is."""
    step: float = Field(default=0.1, gt=0, le=1000)
    """Scale of flights, relative to the difference from the best nest."""


class CuckooSearch(Method):
    """Cuckoo search, which moves solutions by many short and few long jumps.

    Flights: every nest but the best is moved, each gene by a Lévy-distributed number times a normal one times
    its difference from the best nest. Discoveries: discovered nests are moved by a random share of the
    difference of two random nests. A nest changes only to a better or equal solution. Genes are clipped to
    their bounds.

    Source: Yang and Deb, "Cuckoo search via Lévy flights", NaBIC 2009, arXiv:1003.1594, and CuckooSearch of
    FREVO (Components/Methods/CuckooSearch), with five differences. FREVO keeps the result of each flight even
    if it is worse; multiplies jumps by the sum with the best nest's gene instead of the difference; scales
    jumps by 0 in the first generation, rising towards 100 in the following ones, instead of by `step`;
    replaces the discovery rate by 0.5; and also moves the best nest. An iteration of FREVO is two generations
    here.
    """

    kind: ClassVar[str] = "cuckoo_search"
    options_model = CuckooSearchOptions
    options: CuckooSearchOptions
    keeps_members = True
    start_as = "members"

    def __init__(self, options: CuckooSearchOptions, representation: Representation, *, seed: int) -> None:
        super().__init__(options, representation, seed=seed)
        self._nests: Genomes = np.empty((0, representation.genome_size), dtype=np.float32)
        self._fitness: Fitness = np.full(options.population, np.nan)
        self._moving = np.arange(options.population)  # nests of the last genomes

    @classmethod
    def unsuitable(cls, representation: Representation) -> str | None:
        """Refuse genes that are not numbers to compute with."""
        return explain_discrete(representation)

    @property
    def budget(self) -> int:
        """Upper bound of evaluations, as not all nests move in each generation."""
        return self.options.population * self.options.generations

    @property
    def population_fitness(self) -> Fitness:
        """Fitness of the nests."""
        return self._fitness.copy()

    def survivors(self) -> Genomes:
        """Return the nests, all of which survive until a better solution is found."""
        return self._nests.copy()

    def _rescore(self, fitness: Fitness) -> None:
        if len(fitness):
            self._fitness = fitness

    def _ask(self) -> Genomes:
        if self.generation == 0:
            self._nests = self.initials(range(self.options.population))
            return self._nests
        move = self._begin_flights() if self.generation % 2 else self._begin_discoveries()
        lower, upper = limits(self.representation)
        genomes = np.empty((len(self._moving), len(lower)), dtype=np.float32)
        step = max(_BLOCK // len(lower), 1)
        for begin in range(0, len(genomes), step):
            block = slice(begin, begin + step)
            genomes[block] = np.clip(move(self._moving[block]), lower, upper)
        return genomes

    def _begin_flights(self) -> Move:
        best = int(np.argmax(np.where(np.isnan(self._fitness), -np.inf, self._fitness)))
        self._moving = np.delete(np.arange(self.options.population), best)

        def fly(moving: NDArray[np.int64]) -> NDArray[np.float64]:
            nests = self._nests[moving].astype(np.float64)
            normals = self.streams("cuckoo_search.fly", moving).normals(3 * nests.shape[1])
            numerators, denominators, factors = np.hsplit(normals, 3)
            jumps = _SIGMA * numerators / _cube_root(denominators * denominators)
            moved: NDArray[np.float64] = nests + (
                self.options.step * jumps * factors * (nests - self._nests[best].astype(np.float64))
            )
            return moved

        return fly

    def _begin_discoveries(self) -> Move:
        drawn = self.streams("cuckoo_search.discover", np.arange(self.options.population)).units(2)
        discovered = drawn[:, 0] < self.options.discovery
        discovered[np.argmin(drawn[:, 0])] = True
        self._moving = np.flatnonzero(discovered)

        def discover(moving: NDArray[np.int64]) -> NDArray[np.float64]:
            others = self.streams("cuckoo_search.others", moving).integers(self.options.population, 2)
            first, second = (self._nests[column].astype(np.float64) for column in others.T)
            moved: NDArray[np.float64] = self._nests[moving] + drawn[moving, 1:] * (first - second)
            return moved

        return discover

    def _tell(self, genomes: Genomes, fitness: Fitness) -> None:
        before = self._fitness[self._moving]
        better = ~np.isnan(fitness) & ~(fitness < before)  # also than a failed one
        nests = self._moving[better]
        self._nests[nests], self._fitness[nests] = genomes[better], fitness[better]


def _cube_root(numbers: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the cube roots of positive numbers, with the same bits on every machine, unlike np.cbrt."""
    numbers = np.maximum(numbers, np.finfo(np.float64).tiny)
    exponents = np.frexp(numbers)[1]
    roots: NDArray[np.float64] = np.ldexp(1.0, exponents // 3)
    for _ in range(_NEWTON_STEPS):
        roots = roots - (roots - numbers / (roots * roots)) / 3.0
    return roots
