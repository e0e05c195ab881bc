"""The evaluations that a candidate's fitness aggregates: several with racing and with `reevaluate`."""

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


def averages_instances(experiment: Experiment) -> bool:
    """Return whether a generation is an instance, and a candidate's fitness is the mean of several."""
    return method_of(experiment.method).by_instance


def instances(run: "Run", evaluation: Evaluation) -> list[Evaluation]:
    """Return the evaluations that the fitness of an evaluation aggregates, in order, itself last.

    With racing, these are the candidate's evaluations on all instances so far; with `reevaluate`, those in
    consecutive generations up to this one; otherwise it is the only one.
    """
    if averages_instances(run.experiment):
        return run._store.evaluations_of(evaluation)
    if not run.experiment.ranking.reevaluate:
        return [evaluation]
    consecutive = [evaluation]
    for earlier in reversed(run._store.evaluations_of(evaluation)[:-1]):
        if earlier.generation == consecutive[0].generation - 1:
            consecutive.insert(0, earlier)
    return consecutive


def fitness_of(experiment: Experiment, parts: Sequence[Sequence[float]]) -> float | None:
    """Return the fitness that aggregates evaluations with these results, see `instances`.

    NaN if there is none; None if the ranking compares candidates or needs more than the results.
    """
    ranking = experiment.new_ranking()
    if not isinstance(ranking, Absolute):
        return None
    if averages_instances(experiment):
        scores = [float(ranking.score(np.array([part], dtype=np.float64))[0]) for part in parts]
        return mean(scores)
    together = [result for part in parts for result in part]
    return float(ranking.score(np.array([together], dtype=np.float64))[0])


def best_words(experiment: Experiment) -> str:
    """Describe the best fitness so far of a run, which can fall if candidates are re-evaluated."""
    if averages_instances(experiment):
        return "candidate that would be returned (most instances)"
    if experiment.ranking.reevaluate:
        return "candidate that would be returned (re-evaluated)"
    return "best so far"


def meaning(experiment: Experiment, count: int) -> str:
    """Describe how `count` evaluations make a candidate's fitness; empty for a single episode."""
    if averages_instances(experiment):
        return f"mean of {count} instance{'s' if count > 1 else ''}"
    episodes = experiment.ranking.episodes * count
    if episodes == 1:
        return ""
    return f"{getattr(experiment.ranking, 'aggregate', 'outcome')} of {episodes} episodes"
