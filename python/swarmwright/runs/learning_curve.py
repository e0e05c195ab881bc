"""Learning curves: what the best so far of a run was worth on held-out seeds, generation after generation."""

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
from swarmwright.experiment.experiment import Experiment, experiment_of
from swarmwright.runs.code import used_for
from swarmwright.runs.post_evaluation import EPISODES, PostEvaluation, Where, of_candidates
from swarmwright.runs.store.lookup import nothing
from swarmwright.servers.evaluation.base import Progress, Servers

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from swarmwright.runs.run import Run

POINTS = 20
"""Of a curve, unless another number is given."""
_HEAD = ("generation", "evaluations", "best", "recorded", "held-out", "low", "high", "failed")


@dataclass(frozen=True, kw_only=True)
class CurvePoint:
    """The candidate that the run would have returned after a generation."""

    generation: int
    evaluations: int
    """Candidates evaluated since the start of the run, at the end of the generation."""
    best: PostEvaluation
    """The candidate's recorded fitness, and its fitness on the held-out seeds."""


@dataclass(frozen=True, kw_only=True, repr=False)
class LearningCurve:
    """Fitness of the best so far of a run on the same held-out seeds, over its generations.

    In the record the best so far can only rise where fitness depends on the seed, also by luck. Here it falls
    where evolution adapts to the seeds that it uses.
    """

    run: "Run"
    points: list[CurvePoint]
    """With ascending generations; the last is that of the last finished one."""

    def __repr__(self) -> str:
        """Say where it ends."""
        return f"<LearningCurve of {self.run.path.name}: {self.points[-1].best.result} at the end>"

    def _repr_html_(self) -> str:
        """Return it as a table, for notebooks."""
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
        """Return a matplotlib figure: recorded and held-out fitness of the best so far over evaluations."""
        from swarmwright.display.figures.learning_curve import draw  # noqa: PLC0415 - takes long

        return draw(self)

    @check_arguments
    def plot(self, path: str | PathLike[str]) -> Path:
        """Draw `figure` into a file (.png, .svg or .pdf); return its path.

        Raises InputError for another ending or a file that cannot be written.
        """
        from swarmwright.display.figures.style import save  # noqa: PLC0415 - takes long

        return save(self.figure(), Path(path))

    @check_arguments
    def export(self, path: str | PathLike[str]) -> Path:
        """Write a table as CSV, a row for each point; return its path.

        Columns: generation, evaluations, best (generation:candidate), its recorded fitness, its mean fitness
        on the held-out seeds, the ends of the 95 % confidence interval (Student's t), and how many of these
        episodes failed, which the mean leaves out unless `ranking.failed` is a number.

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
    """Evaluate what a run would have returned after several of its generations, on the same held-out seeds.

    Nothing is added to the run. A candidate that stays the best for several points is evaluated once.

    Args:
        run: a run with at least one finished generation, or its folder.
        points: how many generations, from 1 on, evenly spaced from the first to the last finished one; all of
            them where the run has fewer.
        episodes: of each candidate, as in `post_evaluate`.
        seed: as in `post_evaluate`; by default the seeds are those of the run's validation.
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
    from swarmwright.runs.run import run_of  # noqa: PLC0415 - it imports this module's

    run = run_of(run)
    if points < 1:
        raise InputError(f"points: must be at least 1, not {points}")
    where = Where.of(episodes, seed, broker, servers, on_progress)
    history = run.history
    if not history:
        raise RunError(nothing(run.path))
    places = np.unique(np.linspace(len(history) - 1, 0, points).round().astype(int)).tolist()
    leaders = {place: run._store.leader(history[place].generation) for place in places}
    distinct = list({evaluation.number: evaluation for evaluation in leaders.values()}.values())
    experiment = used_for(run, history[-1].generation) if experiment is None else experiment_of(experiment)
    found = {candidate.number: candidate for candidate in of_candidates(run, distinct, experiment, where)}
    return LearningCurve(
        run=run,
        points=[
            CurvePoint(
                generation=history[place].generation,
                evaluations=history[place].evaluations,
                best=found[leader.number],
            )
            for place, leader in leaders.items()
        ],
    )
