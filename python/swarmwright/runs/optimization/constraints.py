"""Violations of an experiment's constraints by evaluated candidates."""

import numpy as np
from numpy.typing import NDArray

from swarmwright.common.arrays import Fitness
from swarmwright.experiment.experiment import Experiment
from swarmwright.methods.constraints import measure_violations, rank_feasible_first
from swarmwright.methods.rankings import Ranking
from swarmwright.runs.optimization.two_simulations import list_stored_metrics


class MeasuredConstraints:
    """The constraints of an experiment, over means of metrics over episodes; false if it has none."""

    def __init__(self, ranking: Ranking, experiment: Experiment) -> None:
        self._constraints = experiment.constraints
        self._names = list_stored_metrics(ranking, experiment)

    def __bool__(self) -> bool:
        """Return whether there are constraints."""
        return bool(self._constraints)

    def measure(self, metrics: NDArray[np.float64]) -> NDArray[np.float64] | None:
        """Return the sum of violations of each candidate, (n,); None without constraints.

        metrics: (n, episodes, metrics), all that are stored.
        """
        if not self._constraints:
            return None
        return measure_violations(self._constraints, self._names, metrics)


def find_leader(fitness: Fitness, violations: NDArray[np.float64]) -> int:
    """Return the index of the best candidate; that with the smallest violation if none is feasible."""
    scores = rank_feasible_first(fitness, violations)
    return int(np.argmax(np.where(np.isnan(scores), -np.inf, scores)))
