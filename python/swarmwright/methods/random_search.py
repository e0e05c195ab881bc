"""Random search: the baseline for every other method."""

from typing import ClassVar, Literal

import numpy as np
from pydantic import Field

from swarmwright.common.arrays import Fitness, Genome, Genomes
from swarmwright.controllers import Representation
from swarmwright.methods._base import Method, MethodOptions


class RandomSearchOptions(MethodOptions):
    """Independent random genomes."""

    kind: Literal["random_search"] = "random_search"
    population: int = Field(default=50, ge=1, le=10_000_000)
    """Genomes in each generation."""


class RandomSearch(Method):
    """Random search: each generation is a sample of the representation's initial distribution.

    Steady state proposes the same genomes in the same order.
    """

    kind: ClassVar[str] = "random_search"
    options_model = RandomSearchOptions
    options: RandomSearchOptions
    steady_state = True
    start_as = "members"

    def __init__(self, options: RandomSearchOptions, representation: Representation, *, seed: int) -> None:
        super().__init__(options, representation, seed=seed)
        self._fitness: Fitness = np.empty(0)
        self._sample: list[float] = []

    @property
    def budget(self) -> int:
        """Number of evaluations of the whole run."""
        return self.options.population * self.options.generations

    @property
    def population_fitness(self) -> Fitness:
        """Fitness of the last sample; in steady state, of its evaluated part."""
        return np.array(self._sample) if self._sample else self._fitness

    @property
    def generation_size(self) -> int:
        """Genomes in each generation."""
        return self.options.population

    def _ask(self) -> Genomes:
        return self.initials(range(self.options.population))

    def _tell(self, genomes: Genomes, fitness: Fitness) -> None:  # noqa: ARG002 - nothing is learned
        self._fitness = fitness

    def _ask_next(self, index: int) -> Genome:
        return self.initial_of(index)

    def _tell_next(self, index: int, genome: Genome, fitness: float) -> None:  # noqa: ARG002 - nothing is learned
        if index % self.options.population == 0:
            self._sample.clear()
        self._sample.append(fitness)
