"""An archive for noisy evaluations, whose elites and challengers are evaluated again."""

import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from heapq import heappop, heappush
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from swarmwright.common.arrays import Fitness
from swarmwright.common.statistics import student_t
from swarmwright.methods.archive import Cells, Values, subtract

_LARGEST = sys.float_info.max
_ENOUGH = 10
"""Evaluations with which a challenger may replace an elite that has more."""


@dataclass
class Sampled:
    """A candidate with the means of its evaluations."""

    number: int
    """Number of its first evaluation in the run."""
    measures: NDArray[np.float64]
    """Mean of each measure."""
    fitness: float
    """Mean fitness."""
    cell: int
    evaluations: int = 1
    squares: float = 0.0
    """Sum of squared differences from the mean fitness."""
    rows: list[int] = field(default_factory=list)
    """Numbers of its evaluations in the run."""

    def add(self, number: int, fitness: float, measures: NDArray[np.float64]) -> None:
        """Add an evaluation, by the method of Welford."""
        self.rows.append(number)
        self.evaluations += 1
        difference = min(max(fitness - self.fitness, -_LARGEST), _LARGEST)
        self.fitness += difference / self.evaluations
        self.squares += difference * (fitness - self.fitness)
        self.measures = self.measures + subtract(measures, self.measures) / self.evaluations

    @property
    def interval(self) -> tuple[float, float] | None:
        """Student's 95 % confidence interval of the mean fitness; None with a single evaluation."""
        count = self.evaluations
        if count < 2:
            return None
        reach = student_t(count - 1) * sqrt(self.squares / (count - 1) / count)
        return self.fitness - reach, self.fitness + reach


class SampledArchive:
    """The best candidate of each cell by the means of repeated evaluations.

    A share of each generation evaluates candidates again: first the challengers, then the elites with the
    fewest evaluations. A candidate with a higher mean than the elite of its cell challenges it, and replaces
    it once it has as many evaluations, or 10. An elite whose mean measures leave its cell moves, or is
    dropped if the elite there is better; it is also dropped if an evaluation fails. Candidates are added one
    after the other, so that the archive does not depend on how they are divided into batches.

    Source: adaptive sampling of Justesen, Risi and Mouret, "MAP-Elites for noisy domains by adaptive
    sampling", GECCO 2019, with a challenger that is sampled over generations instead of at once.
    """

    def __init__(self, division: Cells, *, population: int, share: float) -> None:
        """Create an empty archive.

        Args:
            division: the cells.
            population: candidates of each generation.
            share: largest share of a generation that is evaluated again.
        """
        self.division = division
        self._population, self._slots = population, int(share * population)
        self._candidates: dict[int, Sampled] = {}
        """Elites and challengers by number."""
        self._elites: dict[int, Sampled] = {}  # by cell
        self._challengers: dict[int, Sampled] = {}  # by cell
        self._queue: list[tuple[int, int]] = []
        """A heap of (evaluations, number) of elites; some are outdated."""
        self._planned: list[int] | None = None

    def __len__(self) -> int:
        """Return the number of cells with an elite."""
        return len(self._elites)

    @property
    def planned(self) -> list[int]:
        """Numbers of the candidates that the next generation evaluates again, first of all."""
        if self._planned is None:
            self._planned = sorted(each.number for each in self._challengers.values())[: self._slots]
            while self._queue and len(self._planned) < self._slots:
                evaluations, number = heappop(self._queue)
                elite = self._candidates.get(number)
                if elite is not None and elite.evaluations == evaluations:
                    self._planned.append(number)
        return self._planned

    def add(self, numbers: Sequence[int] | NDArray[np.int64], fitness: Fitness, measures: Values) -> None:
        """Add consecutive evaluations: of each generation first the planned ones, then new candidates.

        New candidates without finite fitness and measures are skipped.

        Args:
            numbers: numbers of the evaluations in the run, n of them, ascending.
            fitness: (n,).
            measures: (n, measures).
        """
        cells = self.division.cells_of(measures)
        usable = np.isfinite(fitness) & (cells >= 0)
        for row, number in enumerate(map(int, numbers)):
            position = number % self._population
            if position < len(self.planned):
                self._add_again(self.planned[position], number, usable[row], fitness[row], measures[row])
            elif usable[row]:
                self._insert(
                    Sampled(number, measures[row], float(fitness[row]), int(cells[row]), rows=[number])
                )
            if position == self._population - 1:
                self._planned = None

    def _add_again(
        self, number: int, evaluation: int, usable: bool, fitness: float, measures: NDArray[np.float64]
    ) -> None:
        """Add an evaluation of an elite or a challenger, unless it was replaced meanwhile."""
        candidate = self._candidates.get(number)
        if candidate is None:
            return
        is_elite = self._elites.get(candidate.cell) is candidate
        if not usable:
            self._remove(candidate, is_elite=is_elite)
            return
        candidate.add(evaluation, float(fitness), measures)
        cell = int(self.division.cells_of(candidate.measures[np.newaxis])[0])
        if cell == candidate.cell:
            if is_elite:
                self._enqueue(candidate)
            self._settle(cell)
            return
        self._remove(candidate, is_elite=is_elite)
        candidate.cell = cell
        self._insert(candidate)

    def _remove(self, candidate: Sampled, *, is_elite: bool) -> None:
        """Remove an elite, which its challenger replaces, or a challenger."""
        del self._candidates[candidate.number]
        if is_elite:
            del self._elites[candidate.cell]
            self._settle(candidate.cell)
        else:
            del self._challengers[candidate.cell]

    def _insert(self, candidate: Sampled) -> None:
        """Make a candidate the elite of an empty cell, or a challenger if it is better."""
        elite, challenger = self._elites.get(candidate.cell), self._challengers.get(candidate.cell)
        rival = challenger or elite
        if rival is not None and not candidate.fitness > rival.fitness:
            return
        if challenger is not None:
            del self._candidates[challenger.number]
        self._candidates[candidate.number] = candidate
        self._challengers[candidate.cell] = candidate
        self._settle(candidate.cell)

    def _settle(self, cell: int) -> None:
        """Decide between the elite and the challenger of a cell, if its evaluations suffice."""
        elite, challenger = self._elites.get(cell), self._challengers.get(cell)
        if challenger is None:
            return
        if elite is not None and not challenger.fitness > elite.fitness:
            del self._challengers[cell], self._candidates[challenger.number]
        elif elite is None or challenger.evaluations >= min(elite.evaluations, _ENOUGH):
            del self._challengers[cell]
            if elite is not None:
                del self._candidates[elite.number]
            self._elites[cell] = challenger
            self._enqueue(challenger)

    def _enqueue(self, elite: Sampled) -> None:
        heappush(self._queue, (elite.evaluations, elite.number))

    @property
    def members(self) -> dict[int, Sampled]:
        """Elites and challengers, by the number of their first evaluation."""
        return self._candidates

    @property
    def elites(self) -> list[Sampled]:
        """The elites, in the order of `cells`."""
        return [self._elites[cell] for cell in sorted(self._elites)]

    @property
    def cells(self) -> NDArray[np.int64]:
        """Cells with an elite, in order."""
        return np.array(sorted(self._elites), dtype=np.int64)

    @property
    def numbers(self) -> NDArray[np.int64]:
        """Numbers of the first evaluations of the elites, in the order of `cells`."""
        return np.array([elite.number for elite in self.elites], dtype=np.int64)

    @property
    def fitness(self) -> Fitness:
        """Mean fitness of the elites, in the order of `cells`."""
        return np.array([elite.fitness for elite in self.elites], dtype=np.float64)
