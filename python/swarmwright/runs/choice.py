"""The selection of one candidate of a run, and its record."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from swarmwright.runs.instances import instances, meaning

if TYPE_CHECKING:
    from swarmwright.runs.run import Run


@dataclass(frozen=True)
class Choice:
    """One candidate of a run."""

    generation: int
    candidate: int
    """Index among the candidates evaluated in that generation."""
    number: int
    """Of the evaluation in the whole run, from 0."""
    fitness: float
    """As the run's ranking made it of all episodes; NaN when the evaluation failed."""
    episodes: list[float]
    """Fitness of each of the episodes that it is made of, with racing on all instances so far; NaN for those
    that failed or were left out."""
    seeds: list[int]
    """Simulation seed of each of them."""
    aggregation: str
    """How they became the fitness, in words; empty where it is that of one episode."""
    specification: dict[str, Any]
    """The controller as plain values."""


def choose(run: "Run", generation: int | None = None, candidate: int | None = None) -> Choice:
    """Return a candidate of the run; arguments and errors as in `Run.evaluation`."""
    from swarmwright.runs.code import restore_experiment  # noqa: PLC0415 - what is shown of a run needs no code

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
