"""The interface of evaluation backends, in this process or on simulation servers."""

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
from swarmwright.common.errors import InputError, PlugInError, RunError, SimulationError, with_message
from swarmwright.common.plug_in_code import is_plug_in, locate_method, numbers
from swarmwright.common.untrusted import escape_line, escape_lines
from swarmwright.common.yaml import format_path
from swarmwright.controllers import Representation
from swarmwright.experiment.document import MAX_SERVERS
from swarmwright.experiment.experiment import Experiment
from swarmwright.experiment.launcher_entries import WORDS, Entries, entries_of, parse_text, with_files
from swarmwright.methods.rankings import Ranking
from swarmwright.servers.rows import Journal, ServerUses, WarningEntry
from swarmwright.simulations.fitness import FitnessExpression

FailureOf = Callable[[str], SimulationError | None]
"""Returns the error of the simulation's code for a reason in a journal; None for other reasons."""

_MAX_REASONS = 200
"""Number of distinct reasons to remember; the oldest are dropped."""


class CodeFailures:
    """Reasons of failures in a simulation's code, with their tracebacks.

    A run's journal contains the traceback of a reason only once, so it is remembered here.
    """

    def __init__(self) -> None:
        self._stacks: dict[str, str | None] = {}

    def note(self, journal: Journal) -> None:
        """Note the reasons in a journal, from this process and from servers."""
        for attempt in journal.attempts:
            is_known = attempt.error in self._stacks or attempt.outcome == "failed"
            if attempt.error and (attempt.stack is not None or is_known):
                self._remember(attempt.error, attempt.stack)

    def find_error(self, reason: str) -> SimulationError | None:
        """Return the error for a reason; None if it did not come from a simulation's code.

        A traceback from another process is attached as a note.
        """
        if reason not in self._stacks:
            return None
        stack = self._stacks[reason]
        error = SimulationError(reason, stack)
        if stack is not None:
            error.add_note("\n".join(["In the simulation:", *(f"  {line}" for line in escape_lines(stack))]))
        return error

    def _remember(self, reason: str, stack: str | None) -> None:
        before = self._stacks.pop(reason, None)  # becomes the newest
        self._stacks[reason] = before if stack is None else stack
        if len(self._stacks) > _MAX_REASONS:
            del self._stacks[next(iter(self._stacks))]


def build_error(message: str, reasons: list[str], failure_of: FailureOf, *, unknown: str = "") -> RunError:
    """Build the error for failed evaluations: SimulationError if the last reason came from its code.

    Args:
        message: beginning of the message, followed by the last reason.
        reasons: reasons of the failed episodes, in order.
        failure_of: function of this name of the backend.
        unknown: end of the message if there are no reasons.
    """
    if not reasons:
        return RunError(f"{message}{unknown}")
    words = f"{message}{escape_line(reasons[-1])}"
    failure = failure_of(reasons[-1])
    if failure is None:
        return RunError(words)
    error = with_message(failure, words)
    error.__cause__ = failure.__cause__
    return error


Servers = int | str | Mapping[str, Any] | Sequence[Any]
"""The key `servers` as a caller writes it: 4, "auto", "slurm:4", {"launcher": "slurm", ..}."""
ServerChoice = int | Literal["auto", "local", "in-process"] | Entries
"""The checked value of `servers`, see `resolve_servers`."""
OUTPUT = "servers.log"
"""File in a run's folder with the output of the servers that the run started."""

BROKERLESS = ("local", "in-process")
"""Values of `servers` that use no broker visible to others."""

Progress = Callable[[int, int, str], None]
"""Called about ten times a second with (finished episodes, all episodes, reason for waiting)."""


@dataclass(frozen=True)
class Controllers:
    """Controllers of one architecture; each controls all agents of its episodes."""

    architecture: dict[str, Any]
    """A specification; its weights are ignored."""
    weights: NDArray[np.float32]
    """(candidates, weights)"""
    sample: _engine.Sample | None = None
    """Source of all weights; servers that can expand it receive it in place of the weights."""

    @classmethod
    def from_genomes(
        cls, representation: Representation, genomes: Genomes, sample: _engine.Sample | None = None
    ) -> Self:
        """Build the controllers of genomes; `sample` is the source of the genomes, if there is one."""
        architecture, weights = architecture_of(representation), weights_of(representation, genomes)
        if weights is not genomes:  # computed from the genes
            sample = None
        return cls(architecture, np.ascontiguousarray(weights, dtype=np.float32), sample)


def architecture_of(representation: Representation) -> dict[str, Any]:
    """Return a representation's architecture. Raises PlugInError if a plug-in returns another type."""
    architecture: Any = representation.architecture()
    if not isinstance(architecture, Mapping):
        raise PlugInError(
            f"{locate_method(representation, 'architecture')}: returned a {type(architecture).__name__}; "
            "expected "
            "a dict, a specification of a controller without its weights"
        )
    return dict(architecture)


def weights_of(representation: Representation, genomes: Genomes) -> NDArray[np.float32]:
    """Return the weights of genomes. Raises PlugInError if a plug-in returns another type or shape."""
    weights = representation.weights(genomes)
    if is_plug_in(type(representation)):
        shape = len(genomes), None
        return numbers(
            representation, "weights", weights, shape, "weights, (candidates, weights)", some=False
        )
    return weights


