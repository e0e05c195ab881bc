"""Learning curves: the fitness of a run's best so far on held-out seeds, over the generations."""

import csv
import io
from collections.abc import Mapping
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, SupportsIndex

import numpy as np

from swarmwright.common.arguments import check_arguments
from swarmwright.common.errors import InputError, RunError
from swarmwright.common.files import write_text
from swarmwright.common.html import table
from swarmwright.experiment.experiment import Experiment, as_experiment
from swarmwright.runs.code import resolve_experiment
from swarmwright.runs.post_evaluation import EPISODES, EvaluationOptions, PostEvaluation, evaluate_candidates
from swarmwright.runs.store.lookup import explain_missing_best
from swarmwright.servers.evaluation.base import Progress, Servers

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from swarmwright.runs.run import Run

POINTS = 20
"""Default number of points of a curve."""
_HEAD = ("generation", "evaluations", "best", "recorded", "held-out", "low", "high", "failed")


@dataclass(frozen=True, kw_only=True)
class CurvePoint:
    """The best candidate of a run up to a generation."""

    generation: int
    evaluations: int
    """Candidates evaluated from the start of the run to the end of the generation."""
    best: PostEvaluation
    """The candidate's recorded fitness, and its fitness on the held-out seeds."""


@dataclass(frozen=True, kw_only=True, repr=False)
class LearningCurve:
    """Fitness of a run's best so far on the same held-out seeds, over its generations.

    If fitness depends on the seed, the recorded best so far can only rise, partly by luck. This curve falls
    if the evolution overfits to its seeds.
    """

    run: "Run"
    points: list[CurvePoint]
    """Points in the order of generations; the last is for the last finished generation."""

    def __repr__(self) -> str:
        """Return the run and its fitness at the end."""
        return f"<LearningCurve of {self.run.path.name}: {self.points[-1].best.result} at the end>"

    def _repr_html_(self) -> str:
        """Return a table, for notebooks."""
        return table(_HEAD, self._rows())

    @property
    def seeds(self) -> list[int]:
        """Simulation seed of each episode."""
        return self.points[-1].best.seeds

    @property
    def is_reportable(self) -> bool:
        """Whether all episodes of all points count; see `PostEvaluation.is_reportable`."""
        return all(point.best.is_reportable for point in self.points)

    def to_mapping(self) -> dict[str, Any]:
        """Return plain values, without those of each episode."""
        return {
            "run": str(self.run.path),
            "seeds": self.seeds,
            "points": [
                {
                    "generation": point.generation,
                    "evaluations": point.evaluations,
                    "best": point.best.summary(),
                }
                for point in self.points
            ],
        }

    def figure(self) -> "Figure":
        """Draw recorded and held-out fitness of the best so far over evaluations; return the figure."""
        from swarmwright.display.figures.learning_curve import draw  # noqa: PLC0415 - takes long

        return draw(self)

    @check_arguments
    def plot(self, path: str | PathLike[str]) -> Path:
        """Write `figure` to a file (.png, .svg or .pdf); return its path.

        Raises InputError for another file type or a file that cannot be written.
        """
        from swarmwright.display.figures.style import save  # noqa: PLC0415 - takes long

        return save(self.figure(), Path(path))

    @check_arguments
    def export(self, path: str | PathLike[str]) -> Path:
        """Write a CSV table with a row for each point; return its path.

        Columns: generation, evaluations, best (generation:candidate), its recorded fitness, its mean fitness
        on the held-out seeds, the ends of the 95 % confidence interval (Student's t), and the number of
        failed episodes, which the mean excludes unless `ranking.failed` is a number.

        Raises InputError for a file that cannot be written.
        """
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(_HEAD)
        writer.writerows(self._rows())
        write_text(Path(path), text.getvalue())
        return Path(path)

    def _rows(self) -> list[tuple[object, ...]]:
        return [
            (
                point.generation,
                point.evaluations,
                point.best.label,
                point.best.recorded,
                point.best.fitness.mean,
                point.best.fitness.low,
                point.best.fitness.high,
                point.best.failed,
            )
            for point in self.points
        ]


@check_arguments
def learning_curve(
    run: "Run | str | PathLike[str]",
    points: int = POINTS,
    *,
    episodes: int = EPISODES,
    seed: SupportsIndex | None = None,
    experiment: Experiment | Mapping[str, Any] | str | PathLike[str] | None = None,
    broker: str | None = None,
    servers: Servers | None = None,
    on_progress: Progress | None = None,
) -> LearningCurve:
    """Evaluate a run's best so far at several generations, on the same held-out seeds.

    Nothing is added to the run. A candidate that stays the best for several points is evaluated once.

    Args:
        run: a run with at least one finished generation, or its folder.
        points: number of generations, at least 1, evenly spaced from the first to the last finished
            generation; all generations if the run has fewer.
        episodes: number of episodes of each candidate, as in `post_evaluate`.
        seed: as in `post_evaluate`; by default the seeds of the run's validation.
        experiment: as in `post_evaluate`.
        broker: as in `optimize`.
        servers: as in `optimize`.
        on_progress: as in `optimize`.

    Raises:
        InputError: a number is out of range, or the experiment does not fit the run's controllers.
        SimulationError: every episode failed, the last in the code of the simulation.
        RunError: the run has no finished generation; or as in `post_evaluate`.

    Examples:
        >>> curve = swarmwright.learning_curve("result", points=3, episodes=10, servers="in-process")
        >>> [point.generation for point in curve.points]
        [0, 1]

    See also: `post_evaluate`, for the best candidate alone; `Run.plot`, for the recorded fitness.
    """
    from swarmwright.runs.run import open_run  # noqa: PLC0415 - it imports this module's

    run = open_run(run)
    if points < 1:
        raise InputError(f"points: must be at least 1, not {points}")
    where = EvaluationOptions.of(episodes, seed, broker, servers, on_progress)
    history = run.history
    if not history:
        raise RunError(explain_missing_best(run.path))
    indices = np.unique(np.linspace(len(history) - 1, 0, points).round().astype(int)).tolist()
    leaders = {index: run._store.leader(history[index].generation) for index in indices}
    distinct = list({evaluation.number: evaluation for evaluation in leaders.values()}.values())
    experiment = (
        resolve_experiment(run, history[-1].generation) if experiment is None else as_experiment(experiment)
    )
    evaluated = {
        candidate.number: candidate for candidate in evaluate_candidates(run, distinct, experiment, where)
    }
    return LearningCurve(
        run=run,
        points=[
            CurvePoint(
                generation=history[index].generation,
                evaluations=history[index].evaluations,
                best=evaluated[leader.number],
            )
            for index, leader in leaders.items()
        ],
    )
