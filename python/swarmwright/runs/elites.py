"""Elites of a run with several objectives or with quality diversity, made from its record."""

import math
from collections.abc import Container, Iterator, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from swarmwright.common.arrays import Fitness
from swarmwright.common.errors import InputError
from swarmwright.common.statistics import means
from swarmwright.methods.archive import Archive, Axis, Grid, Values, front_with
from swarmwright.methods.map_elites import MapElitesOptions
from swarmwright.methods.nsga2 import Nsga2Options
from swarmwright.simulations.catalogue import description, find_built_in

if TYPE_CHECKING:
    from os import PathLike

    from matplotlib.figure import Figure

    from swarmwright.experiment.experiment import Experiment
    from swarmwright.runs.run import Run
    from swarmwright.servers.rows import GenerationResult


class Elite(NamedTuple):
    """A candidate of an archive or a front."""

    generation: int
    candidate: int
    """Index among the candidates evaluated in that generation: `run.evaluation(candidate, generation)`."""
    fitness: float
    metrics: dict[str, float]
    """The measures or objectives, by name: means over the candidate's episodes."""


class Outside(NamedTuple):
    """Candidates whose measure is outside of its range, and so counts for its first or last bin."""

    below: int
    above: int
    low: float
    high: float
    """The range."""
    lowest: float
    highest: float
    """Of all candidates of the run."""


@dataclass(frozen=True, repr=False)
class Elites:
    """The candidates that a run with several objectives or with quality diversity is made for.

    Attributes:
        kind: "archive" of `map_elites`: the best candidate of each cell. "front" of `nsga2`: the candidates
            of the whole run that no other one dominates.
        goals: of each metric, by name; "measure" in archives, "maximize" or "minimize" in fronts.
        candidates: sorted by fitness, the best first; of candidates of a front that are equal in all values,
            the earliest.
        grid: the cells of an archive, None of fronts.
        evaluated: candidates of the run whose evaluation did not fail.
        missing: how many of them had no finite value of a metric, by its name, and so are no elites; without
            metrics that all had.
        outside: how many of them were outside of the range of a measure, by its name; without measures whose
            range held all.
        partial: how many of `candidates` had no value of a metric in some of their episodes, so that it is
            the mean of the others, by its name; without metrics that have all.
        experiment: of the run; elites of other experiments are equal where the values are.
    """

    kind: Literal["archive", "front"]
    goals: dict[str, str]
    candidates: list[Elite]
    grid: Grid | None
    evaluated: int
    missing: dict[str, int]
    outside: dict[str, Outside]
    partial: dict[str, int]
    experiment: "Experiment" = field(compare=False)

    def __repr__(self) -> str:
        """Return what they are and how many, without each."""
        goals = ", ".join(f"{name} ({goal})" for name, goal in self.goals.items())
        cells = "" if self.grid is None else f" in {self.grid.cells} cells"
        return f"<Elites: {self.kind} of {len(self.candidates)} candidates{cells}; fitness, {goals}>"

    @property
    def notes(self) -> list[str]:
        """What users may not expect: candidates without a metric, and values outside of ranges, in words."""
        found = [
            f"{count:,} of {self.evaluated:,} candidates have no finite value of {name}, and are not in the "
            f"{self.kind}."
            for name, count in self.missing.items()
        ]
        found += [
            f"{name} of {count:,} of the {len(self.candidates):,} elites is the mean of fewer episodes than "
            "they have: in the others it has no value (nan)."
            for name, count in self.partial.items()
        ]
        for name, outside in self.outside.items():
            parts = [(outside.below, "below", "first"), (outside.above, "above", "last")]
            where = " and ".join(f"{count:,} {side}" for count, side, _ in parts if count)
            bins = " and ".join(which for count, _, which in parts if count)
            limits = f"{outside.low:g} to {outside.high:g}"
            found.append(
                f"Of {self.evaluated:,} candidates, {where} the range of {name}, {limits}, count "
                f"for its {bins} bin; values are {outside.lowest:.6g} to {outside.highest:.6g}."
            )
        return found

    @property
    def coverage(self) -> float | None:
        """Share of an archive's cells that have an elite, 0 to 1; None of fronts."""
        return None if self.grid is None else len(self.candidates) / self.grid.cells

    def qd_score(self, offset: float = 0.0) -> float | None:
        """Return the sum over an archive's elites of fitness - offset; None of fronts.

        offset: the worst fitness that there is, so that more elites are never worse (as in pyribs).
        """
        if self.grid is None:
            return None
        return math.fsum(candidate.fitness - offset for candidate in self.candidates)

    def values(self) -> Values:
        """Return fitness and metrics as rows, (candidates, 1 + metrics)."""
        rows = [[candidate.fitness, *candidate.metrics.values()] for candidate in self.candidates]
        return np.array(rows, dtype=np.float64).reshape(len(rows), 1 + len(self.goals))

    def plot(self, path: "str | PathLike[str] | None" = None) -> "Figure":
        """Return a matplotlib figure: a heat map of the archive, or the front.

        An archive is drawn over its first two measures; where it has more, a cell shows the best of them. A
        front is drawn over fitness and its first metric, colours show the second one.

        Args:
            path: where it is written as well (.png, .svg or .pdf).

        Raises InputError when there is no elite, for another ending, or when the file cannot be written.
        """
        from pathlib import Path  # noqa: PLC0415

        from swarmwright.display.figures import style  # noqa: PLC0415 - it takes long to import
        from swarmwright.display.figures.elites import archive, front  # noqa: PLC0415
        from swarmwright.display.figures.run import title_of  # noqa: PLC0415

        if path is not None:
            style.check(Path(path))
        if not self.candidates:
            raise InputError("there is no elite to draw: no candidate has finite fitness and metrics")
        values, names, heading = self.values(), self._metric_labels(), title_of(self.experiment)
        if self.grid is None:
            figure = front(values, names, list(self.goals.values()), heading)
        else:
            seen = Grid(self.grid.axes[:2])
            best = np.full(seen.cells, np.nan)
            np.fmax.at(best, seen.cells_of(values[:, 1:3]), values[:, 0])
            limits = [(axis.low, axis.high) for axis in seen.axes]
            figure = archive(best.reshape(seen.shape), names, limits, (len(values), self.grid.cells), heading)
        if path is not None:
            style.save(figure, Path(path))
        return figure

    def _metric_labels(self) -> list[str]:
        """Return what figures call the metrics: in words, with the unit where it is known."""
        known: dict[str, dict[str, str]] = {}
        simulation, parameters = self.experiment.simulation, self.experiment.parameters
        if find_built_in(simulation) is not None:
            known = description(simulation, parameters)["metrics"]
        units = [known.get(name, {}).get("unit", "") for name in self.goals]
        words = (name.replace("_", " ") for name in self.goals)
        return [f"{name}, {unit}" if unit else name for name, unit in zip(words, units, strict=True)]


