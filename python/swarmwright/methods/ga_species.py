"""GASpecies: a genetic algorithm in which similar members form species that share their fitness."""

from collections.abc import Callable, Sequence
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from swarmwright.common.arrays import Fitness, Genomes
from swarmwright.common.options import Options
from swarmwright.common.random_numbers import Streams
from swarmwright.controllers import Representation
from swarmwright.methods._base import Method, MethodOptions

_MEMBERS_PER_SPECIES = 10
"""The compatibility threshold adapts towards population / 10 species, as in FREVO."""
_ADJUSTMENTS = 20
"""Adjustments of the threshold in each generation, as in FREVO: one every population / 20 children."""
_LOWEST_COMPATIBILITY = 0.01
_MOST_COMPARISONS = 5e9
"""Upper limit of population^2 * genes, to which the time of a generation is proportional: a minute."""


def explain_slow_species(population: int, representation: Representation) -> dict[str, str]:
    """Return why a population is too large to be divided into species, by option; empty if it is not."""
    genes = representation.genome_size
    most = int((_MOST_COMPARISONS / genes) ** 0.5)
    if population <= most:
        return {}
    return {
        "population": f"{population:,} genomes of {genes:,} genes take too long to divide into species; use "
        f"at most {most:,}"
    }


class SpeciesOptions(Options):
    """Options of species, with FREVO's defaults."""

    compatibility: float = Field(default=0.5, gt=0, le=1e9)
    """Initial genetic distance below which members belong to one species; it adapts by 10 % steps towards a
    species for each 10 members."""
    survival: float = Field(default=0.4, ge=0, le=1)
    """Share of a species' members, the best ones, that become parents. If that is less than one member, the
    best one is mutated."""
    mutate: float = Field(default=0.3, ge=0, le=1)
    """Probability that a child is a mutated copy; others have two parents."""
    within: float = Field(default=0.001, ge=0, le=1)
    """Probability that both parents belong to the same species; otherwise the father is the best member of
    another one."""
    crossover_only: float = Field(default=0.2, ge=0, le=1)
    """Probability that a child of two parents is not mutated."""


class GaSpeciesOptions(MethodOptions, SpeciesOptions):
    """FREVO's GASpecies with its defaults, except for smaller mutations."""

    kind: Literal["ga_species"] = "ga_species"
    population: int = Field(default=50, ge=2, le=100_000)
    """Members, and children in each generation."""
    severity: float = Field(default=0.3, ge=0, le=1000)
    """Size of mutations, relative to the initial range of weights and biases; 1 in FREVO."""
    probability: float = Field(default=1.0, ge=0, le=1)
    """Probability that a mutation changes a gene."""


