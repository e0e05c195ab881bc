"""Rows of the store's tables."""

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from types import UnionType
from typing import Any, Final, Literal, NamedTuple, Self, get_args, get_origin

import numpy as np
from numpy.typing import NDArray

from swarmwright import _engine
from swarmwright.common.arrays import Fitness, Genomes
from swarmwright.common.engine_types import AttemptFields, FailedEvaluation, Outcome, WarningFields
from swarmwright.common.json_text import loads
from swarmwright.common.statistics import Summary


class ServerUse(NamedTuple):
    """Use of the servers of one launcher."""

    seconds: float = 0.0
    """Total running time of its servers."""
    cost: float = 0.0
    """In the currency of `cost_per_hour`; 0 without it."""

    def __add__(self, other: object) -> "ServerUse":
        """Return the sum."""
        assert isinstance(other, ServerUse)
        return ServerUse(self.seconds + other.seconds, self.cost + other.cost)


ServerUses = Mapping[str, ServerUse]
"""Use by launcher; `ssh-2` is the second entry of this kind."""


def add_uses(first: ServerUses, second: ServerUses) -> dict[str, ServerUse]:
    """Add two uses launcher by launcher."""
    names = dict.fromkeys([*first, *second])
    return {name: first.get(name, ServerUse()) + second.get(name, ServerUse()) for name in names}


def to_json(uses: ServerUses) -> str:
    """Serialize uses as JSON."""
    return json.dumps({name: use._asdict() for name, use in uses.items()})


def from_json(text: str) -> dict[str, ServerUse]:
    """Parse uses from JSON. Raises ValueError, KeyError or TypeError for other texts."""
    return {
        str(name): ServerUse(float(use["seconds"]), float(use["cost"]))
        for name, use in dict(loads(text)).items()
    }


IN_PROCESS = -1
"""Server number of attempts in the tool's own process."""
FAILED: Final = frozenset[Outcome]({"failed", "unusable", "server_failed", "disconnected"})
"""Outcomes of attempts that failed."""
NO_RESULT: Final = FAILED | frozenset[Outcome]({"lost", "handed_back"})
"""Outcomes of attempts that brought no result."""
NOTHING_LEFT = "nothing was left to evaluate"
"""`place` of a session that only completed a run."""


@dataclass(frozen=True, kw_only=True)
class Session:
    """A process that worked on the run: the first one, or a resumption."""

    session: int
    """Number, from 1."""
    started: str
    """ISO 8601, UTC."""
    place: str  # pylint: disable=disallowed-name # the name in the store
    """Where evaluations ran: servers on a broker, or this process; or `NOTHING_LEFT`."""
    host: str
    machine: str
    """Operating system and processor."""
    versions: dict[str, str]
    """Versions of Swarmwright, Python, NumPy and the libraries in use."""
    seconds: float | None
    """Duration; of a killed session up to its last generation; None if unknown."""
    outcome: str | None
    """done, interrupted, stopped (by a callback), or the error; None if killed or still running."""
    code: int | None = None
    """Version of the run's copy of the source; None without a copy."""


@dataclass(frozen=True, kw_only=True)
class Attempt:
    """One attempt at a batch of evaluations, on one server.

    Evaluations in the tool's own process have attempts only for failures, with the mode `in-process`.
    """

    session: int
    generation: int
    mode: str
    candidate: int
    """Index of the first candidate, of `candidates` in a row."""
    candidates: int
    episode: int
    """Index of the first episode, of `episodes` in a row."""
    episodes: int
    server: int
    """Its id; -1 in the tool's own process."""
    attempt: int
    """1 for the first try."""
    steps: int | None
    """Number of steps, if the server steps episodes one by one."""
    started: float
    """Seconds since 1970."""
    seconds: float
    """Duration; for a first attempt in the tool's process, of all evaluations of the generation."""
    outcome: Outcome
    """How it ended."""
    error: str | None
    """Why it failed; None after success."""
    stack: str | None = None
    """Traceback of the simulation's code, for the first attempt with this error."""


class ServerShare(NamedTuple):
    """A server's share of the work of a run."""

    server: int
    evaluations: int
    """Episodes of all attempts that it answered."""
    failed: int
    """Failed attempts: of the evaluation, the server or its connection."""
    seconds: float
    """Time with at least one attempt in progress."""
    slower: int
    """Attempts that ended because another server finished the same work first."""
    with_failed: bool
    """Whether `evaluations` includes failed episodes, as a server answers many episodes at once."""
    lost: int
    """Other attempts in progress when the server failed; they were repeated."""
    handed_back: int
    """Attempts that the server handed back because another tool uses it or waits for it."""


class FailureReason(NamedTuple):
    """Attempts that failed for the same reason, ignoring numbers and paths."""

    reason: str
    """Reason of the first attempt on the server with the lowest number."""
    attempts: int
    servers: dict[int, int]
    """Attempts on each server; those in the tool's own process have -1."""
    lost: int
    """Other attempts in progress when these servers failed; they were repeated."""


class AttemptEntry(NamedTuple):
    """An attempt as a pool reports it: the fields of `Attempt` from `mode` on."""

    mode: str
    candidate: int
    candidates: int
    episode: int
    episodes: int
    server: int
    attempt: int
    steps: int | None
    started: float
    seconds: float
    outcome: Outcome
    error: str | None
    stack: str | None


