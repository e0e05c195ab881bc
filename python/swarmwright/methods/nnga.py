"""NNGA: FREVO's genetic algorithm for neural networks."""

import math
from dataclasses import dataclass
from typing import ClassVar, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from swarmwright.methods._base import Method, MethodOptions, stacked
from swarmwright.rankings._base import Fitness, best_first
from swarmwright.representations._base import Genome, Genomes, Representation

_TRIALS = 100  # crossovers a generation may repeat because the child exists already


@dataclass(frozen=True)
class Shares:
    """How many members of the next population come about in each way."""

    elite: int
    random: int
    mutate: int
    crossover: int
    renew: int

    @property
    def survivors(self) -> int:
        """Members that stay."""
        return self.elite + self.random

    @property
    def new(self) -> int:
        """Members that come new and are evaluated."""
        return self.mutate + self.crossover + self.renew


class NngaOptions(MethodOptions):
    """FREVO's NNGA with its defaults. The five shares of the population add up to 1."""

    kind: Literal["nnga"] = "nnga"
    population: int = Field(default=50, ge=2, le=10_000_000)
    """Members of the population."""
    elite: float = Field(default=0.15, ge=0, le=1)
    """Share of best members that stay as they are. What rounding leaves over is elite, too."""
    random: float = Field(default=0.10, ge=0, le=1)
    """Share of other members that stay, drawn at random, better-ranked ones more often."""
    mutate: float = Field(default=0.40, ge=0, le=1)
    """Share of mutated copies of those that stay."""
    crossover: float = Field(default=0.30, ge=0, le=1)
    """Share of children of two that stay."""
    renew: float = Field(default=0.05, ge=0, le=1)
    """Share of new random members."""
    severity: float = Field(default=0.3, ge=0, le=1000)
    """Size of mutations, as a share of the initial range of weights and biases."""
    probability: float = Field(default=1.0, ge=0, le=1)
    """Probability of a gene to be changed by a mutation."""
    partners: int = Field(default=11, ge=1, le=10_000)
    """Partners drawn for each crossover; the one most different from the mother is taken."""

    @model_validator(mode="after")
    def _fits(self) -> Self:
        total = math.fsum([self.elite, self.random, self.mutate, self.crossover, self.renew])
        if abs(total - 1) > 1e-6:
            raise ValueError(f"elite, random, mutate, crossover and renew must add up to 1, not {total:.6g}")
        shares = self.shares()
        if shares.survivors < 1:
            raise ValueError("nobody stays: elite or random must be a larger share, or the population larger")
        if shares.new < 1:
            raise ValueError(
                "nobody new comes: mutate, crossover or renew must be a larger share, "
                f"or the population larger than {self.population}"
            )
        return self

    def shares(self) -> Shares:
        """Return whole numbers: each share rounded down, the rest to the elite."""
        # The tiny summand keeps 0.29 * 100 = 28.999... at 29.
        random, mutate, crossover, renew = (
            math.floor(self.population * share + 1e-6)
            for share in (self.random, self.mutate, self.crossover, self.renew)
        )
        return Shares(self.population - random - mutate - crossover - renew, random, mutate, crossover, renew)


