"""OpenAI's evolution strategy: a gradient from antithetic samples, for large networks."""

import math
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from swarmwright import _engine
from swarmwright.methods._base import Method, MethodOptions
from swarmwright.methods._numbers import DISCRETE, center_and_reach, limits
from swarmwright.representations._base import Representation
from swarmwright.typing import Fitness, Genomes

_FIRST, _SECOND, _TINY = 0.9, 0.999, 1e-8  # the defaults of Adam


class OpenaiEsOptions(MethodOptions):
    """The evolution strategy of Salimans et al. with their defaults.

    Sizes are shares of half the initial range of a gene.
    """

    kind: Literal["openai_es"] = "openai_es"
    population: int = Field(default=100, ge=2, le=10_000_000, multiple_of=2)
    """Genomes in each generation: pairs on opposite sides of the center, so an even number."""
    noise: float = Field(default=0.1, gt=0, le=1000)
    """Standard deviation of the genomes around the center."""
    step: float = Field(default=0.05, gt=0, le=1000)
    """Step size of Adam, which moves the center."""
    decay: float = Field(default=0.005, ge=0, le=1)
    """Weight decay: pulls genes towards the middle of their initial range."""


class OpenaiEs(Method):
    """A center moves along a gradient that is estimated from the ranks of samples around it.

    For every pair of a generation a normally distributed direction is drawn, and the center plus and minus
    `noise` times it are evaluated: candidates 2 i and 2 i + 1. Fitness becomes its rank, from -0.5 to 0.5.
    The sum of the directions, each times the difference of its pair's ranks, less the decay, is what Adam
    climbs. It starts from the middle of the initial range, as evosax does.

    Source: Salimans, Ho, Chen, Sidor and Sutskever, "Evolution strategies as a scalable alternative to
    reinforcement learning", 2017 (arXiv:1703.03864), and Kingma and Ba, "Adam", ICLR 2015. It differs in
    three points. Equal fitness has an equal rank, so a plateau does not move the center. Failed candidates
    share the lowest rank, and a generation that failed as a whole does not move the center. And sizes are
    relative to the initial range of each gene, so that weights, biases and bounded parameters need no
    settings of their own; genes with bounds are cut to them.
    """

    kind: ClassVar[str] = "openai_es"
    options_model = OpenaiEsOptions
    options: OpenaiEsOptions
    start_as = "center"
    generational_because = "the center moves by the ranks within a generation"

    def __init__(self, options: OpenaiEsOptions, representation: Representation, *, seed: int) -> None:
        super().__init__(options, representation, seed=seed)
        self._middle, self._reach = center_and_reach(representation)
        self._center = np.zeros_like(self._middle)
        self._speed = np.zeros_like(self._center)
        self._spread = np.zeros_like(self._center)
        self._first_left, self._second_left = 1.0, 1.0
        self._directions: NDArray[np.float64] = np.empty(0)
        self._fitness: Fitness = np.empty(0)

    def start_from(self, genomes: Genomes) -> None:
        """Put the center there, instead of the middle of the initial range."""
        super().start_from(genomes)
        self._center = (self.start[0].astype(np.float64) - self._middle) / self._reach

    @classmethod
    def unsuitable(cls, representation: Representation) -> str | None:
        """Refuse genes that are not numbers to compute with."""
        return None if representation.continuous else DISCRETE

    @property
    def budget(self) -> int:
        """Number of evaluations of the whole run."""
        return self.options.population * self.options.generations

    @property
    def population_fitness(self) -> Fitness:
        """Fitness of the last sample."""
        return self._fitness

    @property
    def center(self) -> NDArray[np.float64]:
        """Where the samples are around, as genes: (genome_size,)."""
        return np.asarray(self._middle + self._reach * self._center)

    def _draw(self) -> NDArray[np.float64]:
        """Return the direction of each pair, (pairs, genome_size)."""
        pairs = range(self.options.population // 2)
        return self.streams("openai_es.direction", pairs).normals(len(self._center))

    def _ask(self) -> Genomes:
        self._directions = self._draw()
        lower, upper = limits(self.representation)
        return _engine.mirrored(
            self._directions,
            self._center,
            self.options.noise,
            middle=self._middle,
            reach=self._reach,
            lower=lower,
            upper=upper,
        )

    def _tell(self, genomes: Genomes, fitness: Fitness) -> None:
        self._fitness = fitness
        if np.isnan(fitness).all():
            return
        ranks = centered_ranks(fitness)
        gradient = _engine.weighted_sum(self._directions, ranks[::2] - ranks[1::2])
        self._climb(gradient / len(genomes) - self.options.decay * self._center)
        lower, upper = ((limit - self._middle) / self._reach for limit in self.representation.bounds)
        self._center = np.clip(self._center, lower, upper)

    def _climb(self, gradient: NDArray[np.float64]) -> None:
        """Make one step of Adam."""
        self._first_left *= _FIRST
        self._second_left *= _SECOND
        self._speed = _FIRST * self._speed + (1 - _FIRST) * gradient
        self._spread = _SECOND * self._spread + (1 - _SECOND) * gradient * gradient
        size = self.options.step * math.sqrt(1 - self._second_left) / (1 - self._first_left)
        self._center = self._center + size * self._speed / (np.sqrt(self._spread) + _TINY)


def centered_ranks(fitness: Fitness) -> NDArray[np.float64]:
    """Return ranks from -0.5 (worst) to 0.5 (best); equal values share the mean, failed ones are worst.

    Shape (n,), n >= 2.
    """
    # A failed candidate is put in order as minus infinity; nothing is computed with that.
    order = np.where(np.isnan(fitness), -np.inf, fitness)
    _, places, counts = np.unique(order, return_inverse=True, return_counts=True)
    ends = np.cumsum(counts)
    means = ends - (counts + 1) / 2
    ranks: NDArray[np.float64] = means[places] / (len(fitness) - 1) - 0.5
    return ranks
