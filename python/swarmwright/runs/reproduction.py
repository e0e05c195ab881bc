"""Whether the elites of an archive behave on held-out seeds as in the record."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from os import PathLike
from typing import TYPE_CHECKING, Any, NamedTuple, SupportsIndex

import numpy as np
from numpy.typing import NDArray

from swarmwright.common.arguments import check_arguments
from swarmwright.common.errors import InputError
from swarmwright.common.random_numbers import Streams
from swarmwright.common.statistics import proportion_interval, quantile
from swarmwright.experiment.experiment import Experiment, as_experiment
from swarmwright.methods.archive import Archive, Values
from swarmwright.runs.code import resolve_experiment
from swarmwright.runs.elites import Elites
from swarmwright.runs.post_evaluation import EPISODES, EvaluationOptions, PostEvaluation, evaluate_candidates
from swarmwright.servers.evaluation.base import Progress, Servers

if TYPE_CHECKING:
    from swarmwright.runs.run import Run

_RESAMPLES = 400
"""Resamples of the episodes for the intervals of coverage and QD score."""


class Interval(NamedTuple):
    """A value with its 95 % confidence interval."""

    value: float
    low: float
    high: float


@dataclass(frozen=True, repr=False)
class Reproduction:
    """The elites of an archive, evaluated in episodes with held-out seeds.

    An elite is reproduced if its mean measures are in the cell of the record, and its recorded fitness is not
    above the 95 % confidence interval of its fitness on held-out seeds; others are illusory. The corrected
    archive has the elites in the cells, and with the fitness, of the held-out episodes.

    Source: Flageolat and Cully, "Uncertain quality-diversity: evaluation methodology and new methods for
    quality-diversity in uncertain domains", IEEE Transactions on Evolutionary Computation 28(4), 2024.
    """

    elites: Elites
    """The elites in the record."""
    evaluations: list[PostEvaluation] = field(compare=False)
    """Their evaluations on held-out seeds, in the same order."""

    def __repr__(self) -> str:
        """Return the reproducibility."""
        return f"<Reproduction: {self.reproducibility.value:.3g} of {len(self.evaluations)} elites>"

    @cached_property
    def moved(self) -> NDArray[np.bool_]:
        """Whether the held-out behaviour of each elite is in another cell, or was not measured."""
        assert self.elites.cells is not None
        recorded = self.elites.cells.cells_of(self.elites.values()[:, 1:])
        moved: NDArray[np.bool_] = self._cells_of(self._measures) != recorded
        return moved

    @cached_property
    def overestimated(self) -> NDArray[np.bool_]:
        """Whether the recorded fitness of each elite is above the interval of its held-out fitness."""
        highest = [
            evaluation.fitness.mean if evaluation.fitness.high is None else evaluation.fitness.high
            for evaluation in self.evaluations
        ]
        # NaN, where every episode failed, is not at least the recorded fitness.
        reaches: NDArray[np.bool_] = np.array(highest) >= self.elites.values()[:, 0]
        return ~reaches

    @property
    def illusory(self) -> NDArray[np.bool_]:
        """Whether each elite is not reproduced."""
        return self.moved | self.overestimated

    @property
    def reproducibility(self) -> Interval:
        """Share of the elites that are reproduced, with Wilson's interval."""
        count = len(self.evaluations)
        reproduced = count - int(self.illusory.sum())
        return Interval(reproduced / count, *proportion_interval(reproduced, count))

    def coverage(self) -> Interval:
        """Return the coverage of the corrected archive, with a bootstrap interval over the episodes."""
        assert self.elites.cells is not None
        cells = self.elites.cells.cells
        return self._interval([len(archive) / cells for archive in self._archives])

    def qd_score(self, offset: float = 0.0) -> Interval:
        """Return the QD score of the corrected archive, with a bootstrap interval over the episodes.

        offset: as in `Elites.qd_score`.
        """
        return self._interval([math.fsum(archive.fitness - offset) for archive in self._archives])

    def to_mapping(self, offset: float = 0.0) -> dict[str, Any]:
        """Return plain values."""
        first = self.evaluations[0]
        return {
            "episodes": len(first.episodes),
            "seeds": first.seeds,
            "illusory": int(self.illusory.sum()),
            "moved": int(self.moved.sum()),
            "overestimated": int(self.overestimated.sum()),
            "reproducibility": self.reproducibility._asdict(),
            "coverage": self.coverage()._asdict(),
            "qd_score": self.qd_score(offset)._asdict(),
            "elites": [
                {"fitness": vars(evaluation.fitness), "illusory": illusory}
                for evaluation, illusory in zip(self.evaluations, self.illusory.tolist(), strict=True)
            ],
        }

    @staticmethod
    def _interval(values: list[float]) -> Interval:
        """Return the first value with the quantiles of the others."""
        ordered = sorted(values[1:])
        return Interval(values[0], quantile(ordered, 0.025), quantile(ordered, 0.975))

    def _cells_of(self, measures: Values) -> NDArray[np.int64]:
        assert self.elites.cells is not None
        return self.elites.cells.cells_of(measures)

    @cached_property
    def _episodes(self) -> Values:
        """Fitness of the episodes that count, and measures, (elites, episodes, 1 + measures)."""
        columns = [
            [
                evaluation.ranking.replace_failures(evaluation.episodes),
                *map(evaluation.metrics.get, self.elites.goals),
            ]
            for evaluation in self.evaluations
        ]
        return np.array(columns, dtype=np.float64).transpose(0, 2, 1)

    @property
    def _measures(self) -> Values:
        return _compute_means(self._episodes, np.ones(self._episodes.shape[1]))[:, 1:]

    @cached_property
    def _archives(self) -> list[Archive]:
        """The corrected archive, and those of the resamples."""
        assert self.elites.cells is not None
        _, episodes, columns = self._episodes.shape
        drawn = Streams(0, "elites.bootstrap", 0, range(_RESAMPLES)).integers(episodes, episodes)
        fitness = np.array([evaluation.fitness.mean for evaluation in self.evaluations])
        archives = []
        for weights in (np.ones(episodes), *(np.bincount(row, minlength=episodes) for row in drawn)):
            means = _compute_means(self._episodes, weights)
            # The aggregate of the ranking may be another one than the mean.
            means[:, 0] += fitness - _compute_means(self._episodes, np.ones(episodes))[:, 0]
            archive = Archive(self.elites.cells)
            archive.add(range(len(means)), means[:, 0], means[:, 1:columns])
            archives.append(archive)
        return archives