@dataclass(frozen=True)
class Results:
    """Results of a batch of evaluations, in the order of candidates and episodes.

    A batch is any set of evaluations: part of a generation, a round of a race, a validation or an audit.
    The record of a generation is `rows.GenerationResult`.
    """

    fitness: NDArray[np.float64]
    """(candidates, episodes), NaN where the evaluation failed."""
    metrics: NDArray[np.float64]
    """(candidates, episodes, metrics), NaN where the simulation failed."""
    journal: Journal
    """Attempts at blocks of evaluations, and warnings."""


@dataclass(frozen=True)
class AuditedEpisode:
    """One episode of one candidate that an audit repeats to compare the results."""

    candidate: int
    """Index of its controller."""
    seed: int
    """Of its episode."""
    before: int | None = None
    """Server of the first evaluation, or None."""


Feed = Callable[[Sequence[int], Results], NDArray[np.float32] | None]
"""Takes the numbers of evaluated candidates, from 0, and their results; returns the weights of further
candidates, (candidates, weights), possibly empty, or None to stop."""
OnResults = Callable[[Sequence[int], Results], None]
"""Takes the numbers of fully evaluated candidates and their results, as they arrive; an exception ends the
evaluation."""
FIRST_EVALUATIONS = 10
"""A run stops if its first evaluations, this many, all fail for the same reason."""


class Backend(Protocol):
    """Evaluates controllers."""

    sensors: int
    actuators: int
    metrics: tuple[str, ...]
    """Names of the metrics that the fitness needs, then of the others that were requested."""
    description: str
    """Where evaluations run, for messages and the journal."""
    may_fail: bool
    """Whether an episode may fail."""
    is_foreign: bool
    """Whether servers take part that the run did not start."""
    hash_seed: str | None
    """Python's hash seed in the evaluating processes, `random` if it differs between them; None if
    unknown."""

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
            controllers: controllers of the candidates.
            seeds: seeds of the episodes.
            on_progress: called with the progress.
            meanwhile: work of the caller, done once, if possible during the evaluation.
            on_results: called with the results of candidates as they arrive, at the latest with those of
                the first `FIRST` before the others; candidates are counted from 0.
        """

    def repeat(
        self, controllers: Controllers, evaluations: Sequence[AuditedEpisode], on_progress: Progress
    ) -> tuple[Results, list[int | None]]:
        """Repeat single evaluations, in order, each on another server than before if there is one.

        Returns the results, with one episode each and without a journal, and the server of each; None
        without a server or after a failure.
        """

    def tolerance(self, servers: AbstractSet[int | None]) -> float | None:
        """Return the allowed relative difference between results of these servers; None for any.

        A server that declares nothing, or has left, must reproduce results exactly.
        """

    def evaluator(self, architecture: dict[str, Any]) -> _engine.Evaluator | None:
        """Return the engine's evaluator of an architecture; None if Python or a server evaluates."""

    def background_evaluator(self, architecture: dict[str, Any]) -> _engine.Evaluator | _engine.Pool | None:
        """Return the evaluator for a thread of the engine; None if evaluations involve Python."""

    def release_background_evaluator(self) -> None:
        """Take back an evaluator from a thread that was not closed."""

    def check(self) -> None:
        """Raise RunError if the servers have ended for good."""

    def count_failed(self, results: Results) -> None:
        """Count failed episodes among results of an engine thread."""

    def build_journal(self, attempts: Iterable[AttemptFields], warnings: Iterable[WarningFields]) -> Journal:
        """Build the journal of evaluations by an engine thread."""

    def failure_of(self, reason: str, /) -> SimulationError | None:
        """Return the error of the simulation's code for a reason in a journal; None for other reasons."""

    def stream(
        self, controllers: Controllers, seeds: Sequence[int], feed: Feed, on_progress: Progress
    ) -> None:
        """Evaluate `controllers`, then those that `feed` returns, without generations."""

    def announce(
        self,
        run: str,
        generation: int | None,
        generations: int,
        evaluations: tuple[int, int] | None = None,
    ) -> None:
        """Publish the purpose of the next evaluations.

        evaluations: if several generations overlap, finished episodes and episodes of the whole run.
        """

    def incidents(self) -> dict[str, int]:
        """Return the counts of faults and countermeasures so far, by name, without zeros."""

    def usage(self) -> str:
        """Return the resource use of remote servers as text; empty if it is not counted."""

    def server_use(self) -> ServerUses:
        """Return the use of the servers of each launcher in this session so far."""

    def log_to(self, folder: Path) -> None:
        """Write the output of started servers to a file in a run's folder."""

    def announce_post_evaluation(self) -> None:
        """Publish that post-evaluation on held-out seeds begins, outside any generation."""


class BudgetSpent(KeyboardInterrupt):
    """The budget for servers is spent; the run can be resumed."""


