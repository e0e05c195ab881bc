"""NNGA in steady state: one child after the other."""

from collections import Counter
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from swarmwright import _engine
from swarmwright.common.random_numbers import Streams
from swarmwright.common.typing import Fitness, Genome, Genomes
from swarmwright.controllers import Representation

if TYPE_CHECKING:
    from swarmwright.methods.nnga import NngaOptions

_TRIALS = 100  # crossovers that are tried before a random genome takes the place


class SteadyMembers:
    """Members that are replaced one by one.

    A child is mutated, crossed or random, in the ratio of these three shares. Parents are drawn from all
    members, the k-th best of m (k = 0, 1, ..) with probability proportional to m - k; the father is the one
    most different from the mother among several drawn. The child takes the place of the worst member, be it
    better or not, unless its evaluation failed; so the best is never lost.

    Args:
        options: of the method.
        representation: gives genomes their operators.
    """

    def __init__(self, options: "NngaOptions", representation: Representation) -> None:
        self._options = options
        self._representation = representation
        self._genomes: Genomes = np.empty((0, representation.genome_size), dtype=np.float32)
        self._values: Fitness = np.full(options.population, np.nan)
        self._ranks = _engine.Ranks(options.population)
        self._known: Counter[bytes] = Counter()
        self._count = 0

    @property
    def fitness(self) -> Fitness:
        """Fitness of the members there are, NaN of those that failed."""
        return self._values[: self._count]

    def join(self, genome: Genome, fitness: float) -> None:
        """Take in a genome whose fitness is known, NaN if it failed."""
        if self._count < self._options.population:
            if self._count == 0:
                self._genomes = np.empty((self._options.population, len(genome)), dtype=np.float32)
            place = self._count
            self._count += 1
        elif np.isnan(fitness):
            return
        else:
            place = self._ranks.worst
            self._forget(self._genomes[place].tobytes())
        self._genomes[place], self._values[place] = genome, fitness
        self._known[self._genomes[place].tobytes()] += 1
        self._ranks.set(place, fitness)

    def _forget(self, member: bytes) -> None:
        self._known[member] -= 1
        if not self._known[member]:
            del self._known[member]

    def child(self, streams: Callable[[str], Streams]) -> Genome | None:
        """Return a new genome; None where a random one is to be taken. streams: one stream by purpose."""
        options = self._options
        total = options.mutate + options.crossover + options.renew
        share = float(streams("nnga.way").units(1)[0, 0]) * total
        if self._ranks.worked == 0 or share >= options.mutate + options.crossover:
            return None
        if share >= options.mutate:
            return self._crossed(streams)
        parent = self._ranks.draw(streams("nnga.parent")[0], 1)
        children = self._representation.mutations(
            self._genomes[parent],
            streams("nnga.mutate"),
            severity=options.severity,
            probability=options.probability,
        )
        return np.asarray(children[0])

    def _crossed(self, streams: Callable[[str], Streams]) -> Genome | None:
        """Return a child of two that is not a member yet; None when none is found."""
        parents, varying = streams("nnga.parent")[0], streams("nnga.crossover")[0]
        for _ in range(_TRIALS):
            mother, *others = self._ranks.draw(parents, 1 + self._options.partners)
            distances = self._representation.distances_among(
                self._genomes, np.array([mother]), np.array([others])
            )
            father = others[int(distances.argmax())]
            child = self._representation.crossover(self._genomes[mother], self._genomes[father], varying)
            if child.tobytes() not in self._known:
                return child
        return None
