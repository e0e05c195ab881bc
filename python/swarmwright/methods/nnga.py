"""NNGA: FREVO's genetic algorithm for neural networks."""

import math
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from swarmwright import _engine
from swarmwright.common.arrays import Fitness, Genome, Genomes
from swarmwright.common.random_numbers import Streams
from swarmwright.controllers import Representation
from swarmwright.methods._base import MethodOptions
from swarmwright.methods.search import KeepsMembers

_TRIALS = 100  # crossovers to try before a random genome is used


class SteadyMembers:
    """A population whose members are replaced one by one.

    A child is mutated, crossed or random, in the ratio of these three shares. Parents are drawn from all
    members, the k-th best of m (k = 0, 1, ..) with probability proportional to m - k; the father is the one
    most different from the mother among several draws. Unless its evaluation failed, the child replaces the
    worst member, whether it is better or not; the best is never lost.

    Args:
        options: options of the method.
        representation: provides the operators on genomes.
    """

    def __init__(self, options: "NngaOptions", representation: Representation) -> None:
        self._options = options
        self._representation = representation
        self._genomes: Genomes = np.empty((0, representation.genome_size), dtype=np.float32)
        self._values: Fitness = np.full(options.population, np.nan)
        self._ranks = _engine.Ranks(options.population)
        self._counts: Counter[bytes] = Counter()
        self._count = 0

    @property
    def fitness(self) -> Fitness:
        """Fitness of the current members, NaN for failed ones."""
        return self._values[: self._count]

    def add(self, genome: Genome, fitness: float) -> None:
        """Add a genome with its fitness, NaN if it failed."""
        if self._count < self._options.population:
            if self._count == 0:
                self._genomes = np.empty((self._options.population, len(genome)), dtype=np.float32)
            slot = self._count
            self._count += 1
        elif np.isnan(fitness):
            return
        else:
            slot = self._ranks.worst
            self._forget(self._genomes[slot].tobytes())
        self._genomes[slot], self._values[slot] = genome, fitness
        self._counts[self._genomes[slot].tobytes()] += 1
        self._ranks.set(slot, fitness)

    def _forget(self, member: bytes) -> None:
        self._counts[member] -= 1
        if not self._counts[member]:
            del self._counts[member]

    def create_child(self, streams: Callable[[str], Streams]) -> Genome | None:
        """Create a genome; None for a random one. streams: returns the streams of a purpose."""
        options = self._options
        total = options.mutate + options.crossover + options.renew
        share = float(streams("nnga.way").units(1)[0, 0]) * total
        if self._ranks.worked == 0 or share >= options.mutate + options.crossover:
            return None
        if share >= options.mutate:
            return self._cross(streams)
        parent = self._ranks.draw(streams("nnga.parent")[0], 1)
        children = self._representation.mutations(
            self._genomes[parent],
            streams("nnga.mutate"),
            severity=options.severity,
            probability=options.probability,
        )
        return np.asarray(children[0])

    def _cross(self, streams: Callable[[str], Streams]) -> Genome | None:
        """Create a child of two members that is not yet a member; None after too many trials."""
        parents, varying = streams("nnga.parent")[0], streams("nnga.crossover")[0]
        for _ in range(_TRIALS):
            mother, *fathers = self._ranks.draw(parents, 1 + self._options.partners)
            distances = self._representation.distances_among(
                self._genomes, np.array([mother]), np.array([fathers])
            )
            father = fathers[int(distances.argmax())]
            child = self._representation.crossover(self._genomes[mother], self._genomes[father], varying)
            if child.tobytes() not in self._counts:
                return child
        return None


_MOST_MEMBERS = 10_000_000
"""Upper limit of members in a population."""


@dataclass(frozen=True)
class Shares:
    """Numbers of members of the next population by origin."""

    elite: int
    """The best, which survive."""
    random: int
    """Other survivors, chosen at random."""
    mutate: int
    """Mutated copies."""
    crossover: int
    """Children of two members."""
    renew: int
    """New random genomes."""

    @property
    def survivors(self) -> int:
        """Number of survivors."""
        return self.elite + self.random

    @property
    def new(self) -> int:
        """Number of new members, which are evaluated."""
        return self.mutate + self.crossover + self.renew


