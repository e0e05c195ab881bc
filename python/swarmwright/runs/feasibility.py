"""Which candidates of a run meet its constraints."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from swarmwright.common.formatting import format_count
from swarmwright.common.untrusted import escape_line
from swarmwright.methods.constraints import Limits, measure_violations

if TYPE_CHECKING:
    from swarmwright.runs.run import Run


def violations_of(run: "Run") -> NDArray[np.float64]:
    """Return the sum of violations of every evaluation, (evaluations,); 0 for feasible ones.

    It is infinite if a metric has no value, as in failed episodes.
    """
    constraints = run.experiment.constraints
    if not constraints:
        return np.zeros(run.evaluations)
    parts = [
        measure_violations(constraints, run.metrics, metrics)
        for _, _, metrics in run._store.iterate_parts([])
    ]
    return np.concatenate(parts) if parts else np.empty(0)


class Feasibility(NamedTuple):
    """How many candidates of a run meet its constraints."""

    feasible: int
    """Evaluations that meet all constraints and did not fail."""
    violation: float
    """Sum of violations of the best candidate; 0 as soon as a candidate is feasible."""


def feasibility_of(run: "Run") -> Feasibility | None:
    """Return how many candidates meet the constraints; None without constraints or evaluations."""
    if not run.experiment.constraints or not run.generations:
        return None
    violation = float(violations_of(run)[run.evaluation().number])
    return Feasibility(int(np.isfinite(run.fitness).sum()), violation)


def describe_feasibility(run: "Run") -> list[str]:
    """Return sentences on the constraints of a run; none without constraints."""
    feasibility = feasibility_of(run)
    if feasibility is None:
        return []
    limits = ", ".join(describe_limits(run.experiment.constraints))
    whole = format_count(run.evaluations, "candidate")
    lines = [f"{feasibility.feasible:,} of {whole} meet the constraints ({limits})."]
    if feasibility.violation > 0:
        lines.append(
            "No candidate meets all constraints; the best has the smallest sum of violations, "
            f"{feasibility.violation:.4g}, and no fitness."
        )
    return lines


def describe_limits(constraints: Mapping[str, Limits]) -> list[str]:
    """Return the limits as text: `collisions at most 0`."""
    texts = []
    for name, limits in constraints.items():
        sides = (("at least", limits.at_least), ("at most", limits.at_most))
        parts = [f"{side} {limit:g}" for side, limit in sides if limit is not None]
        texts.append(f"{escape_line(name)} {' and '.join(parts)}")
    return texts