class WarningEntry(NamedTuple):
    """A warning of a pool, or a failure outside attempts."""

    text: str
    candidate: int | None = None
    """Index of the candidate concerned, if any."""
    error: str | None = None
    """Why an evaluation failed, if any did."""
    episode: int | None = None
    """Index of the episode concerned, if any; the text begins with it."""
    time: float | None = None
    """Time of the warning, seconds since 1970, if known."""
    failed: FailedEvaluation | None = None
    """The evaluation that a pool gave up, if any."""
    unaudited: bool = False
    """Whether the warning concerns results that count without audits."""

    @classmethod
    def from_episode(cls, episode: int, words: str, candidate: int, error: str) -> Self:
        """Build a warning whose text is `episode N` followed by `words`."""
        return cls(f"{_beginning(episode)}{words}", candidate, error, episode)

    def shift(self, candidate: int | None, episodes: int) -> Self:
        """Return the warning for another candidate and with its episode shifted by `episodes`."""
        if self.failed is not None and candidate is not None:
            episode = self.failed["episode"] + episodes
            failed = self.failed | {"candidate": candidate, "episode": episode}
            return self._replace(candidate=candidate, failed=failed)
        if self.episode is None:
            return self._replace(candidate=candidate)
        episode = self.episode + episodes
        text = _beginning(episode) + self.text.removeprefix(_beginning(self.episode))
        return self._replace(text=text, candidate=candidate, episode=episode)


def _beginning(episode: int) -> str:
    return f"episode {episode}"


@dataclass
class Journal:
    """Attempts at evaluations, and warnings."""

    attempts: list[AttemptEntry] = field(default_factory=list)
    warnings: list[WarningEntry] = field(default_factory=list)

    @classmethod
    def from_fields(cls, attempts: Iterable[AttemptFields], warnings: Iterable[WarningFields]) -> Self:
        """Build the journal from a pool's attempts and warnings."""
        return cls(
            [AttemptEntry(**row) for row in attempts],
            [
                WarningEntry(
                    row["text"],
                    None if row["failed"] is None else row["failed"]["candidate"],
                    time=row["time"],
                    failed=row["failed"],
                    unaudited=row["unaudited"],
                )
                for row in warnings
            ],
        )

    @property
    def errors(self) -> list[str]:
        """Reasons of failed evaluations, in order, those outside attempts last.

        Attempts that were no longer needed are left out.
        """
        errors = [entry.error for entry in self.attempts if entry.outcome in NO_RESULT]
        return [error for error in errors + [entry.error for entry in self.warnings] if error]

    def with_warnings(self, warnings: Iterable[WarningEntry]) -> Self:
        """Return a journal with more warnings."""
        return type(self)(self.attempts, [*self.warnings, *warnings])

    def extend(self, other: "Journal") -> None:
        """Append another journal."""
        self.attempts.extend(other.attempts)
        self.warnings.extend(other.warnings)

    def renumber(self, candidates: Sequence[int], episode: int = 0) -> Self:
        """Return the journal with the candidate and episode numbers of the whole that contains it.

        Args:
            candidates: number in the whole, for each candidate of this journal.
            episode: number in the whole of this journal's first episode.
        """
        return type(self)(
            [
                attempt._replace(candidate=candidates[attempt.candidate], episode=episode + attempt.episode)
                for attempt in self.attempts
            ],
            [
                warning.shift(None if warning.candidate is None else candidates[warning.candidate], episode)
                for warning in self.warnings
            ],
        )


@dataclass(frozen=True, kw_only=True, eq=False, slots=True)
class GenerationResult:
    """A generation that was evaluated, ranked and passed to the method; the store saves it unchanged."""

    generation: int
    """Index, from 0."""
    seeds: list[int]
    """Simulation seed of each episode."""
    genomes: Genomes | _engine.Sample
    """(candidates, genome_size), or the sample that the store keeps in their place."""
    episodes: NDArray[np.float64]
    """(candidates, episodes) fitness, NaN where an episode failed or was left out."""
    metrics: NDArray[np.float64]
    """(candidates, episodes, metrics), inputs of the fitness expression; (.., 0) without one."""
    fitness: Fitness
    """(candidates,), scores of the ranking, NaN where a candidate failed."""
    summary: Summary
    """Figures of the population after this generation."""
    leader: int
    """Number of the best evaluation so far, counted from 0 over the run."""
    journal: Journal = field(default_factory=Journal)
    """Its journal; empty if read from a store, which has separate tables for it."""
    digests: _engine.Digests | None = None
    """Digests of its columns in the store, if a thread computes them."""

    def expand_genomes(self) -> Genomes:
        """Return the genomes, (candidates, genome_size)."""
        genomes = self.genomes
        return genomes.genomes(0, len(genomes)) if isinstance(genomes, _engine.Sample) else genomes

    def with_digests(self) -> Self:
        """Begin to compute the digests, in another thread."""
        if self.digests is not None:
            return self
        digests = _engine.Digests(self.fitness, self.episodes, self.metrics, self.genomes)
        return replace(self, digests=digests)


@dataclass(frozen=True, kw_only=True)
class Event:
    """A noteworthy event, such as a warning of the pool or a refused result."""

    session: int
    generation: int | None
    time: str
    """ISO 8601, UTC."""
    kind: str
    text: str


def parse_journal_line(kind: type[Any], values: Mapping[str, Any]) -> Any:  # noqa: ANN401 - one of the kinds above
    """Build a row from a journal line. Raises TypeError for values that a damaged file holds."""
    for column in fields(kind):
        if column.name not in values:
            continue
        value = values[column.name]
        if get_origin(column.type) is Literal:
            fits = value in get_args(column.type)
        else:
            fits = not isinstance(column.type, type | UnionType) or isinstance(value, column.type)
        if not fits:
            raise TypeError(f"{kind.__name__.lower()}: {column.name} is {value!r}")
    return kind(**values)
