"""Elites of a multi-objective or quality-diversity run, computed from its record."""

import math
from collections import deque
from collections.abc import Container, Iterator, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from swarmwright.common.arrays import Fitness
from swarmwright.common.errors import InputError
from swarmwright.common.statistics import means
from swarmwright.methods._base import MethodOptions
from swarmwright.methods._pareto import ParetoOptions
from swarmwright.methods.archive import Axis, Cells, Grid, Values, front_with
from swarmwright.methods.map_elites import MapElitesOptions
from swarmwright.methods.novelty import NoveltyOptions
from swarmwright.methods.sampled_archive import SampledArchive
from swarmwright.methods.voronoi import Voronoi
from swarmwright.simulations.catalogue import description, find_built_in

if TYPE_CHECKING:
    from os import PathLike

    from matplotlib.figure import Figure

    from swarmwright.experiment.experiment import Experiment
    from swarmwright.runs.run import Run


class Elite(NamedTuple):
    """A candidate of an archive or a front."""

    generation: int
    candidate: int
    """Index in that generation, for `run.evaluation(candidate, generation)`."""
    fitness: float
    metrics: dict[str, float]
    """Measures or objectives by name: means over the candidate's episodes."""
    evaluations: int = 1
    """Number of evaluations of which fitness and metrics are means; more than one only with `reevaluate`."""
    interval: tuple[float, float] | None = None
    """95 % confidence interval of the fitness; None with a single evaluation."""


class Outside(NamedTuple):
    """Candidates whose measure is outside its range, so that they are in its first or last bin."""

    below: int
    """Number of candidates below the range."""
    above: int
    """Number of candidates above the range."""
    low: float
    """Lower end of the range."""
    high: float
    """Upper end of the range."""
    lowest: float
    """Smallest value of all candidates of the run."""
    highest: float
    """Largest value of all candidates of the run."""


