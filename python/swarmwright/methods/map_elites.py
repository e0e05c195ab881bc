"""MAP-Elites: an archive of the best candidates for each kind of behaviour."""

import math
import sys
from collections.abc import Sequence
from typing import Annotated, Any, ClassVar, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, field_validator, model_validator

from swarmwright.common.arrays import Fitness, Genome, Genomes
from swarmwright.common.options import Options
from swarmwright.common.problems import FieldError
from swarmwright.common.random_numbers import Stream
from swarmwright.controllers import Representation
from swarmwright.methods._base import DrawStreams, Method, MethodOptions, check_metric_mapping
from swarmwright.methods._numbers import center_and_reach, explain_too_many_genes
from swarmwright.methods.archive import Archive, Axis, Cells, Grid, Values
from swarmwright.methods.emitters import Emitters, Improvements, Thresholds
from swarmwright.methods.sampled_archive import SampledArchive
from swarmwright.methods.unstructured import Unstructured
from swarmwright.methods.voronoi import Voronoi

_MOST_CELLS = 1_000_000
"""Upper limit of cells in a grid."""
_MOST_GENES = 5000
"""Genes for which a covariance matrix is affordable."""
_MOST_ENTRIES = 5 * _MOST_GENES**2
"""Upper limit of entries of all covariance matrices: 3 GB."""
_MOST_UNSTRUCTURED = 100_000
"""Upper limit of a generation that is added to an unstructured archive: minutes for the fullest archive."""
_BINS = 20
"""Default number of bins of a measure in a grid."""


class Measure(Options):
    """Division of the archive by a metric."""

    range: list[float] = Field(min_length=2, max_length=2)
    """Lowest and highest value; values beyond count as these, except in an unstructured archive."""
    bins: int | None = Field(default=None, ge=1, le=10_000)
    """Number of bins of a grid. Default: 20."""

    @model_validator(mode="before")
    @classmethod
    def _require_keys(cls, value: object) -> object:
        if isinstance(value, list):
            raise ValueError(f"must have the form {_form(value)}")
        return value

    @model_validator(mode="after")
    def _check_range(self) -> Self:
        low, high = self.range
        if not low < high:
            raise ValueError(f"range must be [low, high] with low < high, not [{low:g}, {high:g}]")
        if not math.isfinite(high - low):
            raise ValueError(f"range [{low:g}, {high:g}] is too wide: its width is not a finite number")
        if (high - low) / (self.bins or _BINS) < sys.float_info.min:
            raise ValueError(
                f"range [{low:g}, {high:g}] is too narrow for {self.bins or _BINS} bins: their width would "
                f"be below {sys.float_info.min:.3g}, the smallest normal number"
            )
        return self


def _form(numbers: list[Any]) -> str:
    """Return the form of a measure, with the range and bins that `[0, 15, 5]` may mean."""
    low, high, bins, *_ = [*map(str, numbers), *("0", "1", "20")[len(numbers) :]]
    return f"{{range: [{low}, {high}], bins: {bins}}}"


class GridOptions(Options):
    """Cells by equal bins of each measure."""

    kind: Literal["grid"]
    """Each measure is divided into its `bins`."""


class CvtOptions(Options):
    """A number of cells of nearly equal size, for any number of measures."""

    kind: Literal["cvt"]
    """A centroidal Voronoi tessellation."""
    cells: int = Field(default=1000, ge=1, le=10_000)
    """Number of cells."""


class UnstructuredOptions(Options):
    """No cells: elites keep a distance."""

    kind: Literal["unstructured"]
    """Candidates join if they are novel, and else replace the nearest elite if it is worse."""
    threshold: float = Field(default=0.05, ge=1e-6, le=1000)
    """Least mean distance to the nearest elites, where 1 is the range of a measure."""
    neighbours: int = Field(default=1, ge=1, le=1000)
    """Number of nearest elites."""