class Nnga(Method):
    """Survival, mutation, crossover and renewal, in shares of the population.

    From the ranked population a generation is made so: the elite stays; some others stay, drawn at random;
    copies of members that stay are mutated; pairs of them are crossed, where the father is the one most
    different from the mother among several drawn; and some members are renewed at random. Members that stay
    keep their fitness and are not evaluated again, so with the defaults 37 of 50 are evaluated in each
    generation after the first. A child that is the same as a member is crossed anew, at most 100 times a
    generation; then random members take the places left.

    Source: NNGA of FREVO (Fehervari, Pfandler; Components/Methods/nnga 1.51). It differs in two points. FREVO
    draws the random survivors by a folded triangle distribution that it notes itself to be wrong: the worst
    member can never be drawn, the best remaining one only half as often as meant, and each draw moves another
    one far down the ranks. Here the intended distribution is used: of m remaining members in ranked order,
    the k-th from the top (k = 0, 1, ..) is drawn with probability proportional to m - k. And members whose
    evaluation failed never stay; random members take their places.
    """

    kind: ClassVar[str] = "nnga"
    options_model = NngaOptions
    options: NngaOptions
    keeps_members = True

    def __init__(self, options: NngaOptions, representation: Representation, *, seed: int) -> None:
        super().__init__(options, representation, seed=seed)
        self._shares = options.shares()
        self._genomes: Genomes = np.empty((0, representation.genome_size), dtype=np.float32)
        self._fitness: Fitness = np.empty(0)

    @property
    def budget(self) -> int:
        """Number of evaluations of the whole run, when nothing fails."""
        return self.options.population + (self.options.generations - 1) * self._shares.new

    @property
    def population_fitness(self) -> Fitness:
        """Fitness of all members, survivors and new ones."""
        return self._fitness

    def kept(self) -> Genomes:
        """Return the survivors."""
        return self._genomes.copy()

    def _rescore(self, fitness: Fitness) -> None:
        self._fitness = fitness

    def _ask(self) -> Genomes:
        if self.generation == 0:
            return stacked([self.initial(candidate) for candidate in range(self.options.population)])
        self._keep(self._survivors())
        return stacked(self._children(list(self._genomes)))

    def _tell(self, genomes: Genomes, fitness: Fitness) -> None:
        self._genomes = np.concatenate([self._genomes, genomes])
        self._fitness = np.concatenate([self._fitness, fitness])

    def _keep(self, members: list[int]) -> None:
        self._genomes = self._genomes[members]
        self._fitness = self._fitness[members]

    def _survivors(self) -> list[int]:
        """Return the indices of those that stay: elite, then random ones."""
        ranked = [int(index) for index in best_first(self._fitness) if not np.isnan(self._fitness[index])]
        staying, others = ranked[: self._shares.elite], ranked[self._shares.elite :]
        stream = self.stream("nnga.survive")
        for _ in range(min(self._shares.random, len(others))):
            staying.append(
                others.pop(_triangular(stream.integer(len(others) * (len(others) + 1) // 2), len(others)))
            )
        return staying

    def _children(self, survivors: list[Genome]) -> list[Genome]:
        """Return the new members of this generation."""
        children: list[Genome] = []
        if survivors:
            children += [self._mutated(survivors, index) for index in range(self._shares.mutate)]
            children += self._crossed(survivors, children)
        while len(survivors) + len(children) < self.options.population:
            children.append(self.initial(len(children)))
        return children

    def _mutated(self, survivors: list[Genome], index: int) -> Genome:
        stream = self.stream("nnga.mutate", index)
        parent = survivors[stream.integer(len(survivors))]
        severity, probability = self.options.severity, self.options.probability
        return self.representation.mutate(parent, stream, severity=severity, probability=probability)

    def _crossed(self, survivors: list[Genome], others: list[Genome]) -> list[Genome]:
        known = {member.tobytes() for member in (*survivors, *others)}
        children: list[Genome] = []
        trial = 0
        while len(children) < self._shares.crossover and trial < self._shares.crossover + _TRIALS:
            stream = self.stream("nnga.crossover", trial)
            trial += 1
            chosen, *partners = stream.integers(len(survivors), 1 + self.options.partners)
            mother = survivors[chosen]
            distances = self.representation.distances(mother, self._genomes[partners])
            father = survivors[partners[int(np.argmax(distances))]]
            child = self.representation.crossover(mother, father, stream)
            if child.tobytes() not in known:
                known.add(child.tobytes())
                children.append(child)
        return children


def _triangular(ticket: int, members: int) -> int:
    """Return k for a ticket in 0 .. members * (members + 1) / 2 - 1, of which k holds members - k."""
    # Tickets from the end: the last holds one, the last but one two, ... so k counts triangular numbers from
    # there.
    left = members * (members + 1) // 2 - 1 - ticket
    row = (math.isqrt(8 * left + 1) - 1) // 2
    return members - 1 - row
