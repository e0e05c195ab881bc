"""What evaluates controllers, whether it does so in this process or on simulation servers."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from swarmwright import _engine
from swarmwright.experiment.fitness import FitnessExpression
from swarmwright.representations import Representation
from swarmwright.store import Journal, WarningEntry
from swarmwright.typing import Genomes

Servers = int | Literal["auto", "local", "in-process"]
OUTPUT = "servers.log"
"""File in a run's folder with what started servers printed."""

HERE = ("local", "in-process")
"""Values of `servers` that use no broker visible to others."""

Progress = Callable[[int, int, str], None]
"""Called about ten times a second with (episodes done, episodes in all, what is waited for)."""


@dataclass(frozen=True)
class Controllers:
    """Controllers of one architecture; each steers all agents of its episodes."""

    architecture: dict[str, Any]
    """A specification; its weights do not count."""
    weights: NDArray[np.float32]
    """(candidates, weights)"""
    sample: _engine.Sample | None = None
    """What all weights were made from; servers that can make them get it instead."""

    @classmethod
    def of(
        cls, representation: Representation, genomes: Genomes, sample: _engine.Sample | None = None
    ) -> Self:
        """Return the controllers that genomes stand for, which are those of the sample if there is one."""
        architecture = dict(representation.architecture())
        weights = representation.weights(genomes)
        if weights is not genomes:  # computed from the genes
            sample = None
        return cls(architecture, np.ascontiguousarray(weights, dtype=np.float32), sample)


@dataclass(frozen=True)
class Results:
    """What came out of evaluations, in the order of candidates and episodes."""

    fitness: NDArray[np.float64]
    """(candidates, episodes), NaN where the evaluation failed."""
    metrics: NDArray[np.float64]
    """(candidates, episodes, metrics), NaN where the simulation failed."""
    journal: Journal
    """Attempts at blocks of evaluations, and warnings."""


Feed = Callable[[Sequence[int], Results], NDArray[np.float32] | None]
"""Takes the numbers of candidates, from 0, that have been evaluated, and what came out; returns the weights
of further ones, (candidates, weights), maybe none, or None to stop."""


class Backend(Protocol):
    """Evaluates controllers."""

    sensors: int
    actuators: int
    metrics: tuple[str, ...]
    """Names of the metrics that the experiment's fitness needs, and of others that are asked for."""
    description: str
    """Where the work is done, for people and the journal."""

    def evaluate(
        self,
        controllers: Controllers,
        seeds: Sequence[int],
        on_progress: Progress,
        meanwhile: Callable[[], None] | None = None,
    ) -> Results:
        """Run every controller in an episode of every seed.

        meanwhile: work of the caller's, done once, where possible while the evaluation is under way.
        """

    def evaluator(self, architecture: dict[str, Any]) -> _engine.Evaluator | None:
        """Return what the engine evaluates such controllers with; None where Python or a server does it."""

    def ahead(self, architecture: dict[str, Any]) -> _engine.Evaluator | _engine.Pool | None:
        """Return what a thread of the engine evaluates with by itself; None where Python has a part in it."""

    def check(self) -> None:
        """Raise RunError when what evaluates has ended for good."""

    def count_failed(self, results: Results) -> None:
        """Count failed episodes of what the engine has evaluated by itself."""

    def stream(
        self, controllers: Controllers, seeds: Sequence[int], feed: Feed, on_progress: Progress
    ) -> None:
        """Run controllers as they come: first `controllers`, then those that `feed` returns."""

    def about(
        self,
        run: str,
        generation: int | None,
        generations: int,
        evaluations: tuple[int, int] | None = None,
    ) -> None:
        """Publish what the following evaluations are for.

        evaluations: where several generations are under way, episodes done before and of the whole run.
        """

    def incidents(self) -> dict[str, int]:
        """Counts of faults and countermeasures so far, by name; without zeros."""

    def log_to(self, folder: Path) -> None:
        """Write what started servers print to a file in a run's folder."""

    def post_evaluates(self) -> None:
        """Publish that what follows belongs to no generation: the best, on held-out seeds."""


def apply_expression(
    expression: FitnessExpression | None, results: Results, numbers: Sequence[int]
) -> Results:
    """Put the experiment's fitness in the place of the simulation's own.

    An episode for which it has no value has failed. numbers: of the candidates, for what is said of them.
    """
    if expression is None:
        return results
    measured = np.isfinite(results.fitness)
    needed = results.metrics[measured][:, : len(expression.metrics)]  # others follow these
    values, faults = expression(results.fitness[measured], needed)
    fitness = np.full_like(results.fitness, np.nan)
    fitness[measured] = values
    places = np.argwhere(measured)
    failures = []
    for fault in faults:
        candidate, episode = places[fault.index]
        error = f"fitness: {fault.reason}"
        failures.append(WarningEntry(f"episode {episode}: {error}", int(numbers[candidate]), error))
    return Results(fitness, results.metrics, results.journal.with_warnings(failures))


def metrics_of(expression: FitnessExpression | None, more: Sequence[str] = ()) -> tuple[str, ...]:
    """Return the names of the metrics that an experiment's fitness needs, and then of others."""
    needed = () if expression is None else expression.metrics
    return (*needed, *(name for name in dict.fromkeys(more) if name not in needed))
