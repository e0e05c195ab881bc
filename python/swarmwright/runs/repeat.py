"""Repeat an evaluation from its record."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from os import PathLike
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from swarmwright.common.arguments import check_arguments
from swarmwright.common.values import ComparedByValue
from swarmwright.experiment.experiment import Experiment, as_experiment
from swarmwright.methods.rankings.race import Race
from swarmwright.runs.code import resolve_experiment
from swarmwright.runs.instances import instances
from swarmwright.runs.store import Evaluation
from swarmwright.servers.evaluation.base import Controllers, Servers
from swarmwright.servers.evaluation.evaluate import log_failures
from swarmwright.servers.evaluation.opening import open_backend
from swarmwright.servers.rows import NO_RESULT

if TYPE_CHECKING:
    from swarmwright.runs.run import Run

_VARYING = re.compile(r"\b0x[0-9a-fA-F]+\b|\bserver \d+|[^\s(]*/(?=[^\s/])")
"""Parts that may differ between equal failures: addresses, servers, and folders of files."""


@dataclass(frozen=True, eq=False)
class Repetition(ComparedByValue):
    """A recorded evaluation and its repetition."""

    number: int
    """Number in the whole run, from 0."""
    generation: int
    candidate: int
    recorded: NDArray[np.float64]
    """Recorded fitness of the episodes, (episodes,); with racing and with `reevaluate` those of all
    evaluations that the candidate's fitness aggregates."""
    repeated: NDArray[np.float64]
    """Fitness in the repetition, (episodes,)."""
    left_out: int = 0
    """Episodes of the generation that the candidate skipped, because a race had dropped it."""
    seeds: list[int] = field(default_factory=list)
    """Simulation seed of each episode."""
    recorded_errors: list[str] = field(default_factory=list)
    """Recorded reasons of failed episodes, each once."""
    errors: list[str] = field(default_factory=list)
    """Reasons of failed episodes in the repetition, each once."""

    @property
    def same(self) -> bool:
        """Whether all episodes are bit-identical, and failures have a recorded reason.

        Addresses of objects, numbers of servers and folders in the reasons may differ.
        """
        failed = np.isnan(self.recorded)
        if (failed != np.isnan(self.repeated)).any():
            return False
        # -0.0 and 0.0 are equal numbers with different bits.
        if self.recorded[~failed].tobytes() != self.repeated[~failed].tobytes():
            return False
        return not self.failed_again or bool(_normalize(self.errors) & _normalize(self.recorded_errors))

    @property
    def failed_again(self) -> int:
        """Number of episodes that failed both in the record and in the repetition."""
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
    """Repeat an evaluation of a run with its recorded seeds, to check reproducibility.

    Later edits of the simulation's code or of experiment.yaml are reported as warnings.

    Args:
        run: the run, or its folder.
        candidate: as in `Run.evaluation`.
        generation: as in `Run.evaluation`.
        experiment: replaces the run's experiment, for example to change servers or time-outs.
        broker: as in `optimize`.
        servers: as in `optimize`.
        simulation: a class, or `FILE:Class`, in place of the code that evaluated the candidate.

    Raises:
        InputError: the evaluation does not exist, or its code is missing.
        RunError: no broker or no suitable server.

    Examples:
        >>> repetition = swarmwright.repeat("result", servers="in-process")
        >>> repetition.repeated == repetition.recorded
        array([ True])

    See also: `post_evaluate`, for other seeds than those of the record.
    """
    from swarmwright.runs.run import open_run  # noqa: PLC0415 - it imports this module

    run = open_run(run)
    if experiment is not None:
        experiment = as_experiment(experiment)
    recorded = run.evaluation(candidate, generation)
    parts = instances(run, recorded)
    ran = _count_episodes(run, recorded)
    seeds = [seed for part in parts[:-1] for seed in part.seeds] + recorded.seeds[:ran]
    before = np.concatenate([*(part.episodes for part in parts[:-1]), recorded.episodes[:ran]])
    experiment = experiment or resolve_experiment(run, recorded.generation, simulation)
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
        _find_recorded_errors(run, parts) if np.isnan(before).any() else [],
        list(dict.fromkeys(results.journal.errors)),
    )


def _find_recorded_errors(run: "Run", parts: Sequence[Evaluation]) -> list[str]:
    """Return the reasons of failed episodes of these evaluations, each once."""
    keys = {(part.generation, part.candidate) for part in parts}
    errors = [
        attempt.error
        for attempt in run.attempts()
        if attempt.error is not None
        and attempt.outcome in NO_RESULT
        and any(
            (attempt.generation, attempt.candidate + index) in keys for index in range(attempt.candidates)
        )
    ]
    return list(dict.fromkeys(errors))


def _normalize(errors: Sequence[str]) -> set[str]:
    return {_VARYING.sub("", error) for error in errors}


def _count_episodes(run: "Run", recorded: Evaluation) -> int:
    """Return how many episodes a candidate ran: all, unless a race dropped it."""
    ranking = run.experiment.new_ranking()
    if not isinstance(ranking, Race):
        return len(recorded.seeds)
    generation = next(run._store.read_generation(recorded.generation))
    return int(ranking.count_episodes(generation.episodes)[recorded.candidate])
