"""Novelty search: evolution towards behaviour that has not been seen before."""

import math
from collections.abc import Sequence
from itertools import islice
from typing import Annotated, ClassVar, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, ValidationError, field_validator, model_validator

from swarmwright.common.arrays import Fitness, Genomes
from swarmwright.common.options import Options
from swarmwright.common.problems import FieldError
from swarmwright.common.random_numbers import Streams
from swarmwright.controllers import Representation
from swarmwright.methods._base import MethodOptions, check_metric_mapping
from swarmwright.methods.archive import Values, crowding, ranks
from swarmwright.methods.constraints import Limits
from swarmwright.methods.ga_species import SpeciesMembers, SpeciesOptions, explain_slow_species
from swarmwright.methods.map_elites import MapElitesOptions, Measure
from swarmwright.methods.nnga import Genetic, GeneticOptions
from swarmwright.methods.novelty_archive import (
    MOST_COLUMNS_OF_TREE,
    Distance,
    NoveltyArchive,
    find_nearest,
    mean_distances,
)

_NEIGHBOURS = 15
"""Default of Lehman and Stanley."""
_MOST_WITH_FRONTS = 4_000
"""Upper limit of members that are sorted into fronts."""
_MOST_NEIGHBOURS = 10_000_000
"""Upper limit of the neighbours of all members, which are sorted in each generation: some seconds."""
_MOST_NUMBERS = 50_000
"""Upper limit of the numbers of all members' behaviours where no tree finds neighbours faster."""
_MOST_ARCHIVED = 1_000_000
"""Upper limit of behaviours in an archive: a second for each generation."""
_MOST_ARCHIVED_WITHOUT_TREE = 100_000
_LARGEST = 1e150
"""Upper limit of a scaled measure, so that sums of squares are finite."""


class RandomArchive(Options):
    """An archive of random candidates."""

    kind: Literal["random"]
    """Candidates are archived at random."""
    probability: float = Field(default=0.05, ge=0, le=1)
    """Probability that a candidate is archived."""
    size: int = Field(default=0, ge=0, le=_MOST_ARCHIVED)
    """Candidates to keep, the latest; 0: as many as possible."""


class ThresholdArchive(Options):
    """An archive of novel candidates."""

    kind: Literal["threshold"]
    """Candidates are archived if their novelty exceeds a threshold, which adapts."""
    threshold: float = Field(default=0.05, gt=0, le=1e100)
    """Initial threshold."""
    size: int = Field(default=0, ge=0, le=_MOST_ARCHIVED)
    """Candidates to keep, the latest; 0: as many as possible."""


class NoArchive(Options):
    """No archive: novelty is relative to the population."""

    kind: Literal["none"]
    """No candidates are archived."""


