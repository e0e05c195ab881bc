"""Elites of a run with several objectives or with quality diversity, made from its record."""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np

from swarmwright.core.errors import InputError
from swarmwright.core.statistics import means
from swarmwright.methods._archive import Archive, Grid, Values, front_with
from swarmwright.methods.map_elites import MapElitesOptions
from swarmwright.methods.nsga2 import Nsga2Options
from swarmwright.typing import Fitness

if TYPE_CHECKING:
    from pathlib import Path

    from matplotlib.figure import Figure

    from swarmwright.runs.run import Run


class Elite(NamedTuple):
    """A candidate of an archive or a front."""

    generation: int
    candidate: int
    """Index among the candidates evaluated in that generation: `run.evaluation(candidate, generation)`."""
    fitness: float
    metrics: dict[str, float]
    """The measures or objectives, by name: means over the candidate's episodes."""


@dataclass(frozen=True)
class Elites:
    """The candidates that a run with several objectives or with quality diversity is made for.

    Attributes:
        kind: "archive" of `map_elites`: the best candidate of each cell. "front" of `nsga2`: the candidates
            of the whole run that no other one dominates.
        goals: of each metric, by name; "measure" in archives, "maximize" or "minimize" in fronts.
        candidates: sorted by fitness, the best first; of candidates of a front that are equal in all values,
            the earliest.
        grid: the cells of an archive, None of fronts.
    """

    kind: Literal["archive", "front"]
    goals: dict[str, str]
    candidates: list[Elite]
    grid: Grid | None

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
        return math.fsum(one.fitness - offset for one in self.candidates)

    def values(self) -> Values:
        """Return fitness and metrics as rows, (candidates, 1 + metrics)."""
        rows = [[one.fitness, *one.metrics.values()] for one in self.candidates]
        return np.array(rows, dtype=np.float64).reshape(len(rows), 1 + len(self.goals))

    def plot(self, path: "str | Path | None" = None) -> "Figure":
        """Return a matplotlib figure: a heat map of the archive, or the front.

        An archive is drawn over its first two measures; where it has more, a cell shows the best of them. A
        front is drawn over fitness and its first metric, colours show the second one.

        Args:
            path: where it is written as well (.png, .svg or .pdf).

        Raises InputError when there is no elite, for another ending, or when the file cannot be written.
        """
        from pathlib import Path  # noqa: PLC0415

        from swarmwright.figures import style  # noqa: PLC0415 - it takes long to import
        from swarmwright.figures.elites import archive, front  # noqa: PLC0415

        if path is not None:
            style.check(Path(path))
        if not self.candidates:
            raise InputError("there is no elite to draw: no candidate has finite fitness and metrics")
        values, names = self.values(), list(self.goals)
        if self.grid is None:
            figure = front(values, names, list(self.goals.values()))
        else:
            seen = Grid(self.grid.axes[:2])
            best = np.full(seen.cells, np.nan)
            np.fmax.at(best, seen.cells_of(values[:, 1:3]), values[:, 0])
            limits = [(one.low, one.high) for one in seen.axes]
            figure = archive(best.reshape(seen.shape), names, limits, (len(values), self.grid.cells))
        if path is not None:
            style.save(figure, Path(path))
        return figure


def has_elites(run: "Run") -> bool:
    """Whether the run was made by a method with an archive or a front."""
    return isinstance(run.experiment.method, MapElitesOptions | Nsga2Options)


def of_run(run: "Run") -> Elites:
    """Return the elites of a run, from its record. Raises InputError for other methods."""
    options = run.experiment.method
    if not isinstance(options, MapElitesOptions | Nsga2Options):
        kind: str = options.kind  # type: ignore[attr-defined] # every kind's options have it
        raise InputError(
            f"{run.path}: was made by {kind}, which has one objective and no archive; runs of map_elites and "
            "nsga2 have elites"
        )
    names = list(options.needed_metrics)
    columns = [run.metrics.index(name) for name in names]
    kept = _Best(options.grid) if isinstance(options, MapElitesOptions) else _Front(options)
    for evaluated in run.store.generations():
        if evaluated.generation >= run.generations:
            break
        kept.add(evaluated.generation, evaluated.fitness, means(evaluated.metrics[:, :, columns]))
    rows = sorted(kept.rows(), key=lambda row: (-row[2], row[0], row[1]))
    found = [
        Elite(generation, candidate, fitness, dict(zip(names, metrics, strict=True)))
        for generation, candidate, fitness, metrics in rows
    ]
    if isinstance(options, MapElitesOptions):
        return Elites("archive", dict.fromkeys(names, "measure"), found, options.grid)
    return Elites("front", dict(options.objectives), found, None)


_Row = tuple[int, int, float, list[float]]
"""Generation, candidate, fitness, metrics."""


class _Best:
    """Elites of cells."""

    def __init__(self, grid: Grid) -> None:
        self._cells = Archive(grid)
        self._rows: dict[int, _Row] = {}

    def add(self, generation: int, fitness: Fitness, metrics: Values) -> None:
        for cell, row in self._cells.add(range(len(fitness)), fitness, metrics):
            self._rows[cell] = generation, row, float(fitness[row]), metrics[row].tolist()

    def rows(self) -> list[_Row]:
        return list(self._rows.values())


class _Front:
    """Candidates that no other one dominates, the first of equal ones."""

    def __init__(self, options: Nsga2Options) -> None:
        self._options = options
        self._rows: list[_Row] = []
        self._values: Values = np.empty((0, 1 + len(options.objectives)))

    def add(self, generation: int, fitness: Fitness, metrics: Values) -> None:
        values = self._options.values(fitness, metrics)
        finite = np.flatnonzero(np.isfinite(values).all(axis=1)).tolist()
        stays, joins = front_with(self._values, values[finite])
        new = [finite[index] for index in np.flatnonzero(joins)]
        self._rows = [row for row, kept in zip(self._rows, stays.tolist(), strict=True) if kept]
        self._rows += [(generation, row, float(fitness[row]), metrics[row].tolist()) for row in new]
        self._values = np.concatenate([self._values[stays], values[new]])

    def rows(self) -> list[_Row]:
        return self._rows
