"""Episodes that the evaluations of a run took: what they cost to simulate."""

import numpy as np

from swarmwright.analysis.after_evaluations import by_generation
from swarmwright.rankings.race import RaceOptions
from swarmwright.runs.run import Run


def episodes_of(run: Run, evaluations: int) -> int:
    """Return how many episodes the first so many evaluations of a run took.

    Those that a race left out do not count, nor do validations and what a ranking's other simulation ran.
    """
    ranking = run.experiment.ranking
    every = evaluations * ranking.episodes
    if not isinstance(ranking, RaceOptions):
        return every
    if evaluations == run.evaluations:
        return every - run.episodes_saved
    return every - run.store.episodes_left_out(evaluations)


def evaluations_within(run: Run, episodes: int) -> int:
    """Return how many of a run's first evaluations took at most so many episodes."""
    ranking = run.experiment.ranking
    if episodes >= episodes_of(run, run.evaluations):
        return run.evaluations
    if not isinstance(ranking, RaceOptions):
        return episodes // ranking.episodes
    found, left = 0, episodes
    for part in run.store.rows():
        left_out = np.isnan(part.episodes).sum(axis=1)
        used = np.cumsum(ranking.episodes - np.where(np.isfinite(part.fitness), left_out, 0))
        within = int(np.searchsorted(used, left, side="right"))
        found += within
        if within < len(used):
            break
        left -= int(used[-1])
    return found


def episodes_to_begin(run: Run) -> int:
    """Return after how many episodes a run has something to compare."""
    return episodes_of(run, run.history[0].evaluations if by_generation(run) else 1)


def limit(run: Run, at: int | None, at_episodes: int | None) -> int | None:
    """Return how many evaluations of a run are compared, by their number or that of episodes; None: all."""
    return at if at_episodes is None else evaluations_within(run, at_episodes)
