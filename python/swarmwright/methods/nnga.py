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
from swarmwright.controllers.networks import NodeNetwork
from swarmwright.methods._base import MethodOptions
from swarmwright.methods.search import KeepsMembers

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


_MOST_MEMBERS = 10_000_000
"""Of a population."""


@dataclass(frozen=True)
class Shares:
    """How many members of the next population come about in each way."""

    elite: int
    """The best, which stay."""
    random: int
    """Others that stay, chosen at random."""
    mutate: int
    """Mutated copies."""
    crossover: int
    """Children of two members."""
    renew: int
    """New random genomes."""

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
    population: int = Field(default=50, ge=2, le=_MOST_MEMBERS)
    """Members of a population."""
    populations: int = Field(default=1, ge=1, le=10_000)
    """Populations, each with as many members, that evolve side by side."""
    exchange_interval: int = Field(default=10, ge=0, le=1_000_000_000)
    """How often populations exchange genes: in the generations 1, 1 + exchange_interval, 1 + 2 *
    exchange_interval, ..; 0: never."""
    exchange: float = Field(default=1.0, ge=0, le=1)
    """How much they exchange then: the share of crossovers whose father comes from any of the populations,
    drawn at random, the mother's own among them."""
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
        if self.operation == "steady_state" and self.populations > 1:
            raise ValueError("in steady state there is one population; leave populations out")
        shares = self.shares()
        if shares.survivors < 1:
            raise ValueError(
                "no candidate survives: elite or random must be a larger share, or the population larger"
            )
        if shares.new < 1:
            raise ValueError(
                "no new candidate is made: mutate, crossover or renew must be a larger share, "
                f"or the population larger than {self.population}"
            )
        if self.populations * self.population > _MOST_MEMBERS:
            raise ValueError(
                f"{self.populations} populations of {self.population} have more than {_MOST_MEMBERS} members"
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


class Nnga(KeepsMembers):
    """Survival, mutation, crossover and renewal, in shares of the population.

    From the ranked population a generation is made so: the elite stays; some others stay, drawn at random;
    copies of members that stay are mutated; pairs of them are crossed, where the father is the one most
    different from the mother among several drawn; and some members are renewed at random. Members that stay
    keep their fitness and are not evaluated again, so with the defaults 37 of 50 are evaluated in each
    generation after the first. A child that is the same as a member is crossed anew, at most 100 times a
    generation; then random members take the places left.

    Several populations evolve side by side, each ranked by itself; every now and then a crossover may take
    its father from another one.

    In steady state, which FREVO does not have, there are no survivors: one child after the other takes the
    place of the worst member, see `SteadyMembers`; the shares elite and random do not count.

    Source: NNGA of FREVO (Fehervari, Pfandler; Components/Methods/nnga 1.51). It differs in three points.
    FREVO draws the random survivors by a folded triangle distribution that it notes itself to be wrong: the
    worst member can never be drawn, the best remaining one only half as often as meant, and each draw moves
    another one far down the ranks. Here the intended distribution is used: of m remaining members in ranked
    order, the k-th from the top (k = 0, 1, ..) is drawn with probability proportional to m - k. Members whose
    evaluation failed never stay; random members take their places. And FREVO makes one population's children
    after the other's, so that those made first take fathers from the best of populations that have not chosen
    yet who stays; here all populations choose first, and fathers are always members that stay.
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
        """Number of evaluations of the whole run, when nothing fails."""
        if self._one_by_one:
            return self.options.population * self.options.generations
        new = self.options.population + (self.options.generations - 1) * self.options.shares().new
        return self.options.populations * new

    @property
    def population_fitness(self) -> Fitness:
        """Fitness of all members of all populations, survivors and new ones."""
        return self._steady.fitness.copy() if self._one_by_one else super().population_fitness

    @property
    def generation_size(self) -> int:
        """Members."""
        return self.options.population

    @property
    def ahead(self) -> bool:
        """Whether the engine may ask and tell the search by itself: it has the operators, too."""
        return super().ahead and not self._one_by_one and self._native is not None

    def kept(self) -> Genomes:
        """Return the survivors of all populations."""
        return (
            np.empty((0, self.representation.genome_size), np.float32) if self._one_by_one else super().kept()
        )

    @property
    def _one_by_one(self) -> bool:
        return self.options.operation == "steady_state"

    @property
    def _native(self) -> _engine.NodeNetwork | None:
        """The representation's operators, where they are the engine's."""
        representation = self.representation
        return representation.operators if isinstance(representation, NodeNetwork) else None

    def _begin(self) -> _engine.Search:
        options, shares = self.options, self.options.shares()
        first = self.initials(range(options.populations * options.population))
        return _engine.Search.genetic(
            self.seed,
            self.kind,
            first=np.ascontiguousarray(first, dtype=np.float32),
            operators=self._native or self.representation,
            populations=options.populations,
            shares=(shares.elite, shares.random, shares.mutate, shares.crossover),
            severity=options.severity,
            probability=options.probability,
            partners=options.partners,
            exchange_interval=options.exchange_interval,
            exchange=options.exchange,
        )

    def _next(self, index: int) -> Genome:
        child = None
        if index >= self.options.population:
            child = self._steady.child(lambda purpose: self.streams_of(purpose, index))
        return self.initial_of(index) if child is None else child

    def _told(self, index: int, genome: Genome, fitness: float) -> None:  # noqa: ARG002 - members have no order
        self._steady.join(genome, fitness)
