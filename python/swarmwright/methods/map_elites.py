"""MAP-Elites: the best candidates for each kind of behaviour."""

import math
import sys
from typing import Any, ClassVar, Literal, Self

import numpy as np
from pydantic import Field, field_validator, model_validator

from swarmwright.common.arrays import Fitness, Genome, Genomes
from swarmwright.common.options import Options
from swarmwright.controllers import Representation
from swarmwright.methods._base import Method, MethodOptions, by_metric
from swarmwright.methods._numbers import center_and_reach
from swarmwright.methods.archive import Archive, Axis, Grid, Values

_MOST_CELLS = 1_000_000
"""Cells of an archive."""


class Measure(Options):
    """How a metric divides the archive."""

    range: list[float] = Field(min_length=2, max_length=2)
    """Lowest and highest value; what lies beyond them belongs to the first or the last bin."""
    bins: int = Field(default=20, ge=1, le=10_000)
    """Into how many parts the range is divided."""

    @model_validator(mode="before")
    @classmethod
    def _with_keys(cls, given: object) -> object:
        if isinstance(given, list):
            raise ValueError(f"must have the form {_form(given)}")
        return given

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        low, high = self.range
        if not low < high:
            raise ValueError(f"range must be [low, high] with low < high, not [{low:g}, {high:g}]")
        if not math.isfinite(high - low):
            raise ValueError(f"range [{low:g}, {high:g}] is too wide: its width is not a finite number")
        if (high - low) / self.bins < sys.float_info.min:
            raise ValueError(
                f"range [{low:g}, {high:g}] is too narrow for {self.bins} bins: each would be narrower than "
                f"{sys.float_info.min:.3g}, the smallest number with all its digits"
            )
        return self


def _form(numbers: list[Any]) -> str:
    """Return how a measure is written, with a range and bins that may be meant by `[0, 15, 5]`."""
    low, high, bins, *_ = [*map(str, numbers), *("0", "1", "20")[len(numbers) :]]
    return f"{{range: [{low}, {high}], bins: {bins}}}"


class MapElitesOptions(MethodOptions):
    """Quality diversity: an archive of the best candidates for each combination of measures."""

    metrics_option = "measures"
    kind: Literal["map_elites"] = "map_elites"
    population: int = Field(default=100, ge=1, le=1_000_000)
    """Candidates in each generation."""
    measures: dict[str, Measure] = Field(default={}, max_length=8)
    """Metrics that describe behaviour, with their ranges: `measures: {cohesion: {range: [0, 1], bins: 20}}`.
    A candidate's measure is the mean of the metric over its episodes. Required in experiments."""
    initial: int = Field(default=0, ge=0, le=10_000_000)
    """Random candidates before variation begins, in whole generations; 0: one generation."""
    variation: Literal["auto", "line", "mutation"] = "auto"
    """line: an elite plus a normal step in each gene, plus a normal share of the difference to another elite.
    mutation: the mutation of the representation. auto: line where genes are numbers, else mutation."""
    step: float = Field(default=0.01, ge=0, le=10)
    """line: standard deviation of the step in each gene, as a share of its initial range."""
    line: float = Field(default=0.2, ge=0, le=10)
    """line: standard deviation of the share of the difference."""
    severity: float = Field(default=0.3, ge=0, le=1000)
    """mutation: its size, as a share of the initial range of weights and biases."""
    probability: float = Field(default=0.3, ge=0, le=1)
    """mutation: probability of a gene to be changed."""

    @field_validator("measures", mode="before")
    @classmethod
    def _ranges(cls, given: object) -> object:
        return by_metric(given, "a range", "cohesion", _form([]))

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
        """The archive's cells; one where there are no measures."""
        axes = [Axis(measure.range[0], measure.range[1], measure.bins) for measure in self.measures.values()]
        return Grid(tuple(axes or [Axis(0.0, 1.0, 1)]))


class MapElites(Method):
    """An archive holds the best candidate found for each cell of a grid over measures of behaviour.

    Each generation takes elites at random, varies them, and puts what is better than the elite of its cell,
    or comes to an empty cell, into the archive. The result is not one controller but many that behave
    differently: `swarmwright runs elites RUN`.

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
        """Refuse the variation of numbers where genes are choices."""
        found = super().problems(options, representation)
        assert isinstance(options, MapElitesOptions)
        if options.variation == "line" and representation is not None and not representation.continuous:
            kind = representation.kind
            found["variation"] = (
                f"line needs genes that are numbers; those of {kind} are choices, take mutation"
            )
        return found

    @property
    def budget(self) -> int:
        """Number of evaluations of the whole run."""
        return self.options.population * self.options.generations

    @property
    def population_fitness(self) -> Fitness:
        """Fitness of all elites; NaN while there is none."""
        return self._archive.fitness if len(self._archive) else np.full(1, np.nan)

    @property
    def archive(self) -> Archive:
        """The archive, whose elites are numbered by their evaluation, from 0 in the run."""
        return self._archive

    def _ask(self) -> Genomes:
        count = self.options.population
        candidates = range(count)
        if self.generation * count < self.options.initial or not len(self._archive):
            return self.initials(candidates)
        chosen = self.streams("map_elites.choose", candidates).integers(len(self._archive), 2)
        cells = self._archive.cells[chosen].tolist()
        parents, others = (np.stack([self._genomes[cell[place]] for cell in cells]) for place in (0, 1))
        streams = self.streams("map_elites.vary", candidates)
        if self.options.variation == "line" or (
            self.options.variation == "auto" and self.representation.continuous
        ):
            return self._along_lines(parents, others, streams.normals(parents.shape[1] + 1))
        options = self.options
        return self.representation.mutations(
            parents, streams, severity=options.severity, probability=options.probability
        )

    def _along_lines(self, parents: Genomes, others: Genomes, normals: Values) -> Genomes:
        """normals: (n, genome_size + 1)."""
        _, reach = center_and_reach(self.representation)
        begin = parents.astype(np.float64)
        steps = normals[:, 1:] * (self.options.step * 2 * reach)
        lines = (others - begin) * (self.options.line * normals[:, :1])
        lower, upper = self.representation.bounds
        largest = np.finfo(np.float32).max
        along_lines = np.clip(begin + steps + lines, np.maximum(lower, -largest), np.minimum(upper, largest))
        return along_lines.astype(np.float32)

    def _tell(self, genomes: Genomes, fitness: Fitness) -> None:
        measures = self.metrics if self.options.measures else np.zeros((len(genomes), 1))
        numbers = range(self.evaluations, self.evaluations + len(genomes))
        for cell, row in self._archive.add(numbers, fitness, measures):
            self._genomes[cell] = genomes[row].copy()  # a view would keep the whole generation