class NoveltyOptions(GeneticOptions):
    """Novelty search with the genetic algorithm of `nnga`, or with species as in `ga_species`."""

    metrics_option = "measures"
    kind: Literal["novelty"] = "novelty"
    population: int = Field(default=100, ge=2, le=100_000)
    """Members of each population."""
    measures: dict[str, Measure] = Field(default={}, max_length=200)
    """Metrics that describe behaviour (behavior descriptors), as means over episodes: `{cohesion: {range:
    [0, 1], bins: 20}}`. The width of the range is the unit of distance; the bins divide the archive that
    `swarmwright runs elites` shows. Required in experiments."""
    objective: Literal["novelty", "mixed", "local_competition"] = "novelty"
    """Selection by novelty alone; by the weighted sum of novelty and fitness, each scaled to 0..1 within the
    population; or by fronts of novelty and local competition, the number of neighbours with lower fitness."""
    weight: float | None = Field(default=None, ge=0, le=1)
    """mixed only: weight of fitness; that of novelty is 1 - weight. Default: 0.5."""
    neighbours: int | None = Field(default=None, ge=1, le=100_000)
    """Nearest neighbours, in the population and the archive, whose mean distance is the novelty. Default: 15,
    or all others of a smaller population."""
    distance: Distance = "euclidean"
    """Distance between two behaviours."""
    criteria: dict[str, Limits] = Field(default={}, max_length=20)
    """Minimal criteria: limits of fitness or metrics, `{fitness: {at_least: 0.1}}`. Candidates that miss one
    rank below all others, and are not archived."""
    archive: Annotated[RandomArchive | ThresholdArchive | NoArchive, Field(discriminator="kind")] = (
        RandomArchive(kind="random")
    )
    """{kind: random, probability: 0.05}: each candidate is archived with this probability. {kind: threshold,
    threshold: 0.05}: candidates whose novelty exceeds a threshold are; it rises by 20 % after a generation
    with more than four of them, and falls by 5 % after ten generations without any. {kind: none}: no archive.
    With size: N, only the latest N candidates stay. Default: 1,000,000, or 100,000 with more than 12
    measures.
    """
    species: SpeciesOptions | None = None
    """Select with species as `ga_species` does, with these options; islands and the five shares then have no
    effect. Default: none."""

    @field_validator("measures", mode="before")
    @classmethod
    def _check_measures(cls, value: object) -> object:
        return check_metric_mapping(value, "a range", "cohesion", "{range: [0, 1], bins: 20}")

    @field_validator("criteria", mode="before")
    @classmethod
    def _check_criteria(cls, value: object) -> object:
        return check_metric_mapping(value, "limits", "fitness", "{at_least: 0}")

    @model_validator(mode="after")
    def _fits_novelty(self) -> Self:
        members = self.population * self.islands
        self._check_neighbours(members)
        if self.weight is not None and self.objective != "mixed":
            raise ValueError("weight needs objective: mixed")
        if self.objective == "local_competition" and members > _MOST_WITH_FRONTS:
            raise ValueError(
                f"local_competition is limited to a population of {_MOST_WITH_FRONTS:,}, not {members:,}"
            )
        if self.species is not None and self.islands > 1:
            raise ValueError("species need a single population; leave islands out")
        try:
            _ = self.elites
        except ValidationError as error:
            reason = error.errors()[0]["msg"].removeprefix("Value error, ")
            raise ValueError(f"{reason}; measures with bins: 1 do not divide the archive of elites") from None
        return self

    def _check_neighbours(self, members: int) -> None:
        count = self.neighbours
        if count is not None and count >= members:
            raise FieldError("neighbours", f"must be below the population of {members:,}, not {count:,}")
        if (count or _NEIGHBOURS) * members > _MOST_NEIGHBOURS:
            raise FieldError(
                "neighbours" if count else "population",
                f"{count or _NEIGHBOURS:,} neighbours of {members:,} members are too many to sort in each "
                f"generation; use at most {_MOST_NEIGHBOURS // members:,} neighbours, or fewer members",
            )
        measures = len(self.measures)
        if self._has_many_measures and members * measures > _MOST_NUMBERS:
            raise FieldError(
                "population",
                f"{members:,} members are too many to compare with {measures} measures; use at most "
                f"{_MOST_NUMBERS // measures:,} members, or {MOST_COLUMNS_OF_TREE} measures",
            )
        size = 0 if isinstance(self.archive, NoArchive) else self.archive.size
        if size > self.archive_limit:
            raise FieldError(
                ("archive", "size"),
                f"{size:,} is too large with {measures} measures; use at most {self.archive_limit:,}, or "
                f"{MOST_COLUMNS_OF_TREE} measures",
            )

    @property
    def _has_many_measures(self) -> bool:
        return len(self.measures) > MOST_COLUMNS_OF_TREE

    @property
    def archive_limit(self) -> int:
        """Largest possible size of the archive."""
        return _MOST_ARCHIVED_WITHOUT_TREE if self._has_many_measures else _MOST_ARCHIVED

    @property
    def needed_metrics(self) -> tuple[str, ...]:
        """Names of the measures, then of other metrics in criteria."""
        return tuple(dict.fromkeys([*self.measures, *(name for name in self.criteria if name != "fitness")]))

    def option_of(self, metric: str) -> str:
        """Return the option that names a metric."""
        return "measures" if metric in self.measures else "criteria"

    @property
    def elites(self) -> MapElitesOptions:
        """An archive of elites over the measures that have several bins, or else over the first."""
        divided = {name: measure for name, measure in self.measures.items() if measure.bins != 1}
        return MapElitesOptions(measures=divided or dict(islice(self.measures.items(), 1)))

    def behaviours(self, metrics: Values) -> Values:
        """Return measures in units of their range, (n, measures), from metrics, (n, needed metrics).

        Values that are not finite are NaN. Without measures, all behaviours are equal.
        """
        if not self.measures:
            return np.zeros((len(metrics), 1))
        low = np.array([measure.range[0] for measure in self.measures.values()])
        high = np.array([measure.range[1] for measure in self.measures.values()])
        measures = metrics[:, : len(low)]
        with np.errstate(over="ignore"):
            scaled: Values = np.clip(measures / (high - low), -_LARGEST, _LARGEST)
        return np.where(np.isfinite(measures), scaled, np.nan)