class GeneticOptions(MethodOptions):
    """Options of genetic algorithms, with FREVO's defaults. The five shares of the population sum to 1."""

    population: int = Field(default=50, ge=2, le=_MOST_MEMBERS)
    """Members of each population."""
    islands: int = Field(default=1, ge=1, le=10_000)
    """Number of islands, populations that evolve in parallel."""
    exchange_interval: int = Field(default=10, ge=0, le=1_000_000_000)
    """Generations between exchanges of genes among populations, beginning with generation 1; 0 for never."""
    exchange: float = Field(default=1.0, ge=0, le=1)
    """Share of crossovers in these generations whose father comes from a random population (possibly the
    same)."""
    elite: float = Field(default=0.15, ge=0, le=1)
    """Share of best members that survive, plus the remainder of rounding."""
    random: float = Field(default=0.10, ge=0, le=1)
    """Share of other survivors, drawn at random by rank."""
    mutate: float = Field(default=0.40, ge=0, le=1)
    """Share of mutated copies of survivors."""
    crossover: float = Field(default=0.30, ge=0, le=1)
    """Share of children of two survivors."""
    renew: float = Field(default=0.05, ge=0, le=1)
    """Share of new random members."""
    severity: float = Field(default=0.3, ge=0, le=1000)
    """Size of mutations, relative to the initial range of weights and biases."""
    probability: float = Field(default=1.0, ge=0, le=1)
    """Probability that a mutation changes a gene."""
    partners: int = Field(default=11, ge=1, le=10_000)
    """Partners drawn per crossover; the one most different from the mother is used."""

    @model_validator(mode="after")
    def _fits(self) -> Self:
        total = math.fsum([self.elite, self.random, self.mutate, self.crossover, self.renew])
        if abs(total - 1) > 1e-6:
            raise ValueError(f"elite, random, mutate, crossover and renew must add up to 1, not {total:.6g}")
        if self.operation == "steady_state" and self.islands > 1:
            raise ValueError("steady state allows only one population; leave islands out")
        shares = self.shares()
        if shares.survivors < 1:
            raise ValueError("no candidate survives; increase elite, random or the population")
        if shares.new < 1:
            raise ValueError(
                "no new candidates are created; increase mutate, crossover, renew or the population above "
                f"{self.population}"
            )
        if self.islands * self.population > _MOST_MEMBERS:
            raise ValueError(
                f"{self.islands} populations of {self.population} have more than {_MOST_MEMBERS} members"
            )
        return self

    def shares(self) -> Shares:
        """Return the numbers of members: shares rounded down, the remainder to the elite."""
        # 1e-6 turns 0.29 * 100 = 28.999... into 29.
        random, mutate, crossover, renew = (
            math.floor(self.population * share + 1e-6)
            for share in (self.random, self.mutate, self.crossover, self.renew)
        )
        return Shares(self.population - random - mutate - crossover - renew, random, mutate, crossover, renew)


class NngaOptions(GeneticOptions):
    """FREVO's NNGA with its defaults. The five shares of the population sum to 1."""

    kind: Literal["nnga"] = "nnga"


class Genetic(KeepsMembers):
    """A genetic algorithm in the engine, with the shares of its options."""

    options: GeneticOptions

    @property
    def budget(self) -> int:
        """Number of evaluations of a run without failures."""
        new = self.options.population + (self.options.generations - 1) * self.options.shares().new
        return self.options.islands * new

    def _begin(self) -> _engine.Search:
        options, shares = self.options, self.options.shares()
        first = self.initials(range(options.islands * options.population))
        return _engine.Search.genetic(
            self.seed,
            self.kind,
            first=np.ascontiguousarray(first, dtype=np.float32),
            operators=self.representation.operators or self.representation,
            populations=options.islands,
            shares=(shares.elite, shares.random, shares.mutate, shares.crossover),
            severity=options.severity,
            probability=options.probability,
            partners=options.partners,
            exchange_interval=options.exchange_interval,
            exchange=options.exchange,
        )


class Nnga(Genetic):
    """A genetic algorithm with survival, mutation, crossover and renewal in shares of the population.

    Each generation, the elite and some random other members survive. Copies of survivors are mutated; pairs
    of survivors are crossed, where the father is the one most different from the mother among several draws;
    and some members are renewed at random. Survivors keep their fitness and are not evaluated again, so with
    the defaults, 37 of 50 members are evaluated in each generation after the first. A child equal to a member
    is crossed anew, at most 100 times per generation; then random members fill the remaining positions.

    Several populations evolve in parallel, each with its own ranking; at intervals, fathers may come from
    other populations.

    In steady state, which FREVO lacks, each child replaces the worst member, see `SteadyMembers`; the shares
    elite and random have no effect.

    Source: NNGA of FREVO (Fehervari, Pfandler; Components/Methods/nnga 1.51), with three differences. FREVO
    draws the random survivors by a folded triangle distribution that its own comments call wrong: the worst
    member is never drawn, the best remaining one half as often as intended, and each draw moves another one
    far down the ranks. Here the intended distribution is used: of m remaining members in ranked order, the
    k-th from the top (k = 0, 1, ..) is drawn with probability proportional to m - k. Failed members never
    survive; random members replace them. FREVO creates the children of one population after the other, so
    that early ones take fathers from populations without survivor selection; here all populations select
    first, and fathers are always survivors.
    """

    kind: ClassVar[str] = "nnga"
    options_model = NngaOptions
    options: NngaOptions
    steady_state = True

    def __init__(self, options: NngaOptions, representation: Representation, *, seed: int) -> None:
        super().__init__(options, representation, seed=seed)
        self._steady = SteadyMembers(options, representation)

    @property
    def budget(self) -> int:
        """Number of evaluations of a run without failures."""
        if self._is_steady_state:
            return self.options.population * self.options.generations
        return super().budget

    @property
    def population_fitness(self) -> Fitness:
        """Fitness of all members of all populations."""
        return self._steady.fitness.copy() if self._is_steady_state else super().population_fitness

    @property
    def generation_size(self) -> int:
        """Number of members."""
        return self.options.population

    @property
    def ahead(self) -> bool:
        """Whether the engine may run the search by itself, including the operators."""
        return super().ahead and not self._is_steady_state and self.representation.operators is not None

    def survivors(self) -> Genomes:
        """Return the survivors of all populations."""
        return (
            np.empty((0, self.representation.genome_size), np.float32)
            if self._is_steady_state
            else super().survivors()
        )

    @property
    def _is_steady_state(self) -> bool:
        return self.options.operation == "steady_state"

    def _ask_next(self, index: int) -> Genome:
        child = None
        if index >= self.options.population:
            child = self._steady.create_child(lambda purpose: self.streams_of(purpose, index))
        return self.initial_of(index) if child is None else child

    def _tell_next(self, index: int, genome: Genome, fitness: float) -> None:  # noqa: ARG002 - members have no order
        self._steady.add(genome, fitness)