@dataclass(frozen=True, repr=False)
class Elites:
    """The elites of a multi-objective or quality-diversity run.

    Attributes:
        kind: "archive" of `map_elites` and `novelty`, with the best candidate of each cell, or "front" of
            `nsga2` or `nsga3`, with the non-dominated candidates of the whole run.
        goals: goal of each metric by name: "measure" in archives, "maximize" or "minimize" in fronts.
        candidates: sorted by fitness, the best first; a front has the earliest of candidates that are equal
            in all values.
        cells: the cells of an archive, `Grid` or `Voronoi`; None for unstructured archives and fronts.
        evaluated: number of successfully evaluated candidates of the run.
        missing: for each incomplete metric, the number of these candidates without a finite value, which
            cannot be elites.
        outside: for each measure with values outside its range, the numbers of these candidates.
        partial: for each metric that is missing in some episodes of elites, the number of these elites, whose
            value is the mean of the other episodes.
        experiment: experiment of the run; not compared by `==`.
    """

    kind: Literal["archive", "front"]
    goals: dict[str, str]
    candidates: list[Elite]
    cells: Cells | None
    evaluated: int
    missing: dict[str, int]
    outside: dict[str, Outside]
    partial: dict[str, int]
    experiment: "Experiment" = field(compare=False)

    def __repr__(self) -> str:
        """Return the kind and the number of elites."""
        goals = ", ".join(f"{name} ({goal})" for name, goal in self.goals.items())
        cells = "" if self.cells is None else f" in {self.cells.cells} cells"
        return f"<Elites: {self.kind} of {len(self.candidates)} candidates{cells}; fitness, {goals}>"

    @property
    def notes(self) -> list[str]:
        """Notes on candidates without a metric, partial means, and values outside of ranges."""
        notes = [
            f"{count:,} of {self.evaluated:,} candidates have no finite value of {name}, and are not in the "
            f"{self.kind}."
            for name, count in self.missing.items()
        ]
        notes += [
            f"{count:,} of the {len(self.candidates):,} elites have no value of {name} (nan) in some "
            "episodes; their value is the mean of the others."
            for name, count in self.partial.items()
        ]
        for name, outside in self.outside.items():
            parts = [(outside.below, "below", "first"), (outside.above, "above", "last")]
            counts = " and ".join(f"{count:,} {side}" for count, side, _ in parts if count)
            bins = " and ".join(bin_ for count, _, bin_ in parts if count)
            where = f"for its {bins} bin" if isinstance(self.cells, Grid) else "as its end"
            limits = f"{outside.low:g} to {outside.high:g}"
            notes.append(
                f"{counts} of {self.evaluated:,} candidates are outside the range of {name}, {limits}, and "
                f"count {where}; values are {outside.lowest:.6g} to {outside.highest:.6g}."
            )
        return notes

    @property
    def coverage(self) -> float | None:
        """Share of an archive's cells that have an elite, 0 to 1; None without cells."""
        return None if self.cells is None else len(self.candidates) / self.cells.cells

    def qd_score(self, offset: float = 0.0) -> float | None:
        """Return the sum of fitness - offset over an archive's elites; None for fronts.

        offset: the worst possible fitness, so that additional elites never lower the score (as in pyribs).
        """
        if self.kind == "front":
            return None
        return math.fsum(candidate.fitness - offset for candidate in self.candidates)

    def values(self) -> Values:
        """Return fitness and metrics as rows, (candidates, 1 + metrics)."""
        rows = [[candidate.fitness, *candidate.metrics.values()] for candidate in self.candidates]
        return np.array(rows, dtype=np.float64).reshape(len(rows), 1 + len(self.goals))

    def plot(self, path: "str | PathLike[str] | None" = None) -> "Figure":
        """Draw a heat map of the archive, or the front; return the matplotlib figure.

        An archive is drawn over its first two measures; with more measures, each cell of a grid shows the
        best of its elites. An unstructured archive, and one of Voronoi cells unless it has two measures, is
        drawn as points. A front is drawn over fitness and its first metric; colours show the second metric.

        Args:
            path: file to write (.png, .svg or .pdf); by default none.

        Raises InputError when there is no elite, for another file type, or when the file cannot be written.
        """
        from pathlib import Path  # noqa: PLC0415

        from swarmwright.display.figures import elites as drawing  # noqa: PLC0415
        from swarmwright.display.figures import style  # noqa: PLC0415 - it takes long to import
        from swarmwright.display.figures.run import title_of  # noqa: PLC0415

        if path is not None:
            style.check_figure_path(Path(path))
        if not self.candidates:
            raise InputError("there is no elite to draw: no candidate has finite fitness and metrics")
        values, names, heading = self.values(), self._metric_labels(), title_of(self.experiment)
        filled = len(values), 0 if self.cells is None else self.cells.cells
        limits = [] if self.cells is None else [(axis.low, axis.high) for axis in self.cells.axes[:2]]
        if self.kind == "front":
            figure = drawing.draw_front(values, names, list(self.goals.values()), heading)
        elif isinstance(self.cells, Grid):
            plane = Grid(self.cells.axes[:2])
            best = np.full(plane.cells, np.nan)
            np.fmax.at(best, plane.cells_of(values[:, 1:3]), values[:, 0])
            figure = drawing.draw_archive(best.reshape(plane.shape), names, limits, filled, heading)
        elif isinstance(self.cells, Voronoi) and len(names) == 2:
            best = np.full(self.cells.cells, np.nan)
            best[self.cells.cells_of(values[:, 1:])] = values[:, 0]
            figure = drawing.draw_voronoi(best, self.cells.centroids, names, limits, filled, heading)
        else:
            figure = drawing.draw_points(values, names, limits, filled, heading)
        if path is not None:
            style.save(figure, Path(path))
        return figure

    def _metric_labels(self) -> list[str]:
        """Return labels of the metrics for figures, with the unit if it is known."""
        descriptions: dict[str, dict[str, str]] = {}
        simulation, parameters = self.experiment.simulation, self.experiment.parameters
        if find_built_in(simulation) is not None:
            descriptions = description(simulation, parameters)["metrics"]
        units = [descriptions.get(name, {}).get("unit", "") for name in self.goals]
        labels = (name.replace("_", " ") for name in self.goals)
        return [f"{label}, {unit}" if unit else label for label, unit in zip(labels, units, strict=True)]


def has_elites(run: "Run") -> bool:
    """Return whether the run's method has an archive or a front."""
    return isinstance(options_of_elites(run), MapElitesOptions | ParetoOptions)


def options_of_elites(run: "Run") -> MethodOptions:
    """Return the options that decide which candidates are elites: for `novelty`, those of an archive."""
    method = run.experiment.method
    return method.elites if isinstance(method, NoveltyOptions) else method


def compute_elites(run: "Run", evaluations: int | None = None) -> Elites:
    """Compute the elites of a run from its record. Raises InputError for other methods.

    evaluations: use only the first `evaluations` evaluations; None for all.
    """
    collector = EliteCollector(run)
    remaining, first = run.evaluations if evaluations is None else evaluations, 0
    for generation in run._store.generations():
        if generation.generation >= run.generations or remaining <= first:
            break
        count = remaining - first
        collector.add(first, generation.fitness[:count], generation.metrics[:count])
        first += len(generation.fitness)
    return collector.elites()


def compute_elites_over_generations(run: "Run", chosen: Container[int]) -> Iterator[tuple[int, Elites]]:
    """Yield the number of each chosen generation with the elites at its end.

    Only fitness and metrics are read, in large parts, without checking digests: ten million evaluations take
    seconds.

    Raises InputError for other methods.
    """
    return EliteCollector(run).follow(run, chosen)