class Novelty(Genetic):
    """Novelty search, which rewards behaviour that differs from all behaviour so far.

    The novelty of a candidate is the mean distance to the nearest behaviours in the population and in an
    archive of past candidates. Members of the population are scored anew in each generation. The best
    candidate of a run is still the one with the highest fitness; `swarmwright runs elites RUN` lists the best
    of each cell of the measures.

    Source: Lehman and Stanley, "Abandoning objectives: evolution through the search for novelty alone",
    Evolutionary Computation 19(2), 2011; minimal criteria: the same, "Revising the evolutionary computation
    abstraction: minimal criteria novelty search", GECCO 2010; local competition: the same, "Evolving a
    diversity of virtual creatures through novelty search and local competition", GECCO 2011; weighted sums in
    swarms: Gomes, Urbano and Christensen, "Evolution of swarm robotics systems with novelty search", Swarm
    Intelligence 7, 2013. With species, it is NoveltySpecies of FREVO, without, NNGA with FREVO's
    NoveltyRanking, except that both evaluate the novelty of a member only once.
    """

    kind: ClassVar[str] = "novelty"
    options_model = NoveltyOptions
    options: NoveltyOptions
    ranks_violations = True

    def __init__(self, options: NoveltyOptions, representation: Representation, *, seed: int) -> None:
        super().__init__(options, representation, seed=seed)
        self._species = (
            SpeciesMembers(
                options.species, options.population, representation, (options.severity, options.probability)
            )
            if options.species is not None
            else None
        )
        archive = options.archive
        self._archive = NoveltyArchive(
            max(len(options.measures), 1),
            (0 if isinstance(archive, NoArchive) else archive.size) or options.archive_limit,
            archive.threshold if isinstance(archive, ThresholdArchive) else math.inf,
        )
        self._fitness: Fitness = np.empty(0)  # of the members, as the three below
        self._metrics: Values = np.empty((0, len(options.needed_metrics)))
        self._violations: Values = np.empty(0)
        self._order: NDArray[np.int64] = np.empty(0, dtype=np.int64)
        """The members in ascending order of scores."""

    @classmethod
    def problems(cls, options: MethodOptions, representation: Representation | None) -> dict[str, str]:
        """Refuse species that would take too long."""
        invalid = super().problems(options, representation)
        assert isinstance(options, NoveltyOptions)
        if options.species is not None and representation is not None:
            invalid |= explain_slow_species(options.population, representation)
        return invalid

    @property
    def ahead(self) -> bool:
        """Whether the engine may run the search by itself: no, since scores change with the archive."""
        return False

    @property
    def budget(self) -> int:
        """Number of evaluations of a run without failures."""
        if self._species is None:
            return super().budget
        return self.options.population * self.options.generations

    @property
    def population_fitness(self) -> Fitness:
        """Fitness of the members; NaN without any."""
        if not len(self._fitness):
            return np.full(1, np.nan)
        return np.where(self._violations > 0, np.nan, self._fitness)

    @property
    def archive(self) -> NoveltyArchive:
        """The archive of behaviours."""
        return self._archive

    def survivors(self) -> Genomes:
        """Return the surviving members, from the second generation on."""
        return super().survivors() if self._species is None else self._species.genomes.copy()

    def _rescore(self, fitness: Fitness) -> None:
        self._fitness = fitness

    def _ask(self) -> Genomes:
        if self._species is not None:
            if self.generation == 0:
                return self.initials(range(self.options.population))
            return self._species.create(self._streams_of, self.options.population)
        genomes = super()._ask()
        if self.generation:
            # The search knows members by their scores.
            remaining = self._order[super().population_fitness.astype(np.int64)]
            self._keep(remaining)
        return genomes

    def _streams_of(self, purpose: str, children: Sequence[int]) -> Streams:
        return self.streams(purpose if purpose == "initial" else f"novelty.{purpose}", children)

    def _tell(self, genomes: Genomes, fitness: Fitness) -> None:
        members = len(self._fitness)
        metrics = self.metrics if self.options.needed_metrics else np.zeros((len(genomes), 0))
        order = np.arange(members + len(genomes))
        if self._species is None:
            order = self._join(members, len(genomes))
        self._fitness = np.concatenate([self._fitness, fitness])[order]
        self._metrics = np.concatenate([self._metrics, metrics])[order]
        self._violations = np.concatenate([self._violations, self.violations])[order]
        scores = self._score(order >= members)
        if self._species is not None:
            remaining = self._species.update(genomes, scores)
            self._keep(remaining)
            return
        self._order = np.argsort(scores)
        self.search.rescore(scores)

    def _keep(self, remaining: NDArray[np.int64]) -> None:
        """Keep these members, in this order."""
        self._fitness, self._metrics = self._fitness[remaining], self._metrics[remaining]
        self._violations = self._violations[remaining]

    def _join(self, members: int, children: int) -> NDArray[np.int64]:
        """Tell the search new members; return the order in which it has all, (members + children,)."""
        if members:
            self.search.rescore(np.arange(members, dtype=np.float64))
        self.search.tell(np.arange(members, members + children, dtype=np.float64))
        return super().population_fitness.astype(np.int64)

    def _score(self, new: NDArray[np.bool_]) -> Values:
        """Return the scores of all members, from 0, the higher the better, (n,); archive the new ones.

        Failed members have NaN.

        new: (n,).
        """
        options, archive = self.options, self._archive
        points = options.behaviours(self._metrics)
        valid = np.flatnonzero(np.isfinite(self._fitness) & np.isfinite(points).all(axis=1))
        points, fitness, new = points[valid], self._fitness[valid], new[valid]
        distances, neighbours = find_nearest(
            np.concatenate([archive.points, points]),
            len(archive),
            options.neighbours or _NEIGHBOURS,
            options.distance,
            ties=options.objective == "local_competition",
        )
        novelty = mean_distances(distances)
        meets = self._meets(valid)
        values = self._combine(novelty, fitness, neighbours)
        # Feasible candidates rank above infeasible ones, and those that meet the criteria above the others.
        violations = self._violations[valid]
        ranks_of = np.empty(len(valid))
        order = np.lexsort((-np.arange(len(valid)), values, meets, -violations))
        ranks_of[order] = np.arange(len(valid))
        scores = np.full(len(self._fitness), np.nan)
        scores[valid] = ranks_of
        self._add_to_archive(points, fitness, novelty, np.flatnonzero(new & meets & (violations == 0)))
        return scores

    def _meets(self, rows: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Return which of some members meet the criteria, (rows,)."""
        meets = np.ones(len(rows), dtype=bool)
        names = self.options.needed_metrics
        for name, criterion in self.options.criteria.items():
            values = self._fitness if name == "fitness" else self._metrics[:, names.index(name)]
            meets &= criterion.meets(values[rows])
        return meets

    def _combine(self, novelty: Values, fitness: Fitness, neighbours: NDArray[np.int64]) -> Values:
        """Return values to select by, (n,), the higher the better."""
        options = self.options
        if options.objective == "novelty":
            return novelty
        if options.objective == "mixed":
            weight = 0.5 if options.weight is None else options.weight
            return (1 - weight) * _scale(novelty) + weight * _scale(fitness)
        everyone = np.concatenate([self._archive.fitness, fitness])
        worse = (everyone[neighbours] < fitness[:, np.newaxis]).sum(axis=1).astype(np.float64)
        both = np.column_stack([novelty, worse])
        fronts = ranks(both)
        isolation = np.zeros(len(both))
        for front in range(int(fronts.max(initial=-1)) + 1):
            rows = np.flatnonzero(fronts == front)
            isolation[rows] = crowding(both[rows])
        values = np.empty(len(both))
        values[np.lexsort((isolation, -fronts))] = np.arange(len(both))
        return values

    def _add_to_archive(
        self, points: Values, fitness: Fitness, novelty: Values, rows: NDArray[np.int64]
    ) -> None:
        """Archive some of the new candidates, by the rule of the options. rows: indices of the new ones."""
        archive = self.options.archive
        if isinstance(archive, ThresholdArchive):
            self._archive.add_novel(points[rows], fitness[rows], novelty[rows])
        elif isinstance(archive, RandomArchive) and len(rows):
            drawn = self.streams("novelty.archive", np.arange(len(rows))).units(1)[:, 0]
            rows = rows[drawn < archive.probability]
            self._archive.add(points[rows], fitness[rows])


def _scale(values: Values) -> Values:
    """Return values scaled to 0..1; 0 if all are equal."""
    low, high = values.min(initial=np.inf), values.max(initial=-np.inf)
    if not low < high:
        return np.zeros(len(values))
    scaled: Values = (values / 2 - low / 2) / (high / 2 - low / 2)
    return scaled
