"""Episodes that the evaluations of a run took: what they cost to simulate."""

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