def _compute_means(episodes: Values, weights: NDArray[Any]) -> Values:
    """Return means over the episodes with a value, (n, episodes, k) to (n, k); NaN without any."""
    present = np.isfinite(episodes) * weights[:, np.newaxis]
    sums = np.where(present > 0, episodes, 0.0) * present
    total = present.sum(axis=1)
    return np.where(total > 0, sums.sum(axis=1) / np.maximum(total, 1), np.nan)


@check_arguments
def reproduce_elites(
    run: "Run | str | PathLike[str]",
    *,
    episodes: int = EPISODES,
    seed: SupportsIndex | None = None,
    experiment: Experiment | Mapping[str, Any] | str | PathLike[str] | None = None,
    broker: str | None = None,
    servers: Servers | None = None,
    on_progress: Progress | None = None,
) -> Reproduction:
    """Evaluate all elites of an archive on held-out seeds, to see which of them are illusory.

    Args:
        run: a run of `map_elites` with a grid or Voronoi cells, or its folder.
        episodes: number of episodes of each elite, at least 1.
        seed: as in `post_evaluate`.
        experiment: replaces the run's experiment, as in `post_evaluate`.
        broker: as in `optimize`.
        servers: as in `optimize`.
        on_progress: as in `optimize`.

    Raises:
        InputError: the run has no archive with cells, or no elite, or a number is out of range.
        SimulationError, RunError: as `post_evaluate`.

    Examples:
        >>> found = swarmwright.reproduce_elites("archive", servers="in-process")
        >>> 0 <= found.reproducibility.value <= 1
        True

    See also: `post_evaluate`, `Run.elites`.
    """
    from swarmwright.runs.run import open_run  # noqa: PLC0415 - takes long, not for reading runs

    run = open_run(run)
    experiment = resolve_experiment(run) if experiment is None else as_experiment(experiment)
    names = run.experiment.method.needed_metrics
    where = EvaluationOptions.of(episodes, seed, broker, servers, on_progress, names)
    elites = run.elites
    if elites.cells is None:
        kind = "a front" if elites.kind == "front" else "an unstructured archive"
        raise InputError(f"{run.path}: has {kind}, whose elites have no cells to stay in")
    if not elites.candidates:
        raise InputError(f"{run.path}: there is no elite to evaluate")
    candidates = [run.evaluation(elite.candidate, elite.generation) for elite in elites.candidates]
    return Reproduction(elites, evaluate_candidates(run, candidates, experiment, where))
