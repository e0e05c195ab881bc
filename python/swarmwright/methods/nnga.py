"""NNGA: FREVO's genetic algorithm for neural networks."""

import math
from dataclasses import dataclass
from itertools import accumulate
from typing import ClassVar, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from swarmwright import _engine
from swarmwright.core.random_numbers import Stream, Streams
from swarmwright.methods._base import Method, MethodOptions
from swarmwright.methods._nnga_steady import SteadyMembers
from swarmwright.representations._base import Representation
from swarmwright.typing import Fitness, Genome, Genomes

_TRIALS = 100  # crossovers a generation may repeat because the child exists already
_MOST_MEMBERS = 10_000_000


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


class _Population:
    """Members, of which the first `count` are there, and their fitness; children: new ones not known yet."""

    def __init__(self, size: int, genes: int) -> None:
        self._genomes: Genomes = np.empty((size, genes), dtype=np.float32)
        self._fitness: Fitness = np.empty(size)
        self.count = 0
        self.children = size

    @property
    def genomes(self) -> Genomes:
        """Genomes of the members."""
        return self._genomes[: self.count]

    @property
    def fitness(self) -> Fitness:
        """Fitness of the members."""
        return self._fitness[: self.count]

    def keep(self, members: NDArray[np.int64]) -> None:
        """Drop all other members."""
        genomes, fitness = self.genomes[members], self.fitness[members]
        self.count = 0
        self.join(genomes, fitness)

    def join(self, genomes: Genomes, fitness: Fitness) -> None:
        """Let the children be members."""
        places = slice(self.count, self.count + len(genomes))
        self._genomes[places], self._fitness[places] = genomes, fitness
        self.count = places.stop


