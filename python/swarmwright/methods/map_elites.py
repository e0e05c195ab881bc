"""MAP-Elites: an archive of the best candidates for each kind of behaviour."""

import math
import sys
from typing import Any, ClassVar, Literal, Self

import numpy as np
from pydantic import Field, field_validator, model_validator

from swarmwright.common.arrays import Fitness, Genome, Genomes
from swarmwright.common.options import Options
from swarmwright.controllers import Representation
from swarmwright.methods._base import Method, MethodOptions, check_metric_mapping
from swarmwright.methods._numbers import center_and_reach
from swarmwright.methods.archive import Archive, Axis, Grid, Values

_MOST_CELLS = 1_000_000
"""Upper limit of cells in an archive."""


class Measure(Options):
    """Division of the archive by a metric."""

    range: list[float] = Field(min_length=2, max_length=2)
    """Lowest and highest value; values beyond belong to the first or last bin."""
    bins: int = Field(default=20, ge=1, le=10_000)
    """Number of bins."""

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
        if (high - low) / self.bins < sys.float_info.min:
            raise ValueError(
                f"range [{low:g}, {high:g}] is too narrow for {self.bins} bins: their width would be below "
                f"{sys.float_info.min:.3g}, the smallest normal number"
            )
        return self


def _form(numbers: list[Any]) -> str:
    """Return the form of a measure, with the range and bins that `[0, 15, 5]` may mean."""
    low, high, bins, *_ = [*map(str, numbers), *("0", "1", "20")[len(numbers) :]]
    return f"{{range: [{low}, {high}], bins: {bins}}}"


class MapElitesOptions(MethodOptions):
    """Quality diversity: an archive of the best candidates for each combination of measures."""

    metrics_option = "measures"
    kind: Literal["map_elites"] = "map_elites"
    population: int = Field(default=100, ge=1, le=1_000_000)
    """Candidates in each generation."""
    measures: dict[str, Measure] = Field(default={}, max_length=8)
    """Metrics that describe behaviour, as means over episodes: `{cohesion: {range: [0, 1], bins: 20}}`.
    Required in experiments."""
    initial: int = Field(default=0, ge=0, le=10_000_000)
    """Random candidates before variation, in whole generations; 0: one generation."""
    variation: Literal["auto", "line", "mutation"] = "auto"
    """line: an elite plus a normal step per gene and a normal share of the difference to another elite.
    mutation: the representation's mutation. auto: line for numeric genes, else mutation."""
    step: float = Field(default=0.01, ge=0, le=10)
    """line: standard deviation of steps, relative to the initial range of a gene."""
    line: float = Field(default=0.2, ge=0, le=10)
    """line: standard deviation of the share of the difference."""
    severity: float = Field(default=0.3, ge=0, le=1000)
    """mutation: its size, relative to the initial range of weights and biases."""
    probability: float = Field(default=0.3, ge=0, le=1)
    """mutation: probability that it changes a gene."""

    @field_validator("measures", mode="before")
    @classmethod
    def _check_measures(cls, value: object) -> object:
        return check_metric_mapping(value, "a range", "cohesion", _form([]))

    @model_validator(mode="after")
    def _fits(self) -> Self:
        cells = math.prod(measure.bins for measure in self.measures.values())
        if cells > _MOST_CELLS:
            raise ValueError(f"measures make {cells:,} cells, more than {_MOST_CELLS:,}; use fewer bins")
        return self

    @property
    def needed_metrics(self) -> tuple[str, ...]:
        """Names of the measures."""
        return tuple(self.measures)

    @property
    def grid(self) -> Grid:
        """The archive's cells; a single cell without measures."""
        axes = [Axis(measure.range[0], measure.range[1], measure.bins) for measure in self.measures.values()]
        return Grid(tuple(axes or [Axis(0.0, 1.0, 1)]))


class MapElites(Method):
    """MAP-Elites, whose archive holds the best candidate for each cell of a grid over measures of behaviour.

    Each generation varies random elites and adds candidates that are better than the elite of their cell, or
    whose cell is empty. The result is a collection of controllers that behave differently:
    `swarmwright runs elites RUN`.

    Source: Mouret and Clune, "Illuminating search spaces by mapping elites", arXiv:1504.04909, 2015; the
    variation `line`: Vassiliades and Mouret, "Discovering the elite hypervolume by leveraging interspecies
    correlation", GECCO 2018.
    """

    kind: ClassVar[str] = "map_elites"
    options_model = MapElitesOptions
    options: MapElitesOptions
    start_as = "members"

    def __init__(self, options: MapElitesOptions, representation: Representation, *, seed: int) -> None:
        super().__init__(options, representation, seed=seed)
        self._archive = Archive(options.grid)
        self._genomes: dict[int, Genome] = {}  # by cell

    @classmethod
    def problems(cls, options: MethodOptions, representation: Representation | None) -> dict[str, str]:
        """Refuse numeric variation if genes are choices."""
        invalid = super().problems(options, representation)
        assert isinstance(options, MapElitesOptions)
        if options.variation == "line" and representation is not None and not representation.continuous:
            kind = representation.kind
            invalid["variation"] = f"line needs numeric genes, but those of {kind} are choices; use mutation"
        return invalid

    @property
    def budget(self) -> int:
        """Number of evaluations of the whole run."""
        return self.options.population * self.options.generations

    @property
    def population_fitness(self) -> Fitness:
        """Fitness of all elites; NaN without any."""
        return self._archive.fitness if len(self._archive) else np.full(1, np.nan)

    @property
    def archive(self) -> Archive:
        """The archive, with elites numbered by their evaluation in the run, from 0."""
        return self._archive

    def _ask(self) -> Genomes:
        count = self.options.population
        candidates = range(count)
        if self.generation * count < self.options.initial or not len(self._archive):
            return self.initials(candidates)
        chosen = self.streams("map_elites.choose", candidates).integers(len(self._archive), 2)
        cells = self._archive.cells[chosen].tolist()
        parents, partners = (np.stack([self._genomes[cell[column]] for cell in cells]) for column in (0, 1))
        streams = self.streams("map_elites.vary", candidates)
        if self.options.variation == "line" or (
            self.options.variation == "auto" and self.representation.continuous
        ):
            return self._vary_along_lines(parents, partners, streams.normals(parents.shape[1] + 1))
        options = self.options
        return self.representation.mutations(
            parents, streams, severity=options.severity, probability=options.probability
        )

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

    def _tell(self, genomes: Genomes, fitness: Fitness) -> None:
        measures = self.metrics if self.options.measures else np.zeros((len(genomes), 1))
        numbers = range(self.evaluations, self.evaluations + len(genomes))
        for cell, row in self._archive.add(numbers, fitness, measures):
            self._genomes[cell] = genomes[row].copy()  # a view would keep the whole generation