def has_elites(run: "Run") -> bool:
    """Whether the run was made by a method with an archive or a front."""
    return isinstance(run.experiment.method, MapElitesOptions | Nsga2Options)


def of_run(run: "Run", at: int | None = None) -> Elites:
    """Return the elites of a run, from its record. Raises InputError for other methods.

    at: of its first so many evaluations; None: of all.
    """
    collected = _Collected(run)
    left = run.evaluations if at is None else at
    for evaluated in run._store.generations():
        if evaluated.generation >= run.generations or left <= 0:
            break
        left -= collected.add(evaluated, left)
    return collected.elites()


def over_generations(run: "Run", chosen: Container[int]) -> Iterator[tuple[int, Elites]]:
    """Yield the elites of a run as they were at the end of these generations, with the generation's number.

    Raises InputError for other methods.
    """
    collected = _Collected(run)
    for evaluated in run._store.generations():
        if evaluated.generation >= run.generations:
            break
        collected.add(evaluated, len(evaluated.fitness))
        if evaluated.generation in chosen:
            yield evaluated.generation, collected.elites()


class _Collected:
    """Elites of a run whose generations are added one after the other."""

    def __init__(self, run: "Run") -> None:
        options = run.experiment.method
        if not isinstance(options, MapElitesOptions | Nsga2Options):
            kind: str = options.kind
            raise InputError(
                f"{run.path}: was made by {kind}, which has one objective and no archive; runs of map_elites "
                "and nsga2 have elites"
            )
        self._experiment = run.experiment
        self._options = options
        self._names = list(options.needed_metrics)
        self._columns = [run.metrics.index(name) for name in self._names]
        if isinstance(options, MapElitesOptions):
            self._kept: _Best | _Front = _Best(options.grid)
            self._seen = _Metrics(self._names, options.grid.axes)
        else:
            self._kept = _Front(options)
            self._seen = _Metrics(self._names, ())

    def add(self, evaluated: "GenerationResult", count: int) -> int:
        """Add the first `count` candidates of a generation, or all where it has fewer; return how many."""
        fitness, episodes = evaluated.fitness[:count], evaluated.metrics[:count, :, self._columns]
        values = means(episodes)
        self._kept.add(
            evaluated.generation, fitness, values, np.logical_or.reduce(np.isnan(episodes), axis=1)
        )
        self._seen.add(fitness, values)
        return len(fitness)

    def elites(self) -> Elites:
        """Return those so far."""
        rows = sorted(self._kept.rows(), key=lambda row: (-row[2], row[0], row[1]))
        found = [
            Elite(generation, candidate, fitness, dict(zip(self._names, metrics, strict=True)))
            for generation, candidate, fitness, metrics, _ in rows
        ]
        gaps = np.array([row[4] for row in rows], dtype=bool).reshape(len(rows), len(self._names)).sum(axis=0)
        partial = {name: count for name, count in zip(self._names, gaps.tolist(), strict=True) if count}
        counts = self._seen.candidates, self._seen.missing(), self._seen.outside(), partial
        options = self._options
        if isinstance(options, MapElitesOptions):
            goals = dict.fromkeys(self._names, "measure")
            return Elites("archive", goals, found, options.grid, *counts, self._experiment)
        return Elites("front", dict(options.objectives), found, None, *counts, self._experiment)