class Nnga(Method):
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
    keeps_members = True
    start_as = "members"

    def __init__(self, options: NngaOptions, representation: Representation, *, seed: int) -> None:
        super().__init__(options, representation, seed=seed)
        self._shares = options.shares()
        self._populations = [
            _Population(options.population, representation.genome_size) for _ in range(options.populations)
        ]
        self._steady = SteadyMembers(options, representation)

    @property
    def budget(self) -> int:
        """Number of evaluations of the whole run, when nothing fails."""
        if self.options.operation == "steady_state":
            return self.options.population * self.options.generations
        new = self.options.population + (self.options.generations - 1) * self._shares.new
        return self.options.populations * new

    @property
    def population_fitness(self) -> Fitness:
        """Fitness of all members of all populations, survivors and new ones."""
        if self.options.operation == "steady_state":
            return self._steady.fitness.copy()
        return np.concatenate([population.fitness for population in self._populations])

    @property
    def generation_size(self) -> int:
        """Members."""
        return self.options.population

    def kept(self) -> Genomes:
        """Return the survivors of all populations."""
        return np.concatenate([population.genomes for population in self._populations])

    def _rescore(self, fitness: Fitness) -> None:
        first = 0
        for population in self._populations:
            end = first + population.count
            population.fitness[:] = fitness[first:end]
            first = end

    def _ask(self) -> Genomes:
        if self.generation == 0:
            return self.initials(range(self.options.populations * self.options.population))
        for number, population in enumerate(self._populations):
            population.keep(self._survivors(population.fitness, self.stream("nnga.survive", number)))
        parents = _Parents.of(self._populations)
        children: list[Genomes] = []
        first = 0
        for number, population in enumerate(self._populations):
            made = self._children(parents, number, first)
            population.children = sum(map(len, made))
            first += population.children
            children += made
        return np.concatenate(children)

    def _tell(self, genomes: Genomes, fitness: Fitness) -> None:
        first = 0
        for population in self._populations:
            end = first + population.children
            population.join(genomes[first:end], fitness[first:end])
            first = end

    def _next(self, index: int) -> Genome:
        child = None
        if index >= self.options.population:
            child = self._steady.child(lambda purpose: self.streams_of(purpose, index))
        return self.initial_of(index) if child is None else child

    def _told(self, index: int, genome: Genome, fitness: float) -> None:  # noqa: ARG002 - members have no order
        self._steady.join(genome, fitness)

    def _survivors(self, fitness: Fitness, stream: Stream) -> NDArray[np.int64]:
        """Return the indices of those that stay: elite, then random ones."""
        return _engine.survivors(fitness, self._shares.elite, self._shares.random, stream)

    def _children(self, parents: "_Parents", number: int, first: int) -> list[Genomes]:
        """Return the new members of a population, in parts; `first`: the index of its first among all new."""
        survivors = parents.of_population(number)
        children: list[Genomes] = []
        if len(survivors):
            children.append(self._mutated(survivors, first))
            children += self._crossed(parents, number, [survivors, *children])
        made = sum(map(len, children))
        missing = self.options.population - len(survivors) - made
        return [*children, self.initials(range(first + made, first + made + missing))]

    def _mutated(self, survivors: Genomes, first: int) -> Genomes:
        streams = self.streams("nnga.mutate", range(first, first + self._shares.mutate))
        chosen = streams.integers(len(survivors), 1)[:, 0]
        severity, probability = self.options.severity, self.options.probability
        return self.representation.mutations(
            survivors[chosen], streams, severity=severity, probability=probability
        )

    def _crossed(self, parents: "_Parents", number: int, known: list[Genomes]) -> list[Genomes]:
        """Return children of two, all different from each other and those known."""
        wanted, most = self._shares.crossover, self._shares.crossover + _TRIALS
        found: list[Genomes] = []
        missing, trial = wanted, 0
        while missing and trial < most:
            last = min(trial + missing, most)
            children = self._crossovers(parents, number, range(number * most + trial, number * most + last))
            new = _engine.distinct(children, known + found)
            found.append(children if len(new) == len(children) else children[new])
            missing, trial = missing - len(new), last
        return found

    def _crossovers(self, parents: "_Parents", number: int, addresses: range) -> Genomes:
        """Return a child for each address."""
        streams = self.streams("nnga.crossover", addresses)
        first, count = int(parents.first[number]), int(parents.count[number])
        mothers = first + streams.integers(count, 1)[:, 0]
        partners = self._partners(parents, number, addresses, streams)
        return self.representation.matings(parents.genomes, mothers, partners, streams)

    def _partners(
        self, parents: "_Parents", number: int, addresses: range, streams: Streams
    ) -> NDArray[np.int64]:
        """Return the indices of those that each father is chosen from."""
        options = self.options
        interval = options.exchange_interval
        if options.populations == 1 or interval == 0 or (self.generation - 1) % interval:
            count = int(parents.count[number])
            return int(parents.first[number]) + streams.integers(count, options.partners)
        peopled = np.flatnonzero(parents.count)
        exchange = self.streams("nnga.exchange", addresses)
        drawn = peopled[exchange.integers(len(peopled), 1)[:, 0]]
        abroad = exchange.units(1)[:, 0] < options.exchange
        homes = np.where(abroad, drawn, number)
        drawn = streams.integers(parents.count[homes], options.partners)
        mine: NDArray[np.int64] = parents.first[homes][:, None] + drawn
        return mine


@dataclass(frozen=True)
class _Parents:
    """The survivors of all populations in one array; first and count: where those of each population are."""

    genomes: Genomes
    first: NDArray[np.int64]
    count: NDArray[np.int64]

    @classmethod
    def of(cls, populations: list[_Population]) -> Self:
        """Return the members of populations."""
        counts = [population.count for population in populations]
        members = [population.genomes for population in populations]
        genomes = members[0] if len(members) == 1 else np.concatenate(members)
        first = list(accumulate(counts, initial=0))[:-1]
        return cls(genomes, np.array(first, dtype=np.int64), np.array(counts, dtype=np.int64))

    def of_population(self, number: int) -> Genomes:
        """Return the survivors of one population."""
        return self.genomes[self.first[number] :][: self.count[number]]
