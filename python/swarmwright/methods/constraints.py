"""Limits of metrics, and the order of candidates that violate them."""

import math
from collections.abc import Mapping, Sequence
from typing import Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from swarmwright.common.arrays import Fitness
from swarmwright.common.options import Options
from swarmwright.common.statistics import means

Values = NDArray[np.float64]

_LARGEST_FITNESS = 1e100
"""Fitness beyond which no simulation goes; infeasible candidates score below its negative. The engine's NEAT
knows it, too."""
_LARGEST_VIOLATION = 1e40
"""Violations count as at most this, so that squares of scores are finite."""


class Limits(Options):
    """Limits that a metric must meet."""

    at_least: float | None = Field(default=None, allow_inf_nan=False)
    """Lowest value; none by default."""
    at_most: float | None = Field(default=None, allow_inf_nan=False)
    """Highest value; none by default."""

    @model_validator(mode="after")
    def _check_limits(self) -> Self:
        if self.at_least is None and self.at_most is None:
            raise ValueError("needs at_least, at_most or both")
        if self.at_least is not None and self.at_most is not None and self.at_least > self.at_most:
            raise ValueError(f"at_least {self.at_least:g} is above at_most {self.at_most:g}")
        return self

    def meets(self, values: Values) -> NDArray[np.bool_]:
        """Return which values meet the limits, (n,); NaN does not."""
        low = -math.inf if self.at_least is None else self.at_least
        high = math.inf if self.at_most is None else self.at_most
        return (values >= low) & (values <= high)

    def violations(self, values: Values) -> Values:
        """Return how far values are beyond the limits, (n,), in units of the limit; infinite for NaN.

        The unit of a limit of 0 is that of the metric.
        """
        beyond = np.zeros(len(values))
        with np.errstate(over="ignore"):  # infinite violations rank last
            if self.at_least is not None:
                beyond = np.maximum(beyond, (self.at_least - values) / (abs(self.at_least) or 1.0))
            if self.at_most is not None:
                beyond = np.maximum(beyond, (values - self.at_most) / (abs(self.at_most) or 1.0))
        # The rounded quotient of a tiny excess and a large limit may be 0.
        least = np.where(self.meets(values), 0.0, np.finfo(np.float64).tiny)
        return np.where(np.isnan(values), np.inf, np.maximum(beyond, least))


def sum_violations(constraints: Mapping[str, Limits], metrics: Values) -> Values:
    """Return the sum of each candidate's violations, (n,); 0 if it is feasible.

    Source: the normalized violations of Deb, "An efficient constraint handling method for genetic
    algorithms", Computer Methods in Applied Mechanics and Engineering 186(2-4), 2000.

    Args:
        constraints: the limits of each metric, in the order of the columns.
        metrics: means over episodes, (n, constraints).
    """
    total = np.zeros(len(metrics))
    for limits, column in zip(constraints.values(), metrics.T, strict=True):
        total = total + limits.violations(column)
    return total


def measure_violations(
    constraints: Mapping[str, Limits], names: Sequence[str], metrics: Values
) -> NDArray[np.float64]:
    """Return the sum of violations of each candidate by its means over episodes, (n,).

    Args:
        constraints: the limits of each metric.
        names: names of the metrics.
        metrics: (n, episodes, metrics).
    """
    columns = [names.index(name) for name in constraints]
    return sum_violations(constraints, means(metrics[:, :, columns]))


def rank_feasible_first(fitness: Fitness, violations: Values) -> Fitness:
    """Return scores whose order is that of Deb 2000, in a run as well as in a generation, (n,).

    Feasible candidates keep their fitness. Infeasible ones are below all of them, the lower the larger their
    violation; failed ones (NaN) stay NaN. The scores of infeasible candidates have no meaningful size, see
    `is_infeasible`.

    Args:
        fitness: (n,), or (n, columns), more is better.
        violations: of the same shape, or one that is broadcast to it.
    """
    below = -_LARGEST_FITNESS * (1 + np.minimum(violations, _LARGEST_VIOLATION))
    feasible = np.maximum(fitness, -0.5 * _LARGEST_FITNESS)
    return np.where(np.isnan(fitness), np.nan, np.where(violations > 0, below, feasible))


def is_infeasible(scores: Fitness) -> NDArray[np.bool_]:
    """Return which scores of `rank_feasible_first` are those of infeasible candidates."""
    return scores <= -_LARGEST_FITNESS