class MapElitesOptions(MethodOptions):
    """Quality diversity: an archive of the best candidates for each combination of measures."""

    metrics_option = "measures"
    kind: Literal["map_elites"] = "map_elites"
    population: int = Field(default=100, ge=1, le=1_000_000)
    """Candidates in each generation."""
    measures: dict[str, Measure] = Field(default={}, max_length=8)
    """Metrics that describe behaviour, as means over episodes: `{cohesion: {range: [0, 1], bins: 20}}`.
    Required in experiments."""
    archive: Annotated[GridOptions | CvtOptions | UnstructuredOptions, Field(discriminator="kind")] = (
        GridOptions(kind="grid")
    )
    """{kind: grid}: the bins of the measures. {kind: cvt, cells: 1000}: that many cells of nearly equal size.
    {kind: unstructured, threshold: 0.05, neighbours: 1}: no cells; a candidate joins if its mean distance to
    the nearest elites is at least the threshold, where 1 is the range of a measure, and else replaces the
    nearest elite if that is worse."""
    initial: int = Field(default=0, ge=0, le=10_000_000)
    """Random candidates before variation, in whole generations; 0: one generation."""
    variation: Literal["auto", "line", "mutation", "cma_me", "cma_mae"] = "auto"
    """line: an elite plus a normal step per gene and a normal share of the difference to another elite.
    mutation: the representation's mutation. cma_me: searches by CMA-ES for improvements of the archive.
    cma_mae: the same with thresholds of cells that rise slowly, which explores where fitness is nearly flat.
    auto: line for numeric genes, else mutation."""
    step: float = Field(default=0.01, ge=0, le=10)
    """line: standard deviation of steps, relative to the initial range of a gene."""
    line: float = Field(default=0.2, ge=0, le=10)
    """line: standard deviation of the share of the difference."""
    severity: float = Field(default=0.3, ge=0, le=1000)
    """mutation: its size, relative to the initial range of weights and biases."""
    probability: float = Field(default=0.3, ge=0, le=1)
    """mutation: probability that it changes a gene."""
    reevaluate: float = Field(default=0, ge=0, le=0.9)
    """Largest share of a generation that evaluates elites and their challengers again, so that means over
    several evaluations decide; needs `ranking.seeds: new`. 0: one evaluation decides."""
    emitters: int = Field(default=5, ge=1, le=10_000)
    """cma_me, cma_mae: number of searches, among which the population is divided evenly."""
    sigma: float = Field(default=0.3, gt=0, le=1000)
    """cma_me, cma_mae: initial standard deviation, as a share of half the initial range of a gene."""
    learning_rate: float = Field(default=0.01, ge=0, le=1)
    """cma_mae: share of the way to the fitness of an accepted candidate by which a threshold rises."""
    threshold_min: float | None = None
    """cma_mae: first threshold of each cell, the worst fitness worth keeping. Required there."""

    @field_validator("measures", mode="before")
    @classmethod
    def _check_measures(cls, value: object) -> object:
        return check_metric_mapping(value, "a range", "cohesion", _form([]))

    @property
    def uses_emitters(self) -> bool:
        """Whether candidates come from searches by CMA-ES."""
        return self.variation in ("cma_me", "cma_mae")

    @model_validator(mode="after")
    def _check_operation(self) -> Self:
        if self.operation == "steady_state" and (self.uses_emitters or self.reevaluate):
            key = "reevaluate" if self.reevaluate else "variation"
            raise FieldError(
                "operation", f"steady_state does not support {key}: {getattr(self, key)}; leave one out"
            )
        return self

    @model_validator(mode="after")
    def _check_reevaluate(self) -> Self:
        if self.reevaluate and (self.uses_emitters or self.cells is None):
            raise FieldError(
                "reevaluate", "needs archive.kind grid or cvt, and variation line or mutation; leave it out"
            )
        if self.reevaluate and not int(self.reevaluate * self.population):
            raise FieldError(
                "reevaluate",
                f"{self.reevaluate:g} of a population of {self.population} is less than one candidate; "
                "increase it or the population, or leave it out",
            )
        return self

    @model_validator(mode="after")
    def _check_emitters(self) -> Self:
        if not self.uses_emitters:
            return self
        if self.population % self.emitters or self.population < 3 * self.emitters:
            raise FieldError(
                "population",
                f"{self.population} must be a multiple of emitters ({self.emitters}), at least 3 for each",
            )
        if self.variation == "cma_mae" and self.threshold_min is None:
            raise FieldError("threshold_min", "cma_mae needs it: the worst fitness worth keeping")
        if self.variation == "cma_mae" and self.cells is None:
            raise FieldError("variation", "cma_mae needs cells; use archive.kind grid or cvt, or cma_me")
        return self

    @model_validator(mode="after")
    def _fits(self) -> Self:
        if isinstance(self.archive, UnstructuredOptions) and self.population > _MOST_UNSTRUCTURED:
            raise FieldError(
                "population",
                f"{self.population:,} candidates take too long to add to an unstructured archive; use at "
                f"most {_MOST_UNSTRUCTURED:,}, and more generations",
            )
        if not isinstance(self.archive, GridOptions):
            kind = self.archive.kind
            for name, measure in self.measures.items():
                if measure.bins is not None:
                    cure = "set archive.cells" if kind == "cvt" else "set archive.threshold"
                    reason = f"only a grid has bins, not archive.kind {kind}; leave it out and {cure}"
                    raise FieldError(("measures", name, "bins"), reason)
            return self
        cells = math.prod(axis.bins for axis in self.axes)
        if cells > _MOST_CELLS:
            raise ValueError(
                f"measures make {cells:,} cells, more than {_MOST_CELLS:,}; use fewer bins, or archive: "
                "{kind: cvt}"
            )
        return self

    @property
    def needed_metrics(self) -> tuple[str, ...]:
        """Names of the measures."""
        return tuple(self.measures)

    @property
    def axes(self) -> tuple[Axis, ...]:
        """The measures; a single bin without measures."""
        has_bins = isinstance(self.archive, GridOptions)
        axes = [
            Axis(measure.range[0], measure.range[1], (measure.bins or _BINS) if has_bins else 1)
            for measure in self.measures.values()
        ]
        return tuple(axes or [Axis(0.0, 1.0, 1)])

    @property
    def cells(self) -> Cells | None:
        """The archive's cells; None if it is unstructured."""
        if isinstance(self.archive, CvtOptions):
            return Voronoi(self.axes, self.archive.cells)
        return Grid(self.axes) if isinstance(self.archive, GridOptions) else None

    def new_archive(self) -> Archive | Unstructured | SampledArchive:
        """Return an empty archive."""
        archive, cells = self.archive, self.cells
        if self.reevaluate and cells is not None:
            return SampledArchive(cells, population=self.population, share=self.reevaluate)
        if isinstance(archive, UnstructuredOptions):
            return Unstructured(self.axes, threshold=archive.threshold, neighbours=archive.neighbours)
        assert cells is not None
        return Archive(cells)


