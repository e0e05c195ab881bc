"""The evaluations that a candidate's fitness is made of: several with racing, and with `reevaluate`."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from swarmwright.common.statistics import mean
from swarmwright.experiment.experiment import Experiment
from swarmwright.experiment.unavailable import method_of
from swarmwright.methods.rankings.absolute import Absolute
from swarmwright.runs.store import Evaluation

if TYPE_CHECKING:
    from swarmwright.runs.run import Run


def by_instance(experiment: Experiment) -> bool:
    """Return whether a generation is an instance, and a candidate's fitness the mean of several."""
    return method_of(experiment.method).by_instance


def instances(run: "Run", evaluation: Evaluation) -> list[Evaluation]:
    """Return the evaluations that the fitness of `one` is made of, in their order; it is the last one.

    With racing those of the same candidate on all instances so far, with `reevaluate` those in the
    generations without a gap before this one; otherwise it alone.
    """
    if by_instance(run.experiment):
        return run._store.evaluations_of(evaluation)
    if not run.experiment.ranking.reevaluate:
        return [evaluation]
    found = [evaluation]
    for earlier in reversed(run._store.evaluations_of(evaluation)[:-1]):
        if earlier.generation == found[0].generation - 1:
            found.insert(0, earlier)
    return found


def fitness_of(experiment: Experiment, parts: Sequence[Sequence[float]]) -> float | None:
    """Return the fitness that evaluations with these results make together, see `instances`.

    NaN where it has none, and None where the ranking compares candidates, or looks at more than results.
    """
    ranking = experiment.new_ranking()
    if not isinstance(ranking, Absolute):
        return None
    if by_instance(experiment):
        scores = [float(ranking.score(np.array([part], dtype=np.float64))[0]) for part in parts]
        return mean(scores)
    together = [result for part in parts for result in part]
    return float(ranking.score(np.array([together], dtype=np.float64))[0])


def best_words(experiment: Experiment) -> str:
    """Return what the best fitness so far of a run is: it can fall where candidates are evaluated again."""
    if by_instance(experiment):
        return "candidate that would be returned (most instances)"
    if experiment.ranking.reevaluate:
        return "candidate that would be returned (evaluated again)"
    return "best so far"


def meaning(experiment: Experiment, count: int) -> str:
    """Return how `count` evaluations became a candidate's fitness; empty where it is that of one episode."""
    if by_instance(experiment):
        return f"mean of {count} instance{'s' if count > 1 else ''}"
    episodes = experiment.ranking.episodes * count
    if episodes == 1:
        return ""
    return f"{getattr(experiment.ranking, 'aggregate', 'outcome')} of {episodes} episodes"