class EliteCollector:
    """Collects the elites of a run, part by part. Raises InputError for methods that have none."""

    def __init__(self, run: "Run") -> None:
        options = options_of_elites(run)
        if not isinstance(options, MapElitesOptions | ParetoOptions):
            kind: str = options.kind
            raise InputError(
                f"{run.path}: has no elites, since {kind} has a single objective and no archive; use a run "
                "of map_elites, novelty, nsga2 or nsga3"
            )
        self._experiment = run.experiment
        self._options = options
        self._names = list(options.needed_metrics)
        self._columns = [run.metrics.index(name) for name in self._names]
        self._ends = run._store.ends()
        self._read = 0  # evaluations
        if isinstance(options, MapElitesOptions):
            self._elites: _Best | _SampledBest | _Front = (
                _SampledBest(options) if options.reevaluate else _Best(options)
            )
            self._metrics = _Metrics(self._names, () if options.cells is None else options.axes)
        else:
            self._elites = _Front(options)
            self._metrics = _Metrics(self._names, ())

    def follow(self, run: "Run", chosen: Container[int]) -> Iterator[tuple[int, Elites]]:
        """Read the evaluations that were not read yet; see `compute_elites_over_generations`.

        run: the same run, opened later. chosen: generations, of which those that were read are left out.
        """
        self._ends = run._store.ends()
        numbers = np.flatnonzero(self._ends > self._read).tolist()
        borders = deque((int(self._ends[number]), number) for number in numbers if number in chosen)
        for first, fitness, metrics in run._store.iterate_parts([end for end, _ in borders], self._read):
            self.add(first, fitness, metrics)
            while borders and borders[0][0] <= self._read:
                yield borders.popleft()[1], self.elites()

    def add(self, first: int, fitness: Fitness, metrics: NDArray[np.float64]) -> None:
        """Add evaluations.

        Args:
            first: number of the first in the run.
            fitness: (n,).
            metrics: (n, episodes, metrics), all that are stored.
        """
        episodes = metrics[:, :, self._columns]
        values = means(episodes)
        gaps = np.logical_or.reduce(np.isnan(episodes), axis=1)
        self._elites.add(_Rows(np.arange(first, first + len(fitness)), fitness, values, gaps))
        self._metrics.add(fitness, values)
        self._read = first + len(fitness)

    def elites(self) -> Elites:
        """Return the elites so far."""
        every = self._elites.rows()
        rows = every.select(np.lexsort((every.numbers, -every.fitness)))
        generations = np.searchsorted(self._ends, rows.numbers, side="right")
        starts = np.concatenate([[0], self._ends])[generations]
        candidates = [
            Elite(
                generation,
                candidate,
                fitness,
                dict(zip(self._names, metrics, strict=True)),
                *self._elites.evidence(number),
            )
            for number, generation, candidate, fitness, metrics in zip(
                rows.numbers.tolist(),
                generations.tolist(),
                (rows.numbers - starts).tolist(),
                rows.fitness.tolist(),
                rows.metrics.tolist(),
                strict=True,
            )
        ]
        gaps = rows.gaps.sum(axis=0).tolist()
        partial = {name: count for name, count in zip(self._names, gaps, strict=True) if count}
        counts = self._metrics.candidates, self._metrics.missing(), self._metrics.outside(), partial
        options = self._options
        if isinstance(options, MapElitesOptions):
            goals = dict.fromkeys(self._names, "measure")
            return Elites("archive", goals, candidates, options.cells, *counts, self._experiment)
        return Elites("front", dict(options.objectives), candidates, None, *counts, self._experiment)


Evidence = tuple[int, tuple[float, float] | None]
"""Number of evaluations, and the confidence interval of the fitness."""
_COLUMNS = ("numbers", "fitness", "metrics", "gaps")


@dataclass(frozen=True, eq=False)
class _Rows:
    """Evaluations as columns."""

    numbers: NDArray[np.int64]
    """(n,), in the run."""
    fitness: Fitness
    """(n,)"""
    metrics: Values
    """(n, metrics)"""
    gaps: NDArray[np.bool_]
    """(n, metrics), whether each metric has no value in some episodes."""

    @classmethod
    def zeros(cls, count: int, metrics: int) -> "_Rows":
        """Return empty rows."""
        shape = count, metrics
        return cls(np.zeros(count, np.int64), np.zeros(count), np.zeros(shape), np.zeros(shape, bool))

    def join(self, rows: "_Rows") -> "_Rows":
        """Return these rows, followed by others."""
        return _Rows(*(np.concatenate([getattr(self, name), getattr(rows, name)]) for name in _COLUMNS))

    def select(self, rows: NDArray[Any]) -> "_Rows":
        """Return some rows."""
        return _Rows(self.numbers[rows], self.fitness[rows], self.metrics[rows], self.gaps[rows])


