"""An archive whose elites and challengers are evaluated again."""

from typing import Any

import numpy as np
import pytest

from swarmwright.common.statistics import estimate
from swarmwright.methods.archive import Archive, Axis, Grid
from swarmwright.methods.map_elites import MapElites, MapElitesOptions
from swarmwright.methods.sampled_archive import SampledArchive
from tests.python.methods.functions import new

CELLS = Grid((Axis(0, 4, 4),))
NAN = np.nan


class Told:
    """An archive, told generations of four evaluations, of which up to three are repetitions."""

    def __init__(self) -> None:
        self.archive = SampledArchive(CELLS, population=4, share=0.75)
        self.number = 0

    def __call__(self, *evaluations: tuple[float, float]) -> None:
        """Add the next evaluations: fitness and measure."""
        values = np.array(evaluations, dtype=np.float64)
        self.archive.add(range(self.number, self.number + len(values)), values[:, 0], values[:, 1:])
        self.number += len(values)

    @property
    def elites(self) -> dict[int, tuple[int, float, int]]:
        """By cell: number, mean fitness and evaluations."""
        cells, elites = self.archive.cells.tolist(), self.archive.elites
        return {
            cell: (one.number, one.fitness, one.evaluations) for cell, one in zip(cells, elites, strict=True)
        }


def test_a_lucky_candidate_does_not_replace_an_elite_before_it_has_as_many_evaluations() -> None:
    told = Told()
    told((5, 0.5), (1, 1.5), (NAN, 0.5), (1, NAN))
    assert told.elites == {0: (0, 5, 1), 1: (1, 1, 1)}
    assert told.archive.planned == [0, 1]
    told((7, 0.5), (2, 1.5), (9, 0.7), (3, 2.5))
    # 6 has a higher fitness than the mean of 0, but a single evaluation.
    assert told.elites == {0: (0, 6, 2), 1: (1, 1.5, 2), 2: (7, 3, 1)}
    assert told.archive.planned == [6, 7, 0]
    told((1, 0.7), (3, 2.5), (6, 0.5), (NAN, 0.5))
    assert told.elites == {0: (0, 6, 3), 1: (1, 1.5, 2), 2: (7, 3, 2)}  # the mean of 6 is 5
    told((1, 1.5), (3, 2.5), (6, 0.5), (8, 0.5))
    assert told.archive.planned[0] == 15
    told((8, 0.5), (3, 1.5), (3, 2.5), (0, 0.1))
    told((8, 0.5), (3, 1.5), (3, 2.5), (0, 0.1))
    told((8, 0.5), (3, 1.5), (3, 2.5), (0, 0.1))
    assert told.elites[0] == (15, 8, 4)


def test_an_elite_moves_to_the_cell_of_its_mean_behaviour() -> None:
    told = Told()
    told((5, 0.9), (4, 3.5), (6, 0.5), (NAN, 0))
    assert told.elites == {0: (2, 6, 1), 3: (1, 4, 1)}
    told((4, 1.5), (6, 3.7), (NAN, 0), (NAN, 0))
    assert told.archive.planned[0] == 2
    # Planned were 1 and 2: 1 is now at 2.5, 2 at 2.1, where 6 is better than 4.
    assert told.elites == {2: (2, 6, 2)}


def test_a_candidate_that_fails_again_is_dropped_and_its_challenger_takes_over() -> None:
    told = Told()
    told((5, 0.5), (4, 1.5), (NAN, 0), (NAN, 0))
    told((5, 0.5), (4, 1.5), (6, 0.5), (NAN, 0))
    assert told.archive.planned == [6, 0, 1]
    told((6, 0.5), (NAN, 0.5), (4, NAN), (NAN, 0))
    assert told.elites == {0: (6, 6, 2)}


def test_the_interval_is_that_of_the_evaluations() -> None:
    told = Told()
    for fitness in (1.0, 2.0, 4.5, 3.0):
        told((fitness, 0.5), *[(NAN, 0.0)] * 3)
    (elite,) = told.archive.elites
    expected = estimate([1.0, 2.0, 4.5, 3.0])
    assert elite.rows == [0, 4, 8, 12]
    assert elite.interval == pytest.approx((expected.low, expected.high))


def test_parts_give_the_same_archive() -> None:
    drawn = np.random.default_rng(1)
    fitness, measures = drawn.normal(size=400), drawn.uniform(0, 4, (400, 1))
    fitness[::9] = NAN

    def added(parts: int) -> list[Any]:
        archive = SampledArchive(CELLS, population=20, share=0.5)
        for rows in np.array_split(np.arange(400), parts):
            archive.add(rows, fitness[rows], measures[rows])
        return [archive.numbers.tolist(), archive.fitness.tolist(), [one.rows for one in archive.elites]]

    assert added(1) == added(33) == added(400)


def noisy(share: float, seed: int) -> tuple[float, float]:
    """Reproducibility of an archive of a noisy function, and the QD score without noise."""
    drawn = np.random.default_rng(seed)
    measures = {name: {"range": [-3, 3], "bins": 10} for name in ("x", "y")}
    method = new("map_elites", seed=seed, population=50, generations=150, measures=measures, reevaluate=share)
    assert isinstance(method, MapElites)
    while not method.done:
        points = method.ask().astype(np.float64)
        noise = drawn.normal(size=(len(points), 3))
        fitness = 10 - np.abs(points[:, 2:]).sum(axis=1) / 4 + 2 * noise[:, 0]
        method.tell(fitness, metrics=points[:, :2] + 0.3 * noise[:, 1:])
    archive = method.archive
    points = method._genomes_of(np.arange(len(archive))).astype(np.float64)
    assert isinstance(method.options, MapElitesOptions)
    cells = method.options.cells
    assert cells is not None
    fitness = 10 - np.abs(points[:, 2:]).sum(axis=1) / 4
    stays = cells.cells_of(points[:, :2]) == archive.cells
    corrected = Archive(cells)
    corrected.add(range(len(points)), fitness, points[:, :2])
    return float((stays & (archive.fitness <= fitness + 0.5)).mean()), float(corrected.fitness.sum())


@pytest.mark.parametrize("seed", [1, 2])
def test_noisy_archives_are_reproduced_twice_as_often_and_are_better(seed: int) -> None:
    plain, sampled = noisy(0, seed), noisy(0.5, seed)
    assert sampled[0] > 0.1 + 2 * plain[0]
    assert sampled[1] > plain[1]
