"""Methods that search a box with members which stay until something better replaces them."""

from abc import abstractmethod
from typing import Any

import numpy as np
from pydantic import Field

from swarmwright.methods._base import Method, MethodOptions
from swarmwright.methods._numbers import DISCRETE, center_and_reach, limits
from swarmwright.rankings._base import best_first
from swarmwright.representations._base import Representation
from swarmwright.typing import Fitness, Genomes, Limits


class BoxOptions(MethodOptions):
    """Options of methods that search a box."""

    population: int
    reach: float = Field(default=5.0, ge=1, le=1e6)
    """Genes without bounds stay within so many times their initial range around its middle."""


class Box(Method):
    """Members in a box, and as many candidates that compete with them in each generation.

    The box is made of the genes' bounds and, where there are none, of their initial range times `reach`. The
    first generation are random genomes of the representation, as with every method here, not points of the
    whole box. A candidate takes the place of its member when it is better; a failed one is worse than all
    others.
    """

    options: BoxOptions
    keeps_members = True
    start_as = "members"
    generational_because = "it replaces whole generations"

    def __init__(self, options: BoxOptions, representation: Representation, *, seed: int) -> None:
        super().__init__(options, representation, seed=seed)
        self._members: Genomes = np.empty((0, representation.genome_size), dtype=np.float32)
        self._fitness: Fitness = np.empty(0)

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
        """Fitness of the members."""
        return self._fitness

    @property
    def box(self) -> Limits:
        """Where genes are searched: the lowest and highest value of each."""
        center, reach = center_and_reach(self.representation)
        lower, upper = self.representation.bounds
        least, most = limits(self.representation)
        wide = self.options.reach * reach
        return (
            np.where(np.isfinite(lower), lower, np.clip(center - wide, least, most)),
            np.where(np.isfinite(upper), upper, np.clip(center + wide, least, most)),
        )

    def kept(self) -> Genomes:
        """Return the members that those asked for compete with, from the second generation on."""
        return self._members.copy()

    def _rescore(self, fitness: Fitness) -> None:
        self._fitness = fitness

    @property
    def _best(self) -> int:
        """Which member is the best, the first of equals."""
        return int(best_first(self._fitness)[0])

    def _streams(self) -> Any:  # noqa: ANN401 - the engine's
        return self.streams(f"{self.kind}.candidate", range(self.options.population))

    def _ask(self) -> Genomes:
        if not len(self._members):
            return self.initials(range(self.options.population))
        return self._candidates()

    @abstractmethod
    def _candidates(self) -> Genomes:
        """Return a candidate for each member, (population, genome_size)."""

    def _tell(self, genomes: Genomes, fitness: Fitness) -> None:
        if not len(self._members):
            self._members, self._fitness = genomes.copy(), fitness.copy()
            return
        better = (fitness > self._fitness) | (np.isnan(self._fitness) & ~np.isnan(fitness))
        self._members[better] = genomes[better]
        self._fitness = np.where(better, fitness, self._fitness)
