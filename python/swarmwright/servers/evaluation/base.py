"""What evaluates controllers, whether it does so in this process or on simulation servers."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from collections.abc import Set as AbstractSet
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, Protocol, Self, cast

import numpy as np
from numpy.typing import NDArray

from swarmwright import _engine
from swarmwright.common.arrays import Genomes
from swarmwright.common.engine_types import AttemptFields, WarningFields
from swarmwright.common.errors import InputError, PlugInError, SimulationError
from swarmwright.common.plug_in_code import is_plug_in, numbers, place
from swarmwright.common.yaml import dotted_path
from swarmwright.controllers import Representation
from swarmwright.experiment.document import MOST_SERVERS
from swarmwright.experiment.experiment import Experiment
from swarmwright.experiment.launcher_entries import WORDS, Entries, entries_of, of_text, with_files
from swarmwright.servers.rows import Journal, WarningEntry
from swarmwright.servers.server_use import ServerUses
from swarmwright.simulations.fitness import FitnessExpression

Servers = int | str | Mapping[str, Any] | Sequence[Any]
"""What a caller asks for, as in an experiment file: 4, "auto", "slurm:4", {"launcher": "slurm", ..}."""
Chosen = int | Literal["auto", "local", "in-process"] | Entries
"""The same, checked, see `chosen`."""
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
        architecture, weights = architecture_of(representation), weights_of(representation, genomes)
        if weights is not genomes:  # computed from the genes
            sample = None
        return cls(architecture, np.ascontiguousarray(weights, dtype=np.float32), sample)


def architecture_of(representation: Representation) -> dict[str, Any]:
    """Return a representation's architecture. Raises PlugInError when a plug-in returns something else."""
    found: Any = representation.architecture()
    if not isinstance(found, Mapping):
        raise PlugInError(
            f"{place(representation, 'architecture')}: returned a {type(found).__name__}; expected a dict, a "
            "specification of a controller without its weights"
        )
    return dict(found)


def weights_of(representation: Representation, genomes: Genomes) -> NDArray[np.float32]:
    """Return the weights of controllers. Raises PlugInError when a plug-in returns something else."""
    weights = representation.weights(genomes)
    if is_plug_in(type(representation)):
        shape = len(genomes), None
        return numbers(
            representation, "weights", weights, shape, "weights, (candidates, weights)", some=False
        )
    return weights


@dataclass(frozen=True)
class Results:
    """What came out of a batch of evaluations, in the order of candidates and episodes.

    A batch need not be a generation: it may be the first candidates of one, a round of a race, or what
    `evaluate`, a validation or an audit asks for. What a run has of a generation is `rows.GenerationResult`.
    """

    fitness: NDArray[np.float64]
    """(candidates, episodes), NaN where the evaluation failed."""
    metrics: NDArray[np.float64]
    """(candidates, episodes, metrics), NaN where the simulation failed."""
    journal: Journal
    """Attempts at blocks of evaluations, and warnings."""


@dataclass(frozen=True)
class AuditedEpisode:
    """One episode of one candidate, which is repeated to compare the results."""

    candidate: int
    """Index of its controller."""
    seed: int
    """Of its episode."""
    before: int | None = None
    """Server that evaluated it before; None where none did."""


Feed = Callable[[Sequence[int], Results], NDArray[np.float32] | None]
"""Takes the numbers of candidates, from 0, that have been evaluated, and what came out; returns the weights
of further ones, (candidates, weights), maybe none, or None to stop."""
OnResults = Callable[[Sequence[int], Results], None]
"""Takes the numbers of candidates that have been evaluated in all episodes, and what came out, as it comes;
what it raises ends the evaluation."""
FIRST = 10
"""Evaluations of a run after which it ends where all of them have failed in the same way."""


