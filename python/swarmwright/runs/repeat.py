"""Repeating an evaluation from its record."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from os import PathLike
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from swarmwright.common.arguments import check_arguments
from swarmwright.common.values import ComparedByValue
from swarmwright.experiment.experiment import Experiment, experiment_of
from swarmwright.methods.rankings.race import Race
from swarmwright.runs.code import used_for
from swarmwright.runs.instances import instances
from swarmwright.runs.store import Evaluation
from swarmwright.servers.evaluation.base import Controllers, Servers
from swarmwright.servers.evaluation.evaluate import log_failures
from swarmwright.servers.evaluation.opening import open_backend
from swarmwright.servers.rows import NO_RESULT

if TYPE_CHECKING:
    from swarmwright.runs.run import Run

_VARYING = re.compile(r"\b0x[0-9a-fA-F]+\b|\bserver \d+|[^\s(]*/(?=[^\s/])")
"""What differs between two failures for one reason: addresses, servers, and folders of files."""


@dataclass(frozen=True, eq=False)
class Repetition(ComparedByValue):
    """A recorded evaluation and its repetition."""

    number: int
    """In the whole run, from 0."""
    generation: int
    candidate: int
    recorded: NDArray[np.float64]
    """(episodes,) fitness as recorded, of the episodes that were run; with racing and with `reevaluate` those
    of all evaluations that the candidate's fitness is made of"""
    repeated: NDArray[np.float64]
    """(episodes,) fitness now"""
    left_out: int = 0
    """Episodes of the generation that the candidate did not go through, since it was dropped from a race"""
    seeds: list[int] = field(default_factory=list)
    """Simulation seed of each episode"""
    recorded_errors: list[str] = field(default_factory=list)
    """Why episodes failed as recorded, each reason once"""
    errors: list[str] = field(default_factory=list)
    """Why episodes fail now, each reason once"""

    @property
    def same(self) -> bool:
        """Whether every episode came out the same, to the bit; those that failed, for a reason as recorded.

        Addresses of objects, numbers of servers and folders in the reasons may differ.
        """
        failed = np.isnan(self.recorded)
        if (failed != np.isnan(self.repeated)).any():
            return False
        # -0.0 and 0.0 are equal numbers, but other bits.
        if self.recorded[~failed].tobytes() != self.repeated[~failed].tobytes():
            return False
        return not self.failed_again or bool(_plain(self.errors) & _plain(self.recorded_errors))

    @property
    def failed_again(self) -> int:
        """Episodes that failed as recorded and now."""
        return int((np.isnan(self.recorded) & np.isnan(self.repeated)).sum())


@check_arguments
def repeat(
    run: "Run | str | PathLike[str]",
    candidate: int | None = None,
    generation: int | None = None,
    *,
    experiment: Experiment | Mapping[str, Any] | str | PathLike[str] | None = None,
    broker: str | None = None,
    servers: Servers | None = None,
    simulation: str | type | None = None,
) -> Repetition:
    """Evaluate a candidate of a run once more, with the seeds of its record.

    Args:
        run: where it is recorded, or its folder.
        candidate: as in `Run.evaluation`.
        generation: as in `Run.evaluation`.
        experiment: instead of the run's, with other servers or time-outs.
        broker: as in `optimize`.
        servers: as in `optimize`.
        simulation: a class, or `FILE:Class`, instead of the code with which it was evaluated.

    Edits made after the run, of the simulation's code or experiment.yaml, are reported as a warning.

    Raises:
        InputError: there is no such evaluation, or the code is gone.
        RunError: no broker or no fitting server.

    Examples:
        >>> again = swarmwright.repeat("result", servers="in-process")
        >>> again.repeated == again.recorded
        array([ True])

    See also: `post_evaluate`, for other seeds than those of the record.
    """
    from swarmwright.runs.run import run_of  # noqa: PLC0415 - it imports this module

    run = run_of(run)
    if experiment is not None:
        experiment = experiment_of(experiment)
    recorded = run.evaluation(candidate, generation)
    parts = instances(run, recorded)
    ran = _episodes_run(run, recorded)
    seeds = [seed for part in parts[:-1] for seed in part.seeds] + recorded.seeds[:ran]
    before = np.concatenate([*(part.episodes for part in parts[:-1]), recorded.episodes[:ran]])
    experiment = experiment or used_for(run, recorded.generation, simulation)
    with open_backend(experiment, broker=broker, servers=servers, most=len(seeds)) as backend:
        representation = experiment.representation(backend.sensors, backend.actuators)
        controllers = Controllers.from_genomes(representation, recorded.genome[np.newaxis])
        results = backend.evaluate(controllers, seeds, lambda *_: None)
        log_failures(backend, results)
    return Repetition(
        recorded.number,
        recorded.generation,
        recorded.candidate,
        before,
        results.fitness[0],
        len(recorded.seeds) - ran,
        seeds,
        _recorded_errors(run, parts) if np.isnan(before).any() else [],
        list(dict.fromkeys(results.journal.errors)),
    )


def _recorded_errors(run: "Run", parts: Sequence[Evaluation]) -> list[str]:
    """Return why episodes of these evaluations failed, each reason once."""
    of = {(part.generation, part.candidate) for part in parts}
    errors = [
        attempt.error
        for attempt in run.attempts()
        if attempt.error is not None
        and attempt.outcome in NO_RESULT
        and any((attempt.generation, attempt.candidate + index) in of for index in range(attempt.candidates))
    ]
    return list(dict.fromkeys(errors))


def _plain(errors: Sequence[str]) -> set[str]:
    return {_VARYING.sub("", error) for error in errors}


def _episodes_run(run: "Run", recorded: Evaluation) -> int:
    """Return how many episodes a candidate went through: all, but for one that was dropped from a race."""
    ranking = run.experiment.new_ranking()
    if not isinstance(ranking, Race):
        return len(recorded.seeds)
    evaluated = next(run._store.one_generation(recorded.generation))
    return int(ranking.ran(evaluated.episodes)[recorded.candidate])
