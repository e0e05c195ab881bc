"""What methods share that draw each generation from a normal distribution, learned by themselves."""

import math
from abc import abstractmethod
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from swarmwright import _engine
from swarmwright.methods._base import Method, MethodOptions
from swarmwright.methods._numbers import DISCRETE, center_and_reach, limits
from swarmwright.representations._base import Representation
from swarmwright.typing import Fitness, Genome, Genomes

Numbers = NDArray[np.float64]
_FIRST, _SECOND, _TINY = 0.9, 0.999, 1e-8  # the defaults of Adam
_LEAST, _MOST = 1e-30, 1e30
_AHEAD = 1 << 23  # normal numbers, 64 MiB: larger samples are not drawn ahead


class Gaussian(Method):
    """A distribution around a center, in units in which the initial range of each gene is -1 to 1.

    It starts from the middle of the initial range, as evosax does, or from a given genome. Every number is
    made by the engine or by single IEEE 754 operations in a fixed order, so it has the same bits on every
    machine and with every version of NumPy.
    """

    start_as = "center"
    population: int
    """Genomes in each generation."""
    _deviation: Numbers
    """Standard deviation of each gene, (genome_size,)."""
    mirrored: ClassVar[bool]
    """Whether samples are pairs on opposite sides of the center: candidates 2 i and 2 i + 1."""

    def __init__(self, options: MethodOptions, representation: Representation, *, seed: int) -> None:
        super().__init__(options, representation, seed=seed)
        self._middle, self._reach = center_and_reach(representation)
        self._center: Numbers = np.zeros_like(self._middle)
        self._directions: Numbers = np.empty(0)
        self._fitness: Fitness = np.empty(0)
        self._normals: _engine.Normals | None = None
        self._drawn = 0  # rows of them
        self._limits = limits(representation)

    def start_from(self, genomes: Genomes) -> None:
        """Put the center there, instead of the middle of the initial range."""
        super().start_from(genomes)
        self._put_center(self.start[0])

    def _put_center(self, genome: Genome) -> None:
        self._center = (genome.astype(np.float64) - self._middle) / self._reach

    @classmethod
    def unsuitable(cls, representation: Representation) -> str | None:
        """Refuse genes that are not numbers to compute with."""
        return None if representation.continuous else DISCRETE

    @property
    def budget(self) -> int:
        """Number of evaluations of the whole run."""
        return self.population * self.options.generations

    @property
    def population_fitness(self) -> Fitness:
        """Fitness of the last sample."""
        return self._fitness

    @property
    def center(self) -> Numbers:
        """Where the samples are around, as genes: (genome_size,)."""
        return np.asarray(self._middle + self._reach * self._center)

    def _ask(self) -> Genomes:
        self._directions = self._draw()
        return self._sample(self._directions, self._deviation)

    def _tell(self, genomes: Genomes, fitness: Fitness) -> None:  # noqa: ARG002 - the directions say it
        self._fitness = fitness
        if not np.isnan(fitness).all():  # a generation that failed as a whole changes nothing
            self._learn(fitness)

    @abstractmethod
    def _learn(self, fitness: Fitness) -> None:
        """Move the distribution by the fitness of the last sample, (population,), some of it NaN."""

    def _draw(self) -> Numbers:
        """Return standard normal directions, (n, genome_size): one for each sample, or for each pair."""
        count, genes = self.population // 2 if self.mirrored else self.population, len(self._center)
        if self._normals is None or count != self._drawn:
            self._normals = _engine.Normals(self.seed, f"{self.kind}.direction", count, genes)
            self._drawn = count
        ahead = count * genes <= _AHEAD and not self._exhausted()
        return self._normals.draw(self.generation, ahead=ahead)

    def _sample(self, directions: Numbers, deviation: Numbers) -> Genomes:
        """Return the genomes at `center` plus (and minus) `deviation` (genome_size,) times each direction."""
        lower, upper = self._limits
        return _engine.samples(
            directions,
            self._center,
            deviation,
            middle=self._middle,
            reach=self._reach,
            lower=lower,
            upper=upper,
            mirrored=self.mirrored,
        )

    def _move(self, step: Numbers) -> None:
        """Move the center, and keep it within the bounds of the genes."""
        lower, upper = ((limit - self._middle) / self._reach for limit in self._limits)
        self._center = np.clip(self._center + step, lower, upper)


class Adam:
    """Steps along a gradient, scaled by running means of it and of its square.

    Source: Kingma and Ba, "Adam", ICLR 2015; with its defaults.

    Args:
        step: length of the first step in each direction.
    """

    def __init__(self, step: float) -> None:
        self._step = step
        self._mean, self._square = np.zeros(1), np.zeros(1)
        self._first_left, self._second_left = 1.0, 1.0

    def climb(self, gradient: Numbers) -> Numbers:
        """Return the step to make, of the gradient's shape (n,)."""
        self._first_left *= _FIRST
        self._second_left *= _SECOND
        self._mean = _FIRST * self._mean + (1 - _FIRST) * gradient
        self._square = _SECOND * self._square + (1 - _SECOND) * gradient * gradient
        size = self._step * math.sqrt(1 - self._second_left) / (1 - self._first_left)
        return np.asarray(size * self._mean / (np.sqrt(self._square) + _TINY))


def limited(deviation: Numbers) -> Numbers:
    """Return standard deviations within limits in which nothing overflows."""
    return np.clip(deviation, _LEAST, _MOST)


def logarithm(number: float) -> float:
    """Return the natural logarithm, the same bits on every machine."""
    return float(_engine.log(np.array([float(number)]))[0])
