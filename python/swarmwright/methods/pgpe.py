"""PGPE: policy gradients with parameter-based exploration."""

from typing import ClassVar, Literal

import numpy as np
from pydantic import Field

from swarmwright import _engine
from swarmwright.methods._base import MethodOptions
from swarmwright.methods._gaussian import Adam, Gaussian, limited
from swarmwright.representations._base import Representation
from swarmwright.typing import Fitness


class PgpeOptions(MethodOptions):
    """Policy gradients with parameter-based exploration, with symmetric samples and Adam.

    Sizes are shares of half the initial range of a gene.
    """

    kind: Literal["pgpe"] = "pgpe"
    population: int = Field(default=20, ge=2, le=10_000_000, multiple_of=2)
    """Genomes in each generation: pairs on opposite sides of the center, so an even number."""
    noise: float = Field(default=0.07, gt=0, le=1000)
    """Initial standard deviation of the genomes around the center."""
    step: float = Field(default=0.03, gt=0, le=1000)
    """Step size of Adam, which moves the center."""
    rate: float = Field(default=0.1, ge=0, le=10)
    """Learning rate of the standard deviations."""
    change: float = Field(default=0.2, gt=0, lt=1)
    """Largest change of a standard deviation in a generation, as a share of it."""


class Pgpe(Gaussian):
    """A gradient of the expected fitness, for the center and for the standard deviation of each gene.

    Where `openai_es` keeps its noise, this learns how much of it each gene bears. Fitness becomes its rank,
    from -0.5 to 0.5. The difference of the ranks of a pair says where the center goes; their mean, whether
    the pair's distance from it is a good one.

    Source: Sehnke et al., "Parameter-exploring policy gradients", Neural Networks 23, 2010, with symmetric
    sampling (section 4.3); Adam and the limit of the change as in Ha, "Evolving stable strategies", 2017, and
    in pgpelib. Ranks have the mean 0, which takes the place of the source's baseline. Equal fitness has an
    equal rank, failed candidates share the lowest, and a generation that failed as a whole changes nothing.
    """

    kind: ClassVar[str] = "pgpe"
    options_model = PgpeOptions
    options: PgpeOptions
    generational_because = "the center moves by the ranks within a generation"
    mirrored = True

    def __init__(self, options: PgpeOptions, representation: Representation, *, seed: int) -> None:
        super().__init__(options, representation, seed=seed)
        self.population = options.population
        self._deviation = np.full(len(self._center), options.noise)
        self._adam = Adam(options.step)

    def _learn(self, fitness: Fitness) -> None:
        ranks = _engine.centered_ranks(fitness)
        first, second = ranks[::2], ranks[1::2]
        pairs = len(fitness) / 2
        gradient = self._deviation * _engine.weighted_sum(self._directions, (first - second) / 2) / pairs
        self._move(self._adam.climb(gradient))
        # The ranks add up to 0, so that of z^2 - 1 nothing but z^2 is left.
        squares = _engine.weighted_sum(self._directions * self._directions, (first + second) / 2)
        most = self.options.change
        change = np.clip(self.options.rate * squares / pairs, -most, most)
        self._deviation = limited(self._deviation * (1 + change))