class StartedServers(Protocol):
    """Servers that a run has started."""

    @property
    def restarts(self) -> int:
        """How many servers were restarted or replaced."""

    @property
    def count(self) -> int:
        """The intended number of servers."""

    def attach(self, pool: _engine.Pool) -> None:
        """Report their state to a pool, until `detach`."""

    def detach(self) -> None:
        """Stop reporting, because the pool is closed."""

    def log_to(self, file: Path) -> None:
        """Write their output to a file."""

    @property
    def usage(self) -> str:
        """Resource use of remote servers as text; empty if it is not counted."""

    @property
    def use(self) -> ServerUses:
        """Use of the servers of each launcher so far; empty if it is not counted."""

    @property
    def on_status(self) -> Callable[[Mapping[str, Any]], None] | None:
        """Callback for the pool's status, see protocol/schemas/status.schema.json; None if not needed."""

    def check(self) -> None:
        """Log servers that were given up; raise RunError if none remains."""


def resolve_servers(experiment: Experiment, servers: Servers | None) -> ServerChoice:
    """Return the checked `servers` of a caller, or else of the experiment.

    servers: as in an experiment file; `slurm:4` takes its other options from the experiment's entry for that
    launcher; every launcher copies the files that the experiment's entries name. Raises InputError for other
    values.
    """
    if servers is None:
        return experiment.servers
    if isinstance(servers, int) and servers > MAX_SERVERS:
        raise InputError(f"servers: must be at least 1 and at most {MAX_SERVERS}, not {servers}")
    experiment_entries = experiment.servers if isinstance(experiment.servers, tuple) else ()
    if isinstance(servers, str) and servers.isdecimal():
        raise InputError(f"servers: {servers!r} is a text; write the number {int(servers)}")
    if isinstance(servers, str) and servers not in WORDS:
        try:
            return with_files(parse_text(servers, experiment_entries), experiment_entries)
        except InputError as error:
            raise InputError(f"servers: {error}") from error
    if isinstance(servers, Mapping | Sequence) and not isinstance(servers, str):
        problems: list[str] = []
        entries = entries_of(
            servers, Path(), lambda path, text: problems.append(f"{format_path(('servers', *path))}: {text}")
        )
        if entries is None:
            raise InputError("\n".join(problems))
        return with_files(entries, experiment_entries)
    return cast("ServerChoice", servers)


def apply_expression(
    expression: FitnessExpression | None, results: Results, numbers: Sequence[int]
) -> Results:
    """Replace the simulation's fitness by the experiment's expression.

    Episodes without a value count as failed. numbers: numbers of the candidates, for messages.
    """
    if expression is None:
        return results
    measured = np.isfinite(results.fitness)
    needed = results.metrics[measured][:, : len(expression.metrics)]  # requested ones follow
    values, faults = expression(results.fitness[measured], needed)
    fitness = np.full_like(results.fitness, np.nan)
    fitness[measured] = values
    positions = np.argwhere(measured)
    failures = []
    for fault in faults:
        candidate, episode = positions[fault.index]
        error = f"fitness: {fault.reason}"
        failures.append(WarningEntry.from_episode(int(episode), f": {error}", int(numbers[candidate]), error))
    return Results(fitness, results.metrics, results.journal.with_warnings(failures))


def tolerance_of(declared: Iterable[tuple[str | None, float | None]]) -> float | None:
    """Return the largest tolerance of (determinism, tolerance) pairs; None if any difference is allowed."""
    kinds = list(declared)
    if any(kind == "none" for kind, _ in kinds):
        return None
    return max((tolerance or 0.0 for kind, tolerance in kinds if kind == "statistical"), default=0.0)


def metrics_of(expression: FitnessExpression | None, more: Sequence[str] = ()) -> tuple[str, ...]:
    """Return the names of the metrics that the fitness needs, followed by `more`."""
    needed = () if expression is None else expression.metrics
    return (*needed, *(name for name in dict.fromkeys(more) if name not in needed))


def check_seeds(ranking: Ranking, seeds: Any) -> list[int]:  # noqa: ANN401 - whatever a plug-in returns
    """Return the seeds as integers. Raises PlugInError if a plug-in returns other values."""
    if not is_plug_in(type(ranking)):
        return list(seeds)
    ok = isinstance(seeds, list | tuple | range | np.ndarray) and len(seeds) > 0
    if not ok or not all(isinstance(value, int | np.integer) and 0 <= value < 2**63 for value in seeds):
        raise PlugInError(
            f"{locate_method(ranking, 'seeds')}: returned {escape_line(repr(seeds)[:100])}; expected a list "
            "of at least "
            "one integer, the seeds of the episodes"
        )
    return [int(seed) for seed in seeds]


def seeds_of(ranking: Ranking, first: int, generation: int) -> list[int]:
    """Return the seeds of a generation.

    first: `parameters.seed`. Raises InputError for a generation without valid seeds, PlugInError as
    `check_seeds`.
    """
    if generation < 0:
        raise InputError(f"generation: must be at least 0, not {generation}")
    seeds = check_seeds(ranking, ranking.seeds(first, generation))
    if max(seeds) >= 2**63:
        raise InputError(f"generation: {generation} is too large; its seeds would exceed 2**63 - 1")
    return seeds