class SpeciesMembers:
    """A population divided into species.

    Members are compared by ranks: the worst of n has the shared value 1 / size of its species, the best n /
    size. Children replace the members with the least shared values, so that crowded species shrink, and the
    best member is never lost. Species are founded by the best members: a member belongs to the first founder
    within the compatibility threshold, or founds a species.

    Args:
        options: options of species.
        population: number of members to keep.
        representation: provides the operators on genomes.
        variation: severity and probability of mutations.
    """

    def __init__(
        self,
        options: SpeciesOptions,
        population: int,
        representation: Representation,
        variation: tuple[float, float],
    ) -> None:
        self._options = options
        self._population = population
        self._representation = representation
        self._severity, self._probability = variation
        self._threshold = options.compatibility
        self.genomes: Genomes = np.empty((0, representation.genome_size), dtype=np.float32)
        """The members, the best first."""
        self._species: NDArray[np.int64] = np.empty(0, dtype=np.int64)  # of each member

    @property
    def species(self) -> list[NDArray[np.int64]]:
        """Indices of the members of each species, best first, as are the species by their best members."""
        return _groups(self._species)

    def update(self, children: Genomes, scores: Fitness) -> NDArray[np.int64]:
        """Add children, then remove the worst; return the indices of the remaining members, the best first.

        Args:
            children: (n, genome_size).
            scores: (members + n,), the higher the better, of the members and the children; NaN for failed
                ones, which are removed.
        """
        order = np.argsort(-scores, kind="stable")
        order = order[: np.isfinite(scores).sum()]
        genomes = np.concatenate([self.genomes, children])[order]
        self._adapt(genomes)
        species = self._divide(genomes, len(genomes))
        remaining = self._select(species)
        self.genomes = genomes[remaining]
        self._species = np.unique(species[remaining], return_inverse=True)[1]
        return order[remaining]

    def create(self, streams: Callable[[str, Sequence[int]], Streams], count: int) -> Genomes:
        """Create children, (count, genome_size). streams: returns the streams of a purpose and children."""
        children = range(count)
        if not len(self.genomes):
            return self._representation.initials(streams("initial", children))
        members = self.species
        values = np.arange(len(self.genomes), 0, -1, dtype=np.float64)
        means = np.array([values[rows].sum() / len(rows) for rows in members])
        drawn = streams("choose", children).units(6)
        mothers, fathers = np.zeros(count, dtype=np.int64), np.full(count, -1)
        for child, (species, way, mother, within, father, _) in enumerate(drawn.tolist()):
            own = _spin(means, species)
            parents = members[own][: int((len(members[own]) - 1) * self._options.survival)]
            if not len(parents):
                mothers[child] = members[own][0]
                continue
            mothers[child] = parents[int(mother * len(parents))]
            if way < self._options.mutate:
                continue
            if within < self._options.within or len(members) == 1:
                fathers[child] = parents[int(father * len(parents))]
            else:
                others = np.where(np.arange(len(members)) == own, 0.0, means)
                fathers[child] = members[_spin(others, father)][0]
        genomes = self.genomes[mothers]
        crossed = np.flatnonzero(fathers >= 0)
        if len(crossed):
            genomes[crossed] = self._representation.crossovers(
                genomes[crossed], self.genomes[fathers[crossed]], streams("crossover", crossed.tolist())
            )
        equal = (self.genomes[mothers] == self.genomes[fathers]).all(axis=1)
        mutated = np.flatnonzero((fathers < 0) | equal | (drawn[:, 5] >= self._options.crossover_only))
        if len(mutated):
            genomes[mutated] = self._representation.mutations(
                genomes[mutated],
                streams("mutate", mutated.tolist()),
                severity=self._severity,
                probability=self._probability,
            )
        return genomes

    def _adapt(self, genomes: Genomes) -> None:
        """Adapt the threshold to the number of species."""
        target = max(self._population // _MEMBERS_PER_SPECIES, 1)
        for _ in range(_ADJUSTMENTS):
            count = self._divide(genomes, target + 1).max(initial=-1) + 1
            if count > target:
                self._threshold *= 1.1
            elif count < target and self._threshold > _LOWEST_COMPATIBILITY:
                self._threshold *= 0.9
            else:
                break

    def _divide(self, genomes: Genomes, most: int) -> NDArray[np.int64]:
        """Return the species of genomes, (n,), from 0; -1 for those left after `most` species."""
        species = np.full(len(genomes), -1)
        rest = np.arange(len(genomes))
        for number in range(most):
            if not len(rest):
                break
            distances = self._representation.distances_among(genomes, rest[:1], rest[np.newaxis])[0]
            joins = distances < self._threshold
            joins[0] = True
            species[rest[joins]] = number
            rest = rest[~joins]
        return species

    def _select(self, species: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the members to keep, ascending. species: (n,) of members, the best first."""
        count = len(species)
        members = [rows.tolist() for rows in _groups(species)]
        sizes = np.array([len(rows) for rows in members], dtype=np.float64)
        worst = np.array([count - rows[-1] for rows in members], dtype=np.float64)
        for _ in range(count - self._population):
            number = int(np.argmin(worst / sizes))
            members[number].pop()
            sizes[number] -= 1
            worst[number] = count - members[number][-1] if members[number] else np.inf
            sizes[number] = max(sizes[number], 1)
        return np.array(sorted(row for rows in members for row in rows), dtype=np.int64)


def _groups(species: NDArray[np.int64]) -> list[NDArray[np.int64]]:
    """Return the indices of the members of each species, ascending. species: (members,), from 0."""
    return [np.flatnonzero(species == number) for number in range(species.max(initial=-1) + 1)]


def _spin(weights: NDArray[np.float64], unit: float) -> int:
    """Return an index with a probability proportional to its weight. unit: 0 <= unit < 1."""
    sums = np.cumsum(weights)
    return int(np.searchsorted(sums, unit * sums[-1], side="right"))


class GaSpecies(Method):
    """A genetic algorithm with species, which protects new kinds of genomes from the best one so far.

    Members with similar genomes form species and share their fitness: each generation, children of parents
    from several species replace the members whose rank, divided by the size of the species, is the lowest.

    Source: GASpecies of FREVO (Fehervari; Components/Methods/gaspecies), which follows rtNEAT (Stanley,
    Bryant and Miikkulainen, "Real-time neuroevolution in the NERO video game", IEEE Transactions on
    Evolutionary Computation 9(6), 2005), with five differences. FREVO creates and replaces members one at a
    time; here whole generations change. FREVO shares fitness itself, which requires positive values; here
    ranks are shared. FREVO moves a member that fits only its own species to a new one; here the best members
    found the species. FREVO almost always takes fathers from the species in the middle of its list; here the
    species of fathers are drawn as those of mothers. FREVO's mutations always have severity 1.
    """

    kind: ClassVar[str] = "ga_species"
    options_model = GaSpeciesOptions
    options: GaSpeciesOptions
    keeps_members = True
    start_as = "members"

    def __init__(self, options: GaSpeciesOptions, representation: Representation, *, seed: int) -> None:
        super().__init__(options, representation, seed=seed)
        variation = options.severity, options.probability
        self._members = SpeciesMembers(options, options.population, representation, variation)
        self._fitness: Fitness = np.empty(0)

    @classmethod
    def problems(cls, options: MethodOptions, representation: Representation | None) -> dict[str, str]:
        """Refuse populations that would take too long."""
        invalid = super().problems(options, representation)
        assert isinstance(options, GaSpeciesOptions)
        if representation is not None:
            invalid |= explain_slow_species(options.population, representation)
        return invalid

    @property
    def budget(self) -> int:
        """Number of evaluations of the whole run."""
        return self.options.population * self.options.generations

    @property
    def population_fitness(self) -> Fitness:
        """Fitness of the members, the best first; NaN without any."""
        return self._fitness.copy() if len(self._fitness) else np.full(1, np.nan)

    @property
    def members(self) -> SpeciesMembers:
        """The members and their species."""
        return self._members

    def survivors(self) -> Genomes:
        """Return the members."""
        return self._members.genomes.copy()

    def _rescore(self, fitness: Fitness) -> None:
        self._fitness = fitness

    def _ask(self) -> Genomes:
        if self.generation == 0:
            return self.initials(range(self.options.population))
        return self._members.create(self._streams_of, self.options.population)

    def _streams_of(self, purpose: str, children: Sequence[int]) -> Streams:
        return self.streams(purpose if purpose == "initial" else f"ga_species.{purpose}", children)

    def _tell(self, genomes: Genomes, fitness: Fitness) -> None:
        scores = np.concatenate([self._fitness, fitness])
        self._fitness = scores[self._members.update(genomes, scores)]
