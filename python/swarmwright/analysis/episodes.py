"""Episodes that the evaluations of a run took: what they cost to simulate."""

from typing import TypeAlias
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from swarmwright.analysis.after_evaluations import by_generation
from swarmwright.methods.rankings.race import RaceOptions
from swarmwright.runs.failures import taken as taken_by
from swarmwright.runs.failures import taken_in
from swarmwright.runs.run import Run

_Numbers: TypeAlias = NDArray[np.int64]

_known: WeakKeyDictionary[Run, tuple[_Numbers, _Numbers]] = WeakKeyDictionary()
"""What `_by_generation` has found, for which every evaluation of a run is read."""


def episodes_of(run: Run, evaluations: int) -> int:
    """Return how many episodes the first so many evaluations of a run took.

    Those that a race left out do not count, nor do validations and what a ranking's other simulation ran.
    """
    ranking = run.experiment.ranking
    if not isinstance(ranking, RaceOptions):
        return evaluations * ranking.episodes
    ends, taken = _by_generation(run)
    generation = int(np.searchsorted(ends, evaluations, side="right")) - 1
    rest = evaluations - int(ends[generation])
    return int(taken[generation]) + (int(_taken_in(run, generation)[:rest].sum()) if rest else 0)


def evaluations_within(run: Run, episodes: int) -> int:
    """Return how many of a run's first evaluations took at most so many episodes."""
    ranking = run.experiment.ranking
    if not isinstance(ranking, RaceOptions):
        return min(episodes // ranking.episodes, run.evaluations)
    ends, taken = _by_generation(run)
    generation = int(np.searchsorted(taken, episodes, side="right")) - 1
    left = episodes - int(taken[generation])
    within = np.searchsorted(np.cumsum(_taken_in(run, generation)), left, side="right")
    return int(ends[generation] + within)


def _by_generation(run: Run) -> tuple[_Numbers, _Numbers]:
    """Return the evaluations of a race before each generation and at the end, and the episodes of these."""
    if run not in _known:
        counts, taken = np.zeros((2, run.generations), np.int64)
        if run.experiment.ranking.failure_fitness is not None:
            for one in taken_by(run):
                counts[one.generation], taken[one.generation] = len(one.episodes), one.episodes.sum()
        else:
            for part in run._store.rows():
                known = part.generation < run.generations  # a run that goes on may have more by now
                np.add.at(counts, part.generation[known], 1)
                np.add.at(taken, part.generation[known], _taken(part.episodes, part.fitness)[known])
        _known[run] = np.concatenate([[0], np.cumsum(counts)]), np.concatenate([[0], np.cumsum(taken)])
    return _known[run]


def _taken_in(run: Run, generation: int) -> _Numbers:
    """Return how many episodes each evaluation of a generation took; none where there is no such one."""
    ranking = run.experiment.new_ranking()
    found = [
        _taken(one.episodes, one.fitness)
        if ranking.options.failure_fitness is None
        else taken_in(one, ranking).episodes
        for one in run._store.one_generation(generation)
    ]
    return np.concatenate(found) if found else np.zeros(0, np.int64)


def _taken(episodes: NDArray[np.float64], fitness: NDArray[np.float64]) -> _Numbers:
    """Return how many episodes evaluations took: a candidate that failed went through all of them."""
    taken: _Numbers = np.where(np.isfinite(fitness), (~np.isnan(episodes)).sum(axis=1), episodes.shape[1])
    return taken


def episodes_to_begin(run: Run) -> int:
    """Return after how many episodes a run has something to compare."""
    return episodes_of(run, run.history[0].evaluations if by_generation(run) else 1)


def limit(run: Run, at: int | None, at_episodes: int | None) -> int | None:
    """Return how many evaluations of a run are compared, by their number or that of episodes; None: all."""
    return at if at_episodes is None else evaluations_within(run, at_episodes)