class _Best:
    """The elites of an archive."""

    def __init__(self, options: MapElitesOptions) -> None:
        archive = options.new_archive()
        assert not isinstance(archive, SampledArchive)
        self._archive = archive
        count = 0 if options.cells is None else options.cells.cells
        self._rows = _Rows.zeros(count, len(options.measures))

    def add(self, rows: _Rows) -> None:
        measures = rows.metrics if rows.metrics.shape[1] else np.zeros((len(rows.fitness), 1))
        cells, chosen = self._archive.add(range(len(rows.fitness)), rows.fitness, measures).T
        if cells.max(initial=-1) >= len(self._rows.fitness):  # only an unstructured archive grows
            more = _Rows.zeros(int(cells.max()) + 1, rows.metrics.shape[1])
            self._rows = self._rows.join(more)
        for name in _COLUMNS:
            getattr(self._rows, name)[cells] = getattr(rows, name)[chosen]

    def rows(self) -> _Rows:
        return self._rows.select(self._archive.cells)

    def evidence(self, _number: int) -> Evidence:
        return 1, None


class _SampledBest:
    """The elites of an archive whose candidates are evaluated again."""

    def __init__(self, options: MapElitesOptions) -> None:
        archive = options.new_archive()
        assert isinstance(archive, SampledArchive)
        self._archive = archive
        self._gaps: dict[int, NDArray[np.bool_]] = {}
        """Of the evaluations that lack metrics in some episodes, by number."""
        self._none = np.zeros(len(options.measures), dtype=bool)

    def add(self, rows: _Rows) -> None:
        self._archive.add(rows.numbers, rows.fitness, rows.metrics)
        for row in np.flatnonzero(rows.gaps.any(axis=1)).tolist():
            self._gaps[int(rows.numbers[row])] = rows.gaps[row]

    def rows(self) -> _Rows:
        elites = self._archive.elites
        empty = _Rows.zeros(len(elites), len(self._none))
        for row, elite in enumerate(elites):
            empty.metrics[row] = elite.measures
            for number in elite.rows:
                empty.gaps[row] |= self._gaps.get(number, self._none)
        return _Rows(self._archive.numbers, self._archive.fitness, empty.metrics, empty.gaps)

    def evidence(self, number: int) -> Evidence:
        elite = self._archive.members[number]
        return elite.evaluations, elite.interval


class _Front:
    """The non-dominated candidates, the first of equals."""

    def __init__(self, options: ParetoOptions) -> None:
        self._options = options
        count = len(options.objectives)
        self._rows = _Rows.zeros(0, count)
        self._values: Values = np.empty((0, 1 + count))

    def add(self, rows: _Rows) -> None:
        values = self._options.values(rows.fitness, rows.metrics)
        finite = np.flatnonzero(np.isfinite(values).all(axis=1))
        stays, joins = front_with(self._values, values[finite])
        old, new = self._rows.select(stays), rows.select(finite[joins])
        self._rows = old.join(new)
        self._values = np.concatenate([self._values[stays], values[finite[joins]]])

    def rows(self) -> _Rows:
        return self._rows

    def evidence(self, _number: int) -> Evidence:
        return 1, None


class _Metrics:
    """Counts and ranges of the metrics of all successful candidates.

    axes: the ranges of measures; empty for objectives.
    """

    def __init__(self, names: list[str], axes: Sequence[Axis]) -> None:
        self.candidates = 0
        self._names, self._axes = names, axes
        count = len(names)
        self._missing, self._below, self._above = (np.zeros(count, dtype=np.int64) for _ in range(3))
        self._lowest, self._highest = np.full(count, np.inf), np.full(count, -np.inf)

    def add(self, fitness: Fitness, metrics: Values) -> None:
        values = metrics[np.isfinite(fitness)]
        is_finite = np.isfinite(values)
        self.candidates += len(values)
        self._missing += (~is_finite).sum(axis=0)
        for column, axis in enumerate(self._axes):
            measure = values[is_finite[:, column], column]
            self._below[column] += (measure < axis.low).sum()
            self._above[column] += (measure > axis.high).sum()
            self._lowest[column] = min(self._lowest[column], measure.min(initial=np.inf))
            self._highest[column] = max(self._highest[column], measure.max(initial=-np.inf))

    def missing(self) -> dict[str, int]:
        counts = zip(self._names, self._missing.tolist(), strict=True)
        return {name: count for name, count in counts if count}

    def outside(self) -> dict[str, Outside]:
        numbers = (self._below, self._above, self._lowest, self._highest)
        rows = zip(self._names, self._axes, *(number.tolist() for number in numbers), strict=False)
        return {
            name: Outside(below, above, axis.low, axis.high, lowest, highest)
            for name, axis, below, above, lowest, highest in rows
            if below or above
        }
