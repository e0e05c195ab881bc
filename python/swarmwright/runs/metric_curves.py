"""Metrics over the generations of a run, grouped by the fitness of candidates."""

from collections.abc import Sequence
from functools import cached_property
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from swarmwright.common.arguments import require_list, text
from swarmwright.common.errors import InputError
from swarmwright.common.suggestions import unknown
from swarmwright.common.untrusted import escape_line
from swarmwright.runs.run import Run
from swarmwright.simulations import catalogue

Names: TypeAlias = Sequence[str] | Literal["all"]
Values: TypeAlias = NDArray[np.float64]

SHARES = ("best", "best quarter", "middle half", "worst quarter")
"""Parts of a generation, by fitness."""
_FITNESS = "fitness"
_QUARTER = 4
"""Smallest number of candidates of a generation with quarters."""


def select_names(runs: Sequence[Run], names: Names) -> list[str]:
    """Return the requested metrics; "all" selects those that every run has recorded.

    Raises InputError for a metric that a run has not recorded, and if there is none.
    """
    shared = [name for name in runs[0].metrics if all(name in run.metrics for run in runs)]
    if names == "all":
        if not shared:
            without = next((run for run in runs if not run.metrics), runs[0])
            raise InputError(
                f"{without.path}: has no metric in common with all runs; runs record the metrics of their "
                "fitness, objectives or measures"
            )
        return shared
    require_list("metrics", names, "names of metrics")
    names = [text("metrics", name, "a list of names") for name in names]
    for run in runs:
        for name in names:
            if name not in run.metrics:
                raise InputError(f"{run.path}: metrics: {unknown('metric', name, run.metrics)}")
    return list(names)


def _format_label(run: Run, name: str) -> str:
    """Return the axis label of a metric, with its unit if that is known."""
    if name == _FITNESS or not catalogue.has_description(run.experiment.simulation):
        return name
    metrics = catalogue.description(run.experiment.simulation, run.experiment.parameters)["metrics"]
    unit = metrics.get(name, {}).get("unit")
    return escape_line(f"{name} ({unit})") if unit and unit != name else name


class MetricCurves:
    """Fitness and metrics of a run over its generations.

    Args:
        run: a run with at least one finished generation.
        names: recorded metrics.
    """

    shares = SHARES

    def __init__(self, run: Run, names: Sequence[str]) -> None:
        self._run = run
        self.names = (_FITNESS, *names)

    @cached_property
    def values(self) -> Values:
        """Means over candidates, (fitness and metrics, shares, generations), in the order of `SHARES`.

        A candidate's metric is its mean over episodes. Failed candidates do not count; NaN if a share has no
        candidate with a value.
        """
        run = self._run
        columns = [run.metrics.index(name) for name in self.names[1:]]
        values = np.full((len(self.names), len(SHARES), run.generations), np.nan)
        waiting: list[Values] = []
        number = 0
        for part in run._store.rows():
            with np.errstate(invalid="ignore"):
                rows = np.column_stack([part.fitness, _compute_means(part.metrics[:, :, columns])])
            for generation in np.unique(part.generation):
                if generation >= run.generations:  # a run in progress may have more by now
                    break
                if generation != number:
                    values[:, :, number] = _compute_shares(waiting)
                    waiting, number = [], int(generation)
                waiting.append(rows[part.generation == generation])
        if waiting:
            values[:, :, number] = _compute_shares(waiting)
        return values

    @property
    def labels(self) -> list[str]:
        """Axis labels of fitness and metrics."""
        return [_format_label(self._run, name) for name in self.names]

    def x_positions(self, x: str) -> Values:
        """Return x of the generations, (generations,): "evaluations" at their end, or "generations"."""
        history = self._run.history
        return np.array(
            [summary.evaluations if x == "evaluations" else summary.generation for summary in history],
            dtype=np.float64,
        )


def _compute_means(metrics: Values) -> Values:
    """Return the means over episodes with a value, (candidates, metrics)."""
    is_finite = np.isfinite(metrics)
    count = is_finite.sum(axis=1)
    sums = np.where(is_finite, metrics, 0.0).sum(axis=1)
    means: Values = np.where(count > 0, sums / np.maximum(count, 1), np.nan)
    return means


def _compute_shares(parts: Sequence[Values]) -> Values:
    """Return the means of the shares of a generation, (fitness and metrics, shares).

    parts: fitness and metrics of its candidates, (candidates, 1 + metrics) each.
    """
    rows = np.concatenate(parts)
    rows = rows[np.isfinite(rows[:, 0])]
    rows = rows[np.argsort(-rows[:, 0], kind="stable")]
    count = len(rows)
    quarter = count // _QUARTER
    chosen = [rows[:1], rows[:quarter], rows[quarter : count - quarter] if quarter else rows[:0]]
    chosen.append(rows[count - quarter :] if quarter else rows[:0])
    return np.column_stack([_compute_means(share[None]).reshape(-1) for share in chosen])
