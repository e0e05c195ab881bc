"""The selection of a candidate of a run."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from swarmwright.runs.instances import instances, meaning

if TYPE_CHECKING:
    from swarmwright.runs.run import Run


@dataclass(frozen=True)
class Choice:
    """A candidate of a run."""

    generation: int
    candidate: int
    """Index in that generation."""
    number: int
    """Number of the evaluation in the whole run, from 0."""
    fitness: float
    """Fitness from the run's ranking of all episodes; NaN if the evaluation failed."""
    episodes: list[float]
    """Fitness of each aggregated episode, with racing on all instances so far; NaN for episodes that failed
    or were skipped."""
    seeds: list[int]
    """Simulation seed of each episode."""
    aggregation: str
    """Description of how the episodes are aggregated to fitness; empty for a single episode."""
    specification: dict[str, Any]
    """The controller as plain values."""


def choose(run: "Run", generation: int | None = None, candidate: int | None = None) -> Choice:
    """Return a candidate of the run; arguments and errors as in `Run.evaluation`."""
    from swarmwright.runs.code import restore_experiment  # noqa: PLC0415 - it takes long to import

    evaluation = run.evaluation(candidate, generation)
    specification = (
        restore_experiment(run, evaluation.generation).representation().specification(evaluation.genome)
    )
    parts = instances(run, evaluation)
    return Choice(
        evaluation.generation,
        evaluation.candidate,
        evaluation.number,
        evaluation.fitness,
        [result for part in parts for result in part.episodes.tolist()],
        [seed for part in parts for seed in part.seeds],
        meaning(run.experiment, len(parts)),
        specification,
    )