class MapElites(Method):
    """MAP-Elites, whose archive holds the best candidate for each cell of the space of measures of behaviour.

    Each generation varies random elites and adds candidates that are better than the elite of their cell, or
    whose cell is empty. The result is a collection of controllers that behave differently:
    `swarmwright runs elites RUN`.

    Source: Mouret and Clune, "Illuminating search spaces by mapping elites", arXiv:1504.04909, 2015; the
    variation `line`: Vassiliades and Mouret, "Discovering the elite hypervolume by leveraging interspecies
    correlation", GECCO 2018. Archives and emitters have their sources in `Voronoi`, `Unstructured`,
    `Emitters` and `Thresholds`.
    """

    kind: ClassVar[str] = "map_elites"
    options_model = MapElitesOptions
    options: MapElitesOptions
    steady_state = True
    start_as = "members"
    ranks_violations = True

    def __init__(self, options: MapElitesOptions, representation: Representation, *, seed: int) -> None:
        super().__init__(options, representation, seed=seed)
        self._archive = options.new_archive()
        self._sampled_genomes: dict[int, Genome] = {}
        """Genomes of a `SampledArchive` by number."""
        self._genomes: Genomes = np.empty((0, representation.genome_size), dtype=np.float32)
        """Genomes of the elites, in the order in which their cells were filled."""
        self._rows = np.empty(0, dtype=np.int64)
        """Row of each cell in the genomes."""
        self._emitters: Emitters | None = None
        self._emitted = False  # whether the last candidates are those of the emitters
        self._thresholds: Thresholds | None = None
        cells = options.cells
        if options.uses_emitters:
            self._emitters = Emitters(
                representation,
                seed=seed,
                count=options.emitters,
                population=options.population,
                sigma=options.sigma,
                patient=options.variation == "cma_mae",
            )
        if options.variation == "cma_mae" and cells is not None and options.threshold_min is not None:
            self._thresholds = Thresholds(
                cells, learning_rate=options.learning_rate, least=options.threshold_min
            )

    @classmethod
    def problems(cls, options: MethodOptions, representation: Representation | None) -> dict[str, str]:
        """Refuse numeric variation if genes are choices."""
        invalid = super().problems(options, representation)
        assert isinstance(options, MapElitesOptions)
        if representation is None or options.variation in ("auto", "mutation"):
            return invalid
        kind, variation = representation.kind, options.variation
        if not representation.continuous:
            invalid["variation"] = (
                f"{variation} needs numeric genes, but those of {kind} are choices; use mutation"
            )
        elif options.uses_emitters and representation.genome_size < 2:
            invalid["variation"] = f"{variation} needs at least two genes; use line"
        elif options.uses_emitters:
            reason = explain_too_many_genes(representation, _MOST_GENES, "line")
            invalid |= {} if reason is None else {"variation": reason}
            most = _MOST_ENTRIES // representation.genome_size**2
            if options.emitters > most and reason is None:
                invalid["emitters"] = (
                    f"{options.emitters:,} covariance matrices of {representation.genome_size:,} genes need "
                    f"too much memory; use at most {most:,} emitters"
                )
        return invalid

    @property
    def budget(self) -> int:
        """Number of evaluations of the whole run."""
        return self.options.population * self.options.generations

    @property
    def generation_size(self) -> int:
        """Candidates in each generation."""
        return self.options.population

    @property
    def population_fitness(self) -> Fitness:
        """Fitness of all elites; NaN without any."""
        return self._archive.fitness if len(self._archive) else np.full(1, np.nan)

    @property
    def archive(self) -> Archive | Unstructured | SampledArchive:
        """The archive, with elites numbered by their evaluation in the run, from 0."""
        return self._archive

    def _ask(self) -> Genomes:
        repeated = self._ask_again()
        candidates = range(len(repeated), self.options.population)
        self._emitted = False
        if self.generation * self.options.population < self.options.initial or not len(self._archive):
            return np.concatenate([repeated, self.initials(candidates)])
        if self._emitters is not None:
            self._emitted = True
            return self._emitters.ask(self.generation, self._draw_elite)
        return np.concatenate([repeated, self._vary(candidates, self.streams)])

    def _ask_next(self, index: int) -> Genome:
        if index < max(self.options.initial, self.options.population) or not len(self._archive):
            return self.initial_of(index)
        return np.asarray(self._vary([0], self.streams_next(index))[0])

    def _vary(self, candidates: Sequence[int], draw: DrawStreams) -> Genomes:
        """Return a variation of an elite for each candidate, (n, genome_size)."""
        chosen = draw("map_elites.choose", candidates).integers(len(self._archive), 2)
        parents, partners = self._genomes_of(chosen[:, 0]), self._genomes_of(chosen[:, 1])
        streams = draw("map_elites.vary", candidates)
        if self.options.variation == "line" or (
            self.options.variation == "auto" and self.representation.continuous
        ):
            return self._vary_along_lines(parents, partners, streams.normals(parents.shape[1] + 1))
        options = self.options
        return self.representation.mutations(
            parents, streams, severity=options.severity, probability=options.probability
        )

    def _ask_again(self) -> Genomes:
        """Return the genomes that are evaluated again."""
        planned = self._archive.planned if isinstance(self._archive, SampledArchive) else []
        genomes = [self._sampled_genomes[number] for number in planned]
        return np.array(genomes, dtype=np.float32).reshape(-1, self.representation.genome_size)

    def _genomes_of(self, elites: NDArray[np.int64]) -> Genomes:
        """Return the genomes of elites, by their index in `archive.cells`."""
        archive = self._archive
        if isinstance(archive, SampledArchive):
            return np.stack([self._sampled_genomes[number] for number in archive.numbers[elites].tolist()])
        return self._genomes[self._rows[archive.cells[elites]]]

    def _draw_elite(self, stream: Stream) -> Genome:
        return np.asarray(self._genomes_of(np.array([stream.integer(len(self._archive))]))[0])

    def _vary_along_lines(self, parents: Genomes, partners: Genomes, normals: Values) -> Genomes:
        """Vary parents along lines to others. normals: (n, genome_size + 1)."""
        _, reach = center_and_reach(self.representation)
        begin = parents.astype(np.float64)
        steps = normals[:, 1:] * (self.options.step * 2 * reach)
        lines = (partners - begin) * (self.options.line * normals[:, :1])
        lower, upper = self.representation.bounds
        largest = np.finfo(np.float32).max
        along_lines = np.clip(begin + steps + lines, np.maximum(lower, -largest), np.minimum(upper, largest))
        return along_lines.astype(np.float32)

    def _tell_next(self, index: int, genome: Genome, fitness: float) -> None:  # noqa: ARG002 - it is `evaluations`
        self._tell(genome[np.newaxis], np.array([fitness]))

    def _tell(self, genomes: Genomes, fitness: Fitness) -> None:
        measures = self.metrics if self.options.measures else np.zeros((len(genomes), 1))
        fitness = np.where(self.violations > 0, np.nan, fitness)  # infeasible candidates are no elites
        archive = self._archive
        numbers = range(self.evaluations, self.evaluations + len(genomes))
        if isinstance(archive, SampledArchive):
            archive.add(numbers, fitness, measures)
            before, first = self._sampled_genomes, self.evaluations
            self._sampled_genomes = {
                number: genomes[number - first].copy() if number >= first else before[number]
                for number in archive.members
            }
            return
        if self._thresholds is not None:
            improvements = self._thresholds.improve(fitness, measures)
        elif self._emitters is not None:
            improvements = Improvements(*archive.compare(fitness, measures))
        if self._emitters is not None and self._emitted:
            self._emitters.tell(improvements)
        self._store(genomes, archive.add(numbers, fitness, measures))

    def _store(self, genomes: Genomes, new: NDArray[np.int64]) -> None:
        """Keep the genomes of new elites. new: their cells and rows, (k, 2)."""
        cells, rows = new.T
        self._rows = _lengthen(self._rows, int(cells.max(initial=-1)) + 1, -1)
        empty = np.unique(cells[self._rows[cells] < 0])
        count = len(self._archive)
        self._rows[empty] = np.arange(count - len(empty), count)
        self._genomes = _lengthen(self._genomes, count, 0)
        self._genomes[self._rows[cells]] = genomes[rows]


def _lengthen(values: NDArray[Any], count: int, value: float) -> NDArray[Any]:
    """Return an array with at least `count` rows, twice as many if it was too short."""
    if len(values) >= count:
        return values
    more = np.full((2 * count - len(values), *values.shape[1:]), value, dtype=values.dtype)
    return np.concatenate([values, more])