_Row = tuple[int, int, float, list[float], list[bool]]
"""Generation, candidate, fitness, metrics, and which of them had no value in some episodes."""


def _row(generation: int, row: int, fitness: Fitness, metrics: Values, gaps: NDArray[np.bool_]) -> _Row:
    return generation, row, float(fitness[row]), metrics[row].tolist(), gaps[row].tolist()


class _Best:
    """Elites of cells."""

    def __init__(self, grid: Grid) -> None:
        self._cells = Archive(grid)
        self._rows: dict[int, _Row] = {}

    def add(self, generation: int, fitness: Fitness, metrics: Values, gaps: NDArray[np.bool_]) -> None:
        for cell, row in self._cells.add(range(len(fitness)), fitness, metrics):
            self._rows[cell] = _row(generation, row, fitness, metrics, gaps)

    def rows(self) -> list[_Row]:
        return list(self._rows.values())


class _Front:
    """Candidates that no other one dominates, the first of equal ones."""

    def __init__(self, options: Nsga2Options) -> None:
        self._options = options
        self._rows: list[_Row] = []
        self._values: Values = np.empty((0, 1 + len(options.objectives)))

    def add(self, generation: int, fitness: Fitness, metrics: Values, gaps: NDArray[np.bool_]) -> None:
        values = self._options.values(fitness, metrics)
        finite = np.flatnonzero(np.isfinite(values).all(axis=1)).tolist()
        stays, joins = front_with(self._values, values[finite])
        new = [finite[index] for index in np.flatnonzero(joins)]
        self._rows = [row for row, kept in zip(self._rows, stays.tolist(), strict=True) if kept]
        self._rows += [_row(generation, row, fitness, metrics, gaps) for row in new]
        self._values = np.concatenate([self._values[stays], values[new]])

    def rows(self) -> list[_Row]:
        return self._rows


class _Metrics:
    """What values the metrics of all candidates have that did not fail.

    axes: the ranges of measures; none for objectives.
    """

    def __init__(self, names: list[str], axes: Sequence[Axis]) -> None:
        self.candidates = 0
        self._names, self._axes = names, axes
        count = len(names)
        self._missing, self._below, self._above = (np.zeros(count, dtype=np.int64) for _ in range(3))
        self._lowest, self._highest = np.full(count, np.inf), np.full(count, -np.inf)

    def add(self, fitness: Fitness, metrics: Values) -> None:
        values = metrics[np.isfinite(fitness)]
        known = np.isfinite(values)
        self.candidates += len(values)
        self._missing += (~known).sum(axis=0)
        for column, axis in enumerate(self._axes):
            of = values[known[:, column], column]
            self._below[column] += (of < axis.low).sum()
            self._above[column] += (of > axis.high).sum()
            self._lowest[column] = min(self._lowest[column], of.min(initial=np.inf))
            self._highest[column] = max(self._highest[column], of.max(initial=-np.inf))

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
