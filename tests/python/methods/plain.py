"""The methods nnga and cea2d in plain Python, member by member: what the engine computes must be the same."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from swarmwright.common.arrays import Fitness, Genome, Genomes, best_first
from swarmwright.common.random_numbers import Stream, Streams
from swarmwright.controllers import Representation
from swarmwright.methods.cea2d import Cea2d
from swarmwright.methods.nnga import Nnga, NngaOptions, SteadyMembers

MANY = ("initials", "mutations", "crossovers", "matings", "distances_among")


def plain(subject: Representation) -> Representation:
    """The same representation, with operators of one genome after the other."""
    loops = {name: getattr(Representation, name) for name in MANY}
    kind: Any = type("Plain", (type(subject),), loops)
    made: Representation = kind(subject.options, sensors=subject.sensors, actuators=subject.actuators)
    return made


def triangular(ticket: int, members: int) -> int:
    """The k-th of m members has m - k tickets."""
    for rank in range(members):
        if ticket < members - rank:
            return rank
        ticket -= members - rank
    raise AssertionError


def drawn(stream: Stream, members: int) -> int:
    return triangular(stream.integer(members * (members + 1) // 2), members)


class PlainNnga(Nnga):
    """Survivors are taken out of a list, children are known by a set, and each is made by itself."""

    def __init__(self, options: NngaOptions, representation: Representation, *, seed: int) -> None:
        super().__init__(options, representation, seed=seed)
        self._members: list[list[tuple[Genome, float]]] = [[] for _ in range(options.islands)]

    @property
    def population_fitness(self) -> Fitness:
        if self.options.operation == "steady_state":
            return super().population_fitness
        return np.array([fitness for members in self._members for _, fitness in members])

    def survivors(self) -> Genomes:
        return self._rows([genome for members in self._members for genome, _ in members])

    def _rescore(self, fitness: Fitness) -> None:
        values = iter(fitness.tolist())
        self._members = [[(genome, next(values)) for genome, _ in members] for members in self._members]

    def _rows(self, genomes: list[Genome]) -> Genomes:
        return np.array(genomes, dtype=np.float32).reshape(len(genomes), self.representation.genome_size)

    def _ask(self) -> Genomes:
        every = range(len(self._members))
        if self.generation > 0:
            self._members = [self._staying(number) for number in every]
        made: list[Genome] = []
        self._places: list[int] = []
        for number in every:
            made += self._new_members(number, len(made))
            self._places += [number] * (len(made) - len(self._places))
        return self._rows(made)

    def _tell(self, genomes: Genomes, fitness: Fitness) -> None:
        for number, genome, value in zip(self._places, genomes, fitness.tolist(), strict=True):
            self._members[number].append((genome, value))

    def _staying(self, number: int) -> list[tuple[Genome, float]]:
        """The elite, and some others."""
        members, stream = self._members[number], self.stream("nnga.survive", number)
        fitness = np.array([value for _, value in members])
        ranked = best_first(fitness)[: int(np.isfinite(fitness).sum())].tolist()
        shares = self.options.shares()
        staying, others = ranked[: shares.elite], ranked[shares.elite :]
        for _ in range(min(shares.random, len(others))):
            staying.append(others.pop(drawn(stream, len(others))))
        return [members[one] for one in staying]

    def _new_members(self, number: int, first: int) -> list[Genome]:
        """The new members of a population; first: the index of its first among all."""
        options, operators = self.options, self.representation
        staying = [genome for genome, _ in self._members[number]]
        made: list[Genome] = []
        for index in range(options.shares().mutate if staying else 0):
            stream = self.stream("nnga.mutate", first + index)
            parent = staying[stream.integer(len(staying))]
            made.append(
                operators.mutate(parent, stream, severity=options.severity, probability=options.probability)
            )
        made += self._crossed(number, [*staying, *made]) if staying else []
        renewed = range(first + len(made), first + options.population - len(staying))
        return [*made, *self.initials(renewed)]

    def _crossed(self, number: int, known: list[Genome]) -> list[Genome]:
        """Children of two, all different from each other and from those known."""
        seen = {genome.tobytes() for genome in known}
        wanted = self.options.shares().crossover
        most = wanted + 100
        found: list[Genome] = []
        for trial in range(most):
            if len(found) < wanted:
                child = self._crossover(number, number * most + trial)
                if child.tobytes() not in seen:
                    seen.add(child.tobytes())
                    found.append(child)
        return found

    def _crossover(self, number: int, address: int) -> Genome:
        options, stream = self.options, self.stream("nnga.crossover", address)
        genomes = [[genome for genome, _ in members] for members in self._members]
        mother, home = genomes[number][stream.integer(len(genomes[number]))], number
        interval = options.exchange_interval
        if options.islands > 1 and interval and (self.generation - 1) % interval == 0:
            exchange = self.stream("nnga.exchange", address)
            peopled = [one for one, members in enumerate(genomes) if members]
            other = peopled[exchange.integer(len(peopled))]
            if exchange.unit(1)[0] < options.exchange:
                home = other
        partners = [genomes[home][stream.integer(len(genomes[home]))] for _ in range(options.partners)]
        father = max(partners, key=lambda other: self.representation.distance(mother, other))
        return self.representation.crossover(mother, father, stream)


class PlainMembers(SteadyMembers):
    """Members in steady state that are ranked anew for every child."""

    def join(self, genome: Genome, fitness: float) -> None:
        if self._count == self._options.population and np.isnan(fitness):
            return
        if self._count == 0:
            self._genomes = np.empty((self._options.population, len(genome)), dtype=np.float32)
        if self._count < self._options.population:
            place = self._count
            self._count += 1
        else:
            place = int(best_first(self.fitness)[-1])
        self._genomes[place], self._values[place] = genome, fitness

    def child(self, streams: Callable[[str], Streams]) -> Genome | None:
        options = self._options
        ranked = best_first(self.fitness)[: int(np.isfinite(self.fitness).sum())].tolist()
        ways = options.mutate + options.crossover + options.renew
        share = float(streams("nnga.way").units(1)[0, 0]) * ways
        if not ranked or share >= options.mutate + options.crossover:
            return None
        parents = streams("nnga.parent")[0]
        if share < options.mutate:
            return self._representation.mutate(
                self._genomes[ranked[drawn(parents, len(ranked))]],
                streams("nnga.mutate")[0],
                severity=options.severity,
                probability=options.probability,
            )
        known = {genome.tobytes() for genome in self._genomes[: self._count]}
        varying = streams("nnga.crossover")[0]
        for _ in range(100):
            mother, *others = [
                self._genomes[ranked[drawn(parents, len(ranked))]] for _ in range(1 + options.partners)
            ]
            father = max(others, key=lambda other: self._representation.distance(mother, other))
            child = self._representation.crossover(mother, father, varying)
            if child.tobytes() not in known:
                return child
        return None


class PlainCea2d(Cea2d):
    """Neighbours are found by their coordinates, and neighbourhoods are sorted."""

    def around(self, member: int) -> list[int]:
        """The neighbours of a member."""
        options = self.options
        if options.neighbourhood == "random":
            stream = Stream(self.seed, "cea2d.neighbours", 0, member)
            return sorted({stream.integer(options.members) for _ in range(8)} - {member})
        cells = list(range(options.width * options.height))
        stream = Stream(self.seed, "cea2d.obstacles", 0, 0)
        for place in range(options.obstacles):
            other = place + stream.integer(len(cells) - place)
            cells[place], cells[other] = cells[other], cells[place]
        peopled = sorted(cells[options.obstacles :])
        x, y = divmod(peopled[member], options.height)
        near = {
            (x + dx) % options.width * options.height + (y + dy) % options.height
            for dx in (-1, 0, 1)
            for dy in (-1, 0, 1)
        }
        return sorted({peopled.index(cell) for cell in near & set(peopled)} - {member})

    def worked(self, member: int) -> list[int]:
        """The members of a neighbourhood that did not fail, the best first; of equal ones the last."""
        every = [one for one in (member, *self.around(member)) if not math.isnan(self._fitness[one])]
        return sorted(every, key=lambda one: (-self._fitness[one], -one))

    def elite(self, member: int) -> list[int]:
        """Those of a neighbourhood that stay."""
        return self.worked(member)[: round((1 + len(self.around(member))) * self.options.elite)]

    def _ask(self) -> Genomes:
        every = range(self.options.members)
        if self.generation == 0:
            return np.array([self.representation.initial(self.stream("initial", one)) for one in every])
        cells = [one for one in every if one not in self.elite(one)] or [int(np.argmin(self._fitness))]
        self._cells = np.array(cells)
        return np.array([self.made(cell, self.drawing(cell)) for cell in cells])

    def drawing(self, cell: int) -> Callable[[str], Stream]:
        """The random numbers of a cell in this generation, by purpose."""
        return lambda purpose: self.stream(purpose, cell)

    def _ask_next(self, index: int) -> Genome:
        members = self.options.members
        if index < members:
            self._target_cells[index] = index
            return self.representation.initial(self.streams_of("initial", index)[0])
        sweep = [(self._cursor + step) % members for step in range(members)]
        cell = next((one for one in sweep if one not in self.elite(one)), self._cursor)
        self._cursor = (cell + 1) % members
        self._target_cells[index] = cell
        return self.made(cell, lambda purpose: self.streams_of(purpose, index)[0])

    def _tell_next(self, index: int, genome: Genome, fitness: float) -> None:
        cell = self._target_cells.pop(index)
        if cell not in self.elite(cell) or fitness > self._fitness[cell]:
            self._genomes[cell], self._fitness[cell] = genome, fitness

    def made(self, cell: int, stream: Callable[[str], Stream]) -> Genome:
        """What comes into a cell."""
        options, operators = self.options, self.representation
        ticket, place = stream("cea2d.choose").unit(2).tolist()
        share = ticket * (1 - options.elite)
        worked, elite = self.worked(cell), self.elite(cell)
        if not worked or share >= options.mutate + options.crossover:
            return operators.initial(stream("initial"))
        parents = elite or worked
        parent = parents[int(place * len(parents))]
        failed = math.isnan(self._fitness[cell])
        if failed or share < options.mutate:
            return operators.mutate(
                self._genomes[parent if failed or elite else cell],
                stream("cea2d.mutate"),
                severity=options.severity,
                probability=options.probability,
            )
        return operators.crossover(self._genomes[cell], self._genomes[parent], stream("cea2d.crossover"))
