"""Metrics over the generations of a run, gathered by how good candidates were."""

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
"""Candidates from which on a generation has quarters."""


def names_of(runs: Sequence[Run], names: Names) -> list[str]:
    """Return the metrics that are asked for; "all": those that every run has recorded.

    Raises InputError for one that a run has not recorded, and where there is none.
    """
    shared = [name for name in runs[0].metrics if all(name in run.metrics for run in runs)]
    if names == "all":
        if not shared:
            without = next((run for run in runs if not run.metrics), runs[0])
            raise InputError(
                f"{without.path}: has recorded no metric that all runs have; runs record those that their "
                "fitness, objectives or measures are made of"
            )
        return shared
    require_list("metrics", names, "names of metrics")
    names = [text("metrics", name, "a list of names") for name in names]
    for run in runs:
        for name in names:
            if name not in run.metrics:
                raise InputError(f"{run.path}: metrics: {unknown('metric', name, run.metrics)}")
    return list(names)


def _label(run: Run, name: str) -> str:
    """Return what a metric is called on an axis: with its unit, if that is known."""
    if name == _FITNESS or not catalogue.has_description(run.experiment.simulation):
        return name
    found = catalogue.description(run.experiment.simulation, run.experiment.parameters)["metrics"]
    unit = found.get(name, {}).get("unit")
    return escape_line(f"{name} ({unit})") if unit and unit != name else name


class MetricCurves:
    """Fitness and metrics of a run over its generations.

    Args:
        run: with a finished generation at least.
        names: metrics that it has recorded.
    """

    shares = SHARES

    def __init__(self, run: Run, names: Sequence[str]) -> None:
        self._run = run
        self.names = (_FITNESS, *names)

    @cached_property
    def values(self) -> Values:
        """Means over candidates, (fitness and metrics, shares, generations), in the order of `SHARES`.

        A metric of a candidate is its mean over episodes. Candidates that failed do not count; NaN where a
        share has no candidate, or none with a value.
        """
        run = self._run
        columns = [run.metrics.index(name) for name in self.names[1:]]
        found = np.full((len(self.names), len(SHARES), run.generations), np.nan)
        waiting: list[Values] = []
        number = 0
        for part in run._store.rows():
            with np.errstate(invalid="ignore"):
                of_part = np.column_stack([part.fitness, _means(part.metrics[:, :, columns])])
            for generation in np.unique(part.generation):
                if generation >= run.generations:  # a run that goes on may have more by now
                    break
                if generation != number:
                    found[:, :, number] = _shares(waiting)
                    waiting, number = [], int(generation)
                waiting.append(of_part[part.generation == generation])
        if waiting:
            found[:, :, number] = _shares(waiting)
        return found

    @property
    def labels(self) -> list[str]:
        """What fitness and metrics are called on axes."""
        return [_label(self._run, name) for name in self.names]

    def places(self, x: str) -> Values:
        """Return x of the generations, (generations,): "evaluations" done at the end, or "generations"."""
        history = self._run.history
        return np.array(
            [summary.evaluations if x == "evaluations" else summary.generation for summary in history],
            dtype=np.float64,
        )


def _means(metrics: Values) -> Values:
    """Return means over episodes that have a value; (candidates, metrics)."""
    known = np.isfinite(metrics)
    count = known.sum(axis=1)
    sums = np.where(known, metrics, 0.0).sum(axis=1)
    means: Values = np.where(count > 0, sums / np.maximum(count, 1), np.nan)
    return means


def _shares(parts: Sequence[Values]) -> Values:
    """Return means of the shares of a generation, (fitness and metrics, shares).

    parts: of its candidates fitness and metrics, (candidates, 1 + metrics) each.
    """
    rows = np.concatenate(parts)
    rows = rows[np.isfinite(rows[:, 0])]
    rows = rows[np.argsort(-rows[:, 0], kind="stable")]
    count = len(rows)
    quarter = count // _QUARTER
    chosen = [rows[:1], rows[:quarter], rows[quarter : count - quarter] if quarter else rows[:0]]
    chosen.append(rows[count - quarter :] if quarter else rows[:0])
    return np.column_stack([_means(share[None]).reshape(-1) for share in chosen])