class Backend(Protocol):
    """Evaluates controllers."""

    sensors: int
    actuators: int
    metrics: tuple[str, ...]
    """Names of the metrics that the experiment's fitness needs, and of others that are asked for."""
    description: str
    """Where the work is done, for people and the journal."""
    may_fail: bool
    """Whether an episode may fail."""
    is_foreign: bool
    """Whether servers evaluate that the run did not start."""
    hash_seed: str | None
    """Python's hash seed where episodes are evaluated, `random` where each process has its own; None if not
    known."""

    def evaluate(
        self,
        controllers: Controllers,
        seeds: Sequence[int],
        on_progress: Progress,
        meanwhile: Callable[[], None] | None = None,
        on_results: OnResults | None = None,
    ) -> Results:
        """Run every controller in an episode of every seed.

        Args:
            controllers: of the candidates.
            seeds: of the episodes.
            on_progress: told how far it is.
            meanwhile: work of the caller's, done once, where possible while the evaluation is under way.
            on_results: gets the results of candidates as they come, at least those of the first `FIRST`
                before all others are waited for; candidates are counted from 0.
        """

    def repeat(
        self, controllers: Controllers, evaluations: Sequence[AuditedEpisode], on_progress: Progress
    ) -> tuple[Results, list[int | None]]:
        """Repeat single evaluations, in their order, each on another server than before where there is one.

        Returns their results, as of one episode of each, without a journal; and the server of each, None
        where none evaluated it or it failed.
        """

    def tolerance(self, servers: AbstractSet[int | None]) -> float | None:
        """Return how far results of these servers may differ, as a part of the larger; None: at will.

        A server that declares nothing, or is not there any more, is expected to find the same.
        """

    def evaluator(self, architecture: dict[str, Any]) -> _engine.Evaluator | None:
        """Return what the engine evaluates such controllers with; None where Python or a server does it."""

    def ahead(self, architecture: dict[str, Any]) -> _engine.Evaluator | _engine.Pool | None:
        """Return what a thread of the engine evaluates with by itself; None where Python has a part in it."""

    def end_ahead(self) -> None:
        """Take back what `ahead` has lent to a thread that nobody has closed."""

    def check(self) -> None:
        """Raise RunError when what evaluates has ended for good."""

    def count_failed(self, results: Results) -> None:
        """Count failed episodes of what the engine has evaluated by itself."""

    def journal(self, attempts: Iterable[AttemptFields], warnings: Iterable[WarningFields]) -> Journal:
        """Return the journal of what the engine has evaluated by itself."""

    def failure_of(self, reason: str, /) -> SimulationError | None:
        """Return what the simulation's code failed with, for a reason of a journal; None for others."""

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

    def usage(self) -> str:
        """Return what was used of servers elsewhere, in words; empty where that is not counted."""

    def server_use(self) -> ServerUses:
        """Return the use of the servers of each launcher in this session so far."""

    def log_to(self, folder: Path) -> None:
        """Write what started servers print to a file in a run's folder."""

    def post_evaluates(self) -> None:
        """Publish that what follows belongs to no generation: the best, on held-out seeds."""


class BudgetSpent(KeyboardInterrupt):
    """The budget for servers is spent; the run can be resumed."""


class StartedServers(Protocol):
    """Servers that a run has started."""

    @property
    def restarts(self) -> int:
        """How often one was started again, or replaced."""

    @property
    def count(self) -> int:
        """How many there are to be."""

    def attach(self, pool: _engine.Pool) -> None:
        """Report their state to a pool, until `detach`."""

    def detach(self) -> None:
        """Stop reporting: the pool is closed."""

    def log_to(self, file: Path) -> None:
        """Write what they print to a file."""

    @property
    def usage(self) -> str:
        """What was used of servers elsewhere, in words; empty where that is not counted."""

    @property
    def use(self) -> ServerUses:
        """Use of the servers of each launcher so far; empty where that is not counted."""

    @property
    def on_status(self) -> Callable[[Mapping[str, Any]], None] | None:
        """Takes the pool's status, see protocol/schemas/status.schema.json; None where it is not needed."""

    def check(self) -> None:
        """Log servers that have been given up; raise RunError when none is left."""


def chosen(experiment: Experiment, servers: Servers | None) -> Chosen:
    """Return the servers that a caller asks for, or else the experiment's.

    servers: as in an experiment file; `slurm:4` takes the other options from the experiment's entry for that
    launcher; every launcher copies the files that the experiment's entries name. Raises InputError for
    something else.
    """
    if servers is None:
        return experiment.servers
    if isinstance(servers, int) and servers > MOST_SERVERS:
        raise InputError(f"servers: must be at least 1 and at most {MOST_SERVERS}, not {servers}")
    given = experiment.servers if isinstance(experiment.servers, tuple) else ()
    if isinstance(servers, str) and servers.isdecimal():
        raise InputError(f"servers: is the text {servers!r}; write {int(servers)}, a number")
    if isinstance(servers, str) and servers not in WORDS:
        try:
            return with_files(of_text(servers, given), given)
        except InputError as error:
            raise InputError(f"servers: {error}") from error
    if isinstance(servers, Mapping | Sequence) and not isinstance(servers, str):
        problems: list[str] = []
        found = entries_of(
            servers, Path(), lambda path, text: problems.append(f"{dotted_path(('servers', *path))}: {text}")
        )
        if found is None:
            raise InputError("\n".join(problems))
        return with_files(found, given)
    return cast("Chosen", servers)


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
        failures.append(WarningEntry.of_episode(int(episode), f": {error}", int(numbers[candidate]), error))
    return Results(fitness, results.metrics, results.journal.with_warnings(failures))


def tolerance_of(declared: Iterable[tuple[str | None, float | None]]) -> float | None:
    """Return how far results may differ of what declares this determinism and tolerance; None: at will."""
    kinds = list(declared)
    if any(kind == "none" for kind, _ in kinds):
        return None
    return max((tolerance or 0.0 for kind, tolerance in kinds if kind == "statistical"), default=0.0)


def metrics_of(expression: FitnessExpression | None, more: Sequence[str] = ()) -> tuple[str, ...]:
    """Return the names of the metrics that an experiment's fitness needs, and then of others."""
    needed = () if expression is None else expression.metrics
    return (*needed, *(name for name in dict.fromkeys(more) if name not in needed))
