"""Searches by CMA-ES that look for improvements of an archive."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from swarmwright import _engine
from swarmwright.common.arrays import Fitness, Genome, Genomes
from swarmwright.common.random_numbers import Stream, Streams
from swarmwright.controllers import Representation
from swarmwright.methods._numbers import center_and_reach
from swarmwright.methods.archive import Cells, Values, subtract

_FLAT = 1e-12
"""Range of improvements below which an emitter learns nothing."""


class Improvements(NamedTuple):
    """What candidates would add to an archive, compared with the archive before all of them."""

    new: NDArray[np.bool_]
    """Whether each is in an empty cell, (n,)."""
    values: Fitness
    """Fitness in empty cells, else fitness minus that of the elite, (n,); NaN for failed candidates."""


class Thresholds:
    """Acceptance thresholds of an archive's cells, which follow the fitness of accepted candidates slowly.

    Source: the batch update of Fontaine and Nikolaidis, "Covariance matrix adaptation MAP-annealing", GECCO
    2023.
    """

    def __init__(self, cells: Cells, *, learning_rate: float, least: float) -> None:
        self._cells = cells
        self._rate = learning_rate
        self._thresholds = np.full(cells.cells, least)

    def improve(self, fitness: Fitness, measures: Values) -> Improvements:
        """Return fitness minus the threshold of each candidate's cell, then raise the thresholds."""
        cells = self._cells.cells_of(measures)
        usable = (cells >= 0) & np.isfinite(fitness)
        values = np.where(usable, subtract(fitness, self._thresholds[cells]), np.nan)
        rows = np.flatnonzero(usable & (values > 0))
        accepted, indices, counts = np.unique(cells[rows], return_inverse=True, return_counts=True)
        means = np.bincount(indices, weights=fitness[rows], minlength=len(accepted)) / counts
        ratio = np.ones(len(accepted))
        for number in range(int(counts.max(initial=0))):  # a product, since powers differ between processors
            ratio = np.where(number < counts, ratio * (1.0 - self._rate), ratio)
        self._thresholds[accepted] = ratio * self._thresholds[accepted] + (1.0 - ratio) * means
        return Improvements(np.zeros(len(fitness), dtype=bool), values)


class Emitters:
    """Independent searches by CMA-ES, each of which learns from the improvements by its own candidates.

    A search begins at a random elite. It ends, and another one begins, when its distribution is numerically
    exhausted, its candidates are all alike, or, if `patient` is false, none improved the archive.

    Source: improvement emitters of Fontaine, Togelius, Nikolaidis and Hoover, "Covariance matrix adaptation
    for the rapid illumination of behavior space", GECCO 2020.
    """

    def __init__(
        self,
        representation: Representation,
        *,
        seed: int,
        count: int,
        population: int,
        sigma: float,
        patient: bool,
    ) -> None:
        """Create emitters that have no distribution yet.

        Args:
            representation: has numeric genes.
            seed: seed of the experiment.
            count: number of emitters.
            population: candidates of all emitters together, a multiple of `count`.
            sigma: initial standard deviation, as a share of half the initial range of a gene.
            patient: whether searches go on without improvements.
        """
        self._representation, self._seed = representation, seed
        self._size = population // count
        self._sigma, self._patient = sigma, patient
        self._searches: list[_engine.Cma | None] = [None] * count
        self._generations = [0] * count

    def ask(self, generation: int, elite: Callable[[Stream], Genome]) -> Genomes:
        """Return the candidates of a generation, those of each emitter together.

        elite: draws a random elite.
        """
        genomes = []
        for number, present in enumerate(self._searches):
            search = present
            if search is None:
                search = self._begin(elite(Stream(self._seed, "map_elites.restart", generation, number)))
                self._searches[number], self._generations[number] = search, 0
            candidates = range(number * self._size, (number + 1) * self._size)
            genomes.append(search.ask(Streams(self._seed, "map_elites.emit", generation, candidates)))
        return np.concatenate(genomes)

    def tell(self, improvements: Improvements) -> None:
        """Accept the improvements by the last candidates, in their order."""
        for number, search in enumerate(self._searches):
            assert search is not None
            rows = slice(number * self._size, (number + 1) * self._size)
            new, values = improvements.new[rows], improvements.values[rows]
            usable = values[np.isfinite(values)]
            if not len(usable):
                continue  # the same distribution is sampled again
            # Equal improvements keep their order. Rising fitness keeps criteria of stagnation quiet.
            order = np.lexsort((-np.where(np.isfinite(values), values, -np.inf), ~new, np.isnan(values)))
            ranked = np.empty(self._size)
            ranked[order] = self._size * (self._generations[number] + 1.0) - np.arange(self._size)
            stop = search.tell(np.where(np.isfinite(values), ranked, np.nan))
            self._generations[number] += 1
            is_flat = not new.any() and float(usable.max()) - float(usable.min()) < _FLAT
            has_failed = not self._patient and not (new | (values > 0)).any()
            if stop is not None or is_flat or has_failed:
                self._searches[number] = None

    def _begin(self, center: Genome) -> _engine.Cma:
        _, reach = center_and_reach(self._representation)
        lower, upper = self._representation.bounds
        return _engine.Cma(
            center.astype(np.float64),
            reach=reach,
            lower=lower.astype(np.float64),
            upper=upper.astype(np.float64),
            step=self._sigma,
            population=self._size,
            separable=False,
        )
