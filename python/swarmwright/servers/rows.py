"""The rows of a store's tables."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from types import UnionType
from typing import Any, Final, Literal, NamedTuple, Self, get_args, get_origin

import numpy as np
from numpy.typing import NDArray

from swarmwright import _engine
from swarmwright.common.arrays import Fitness, Genomes
from swarmwright.common.engine_types import AttemptFields, FailedEvaluation, Outcome, WarningFields
from swarmwright.common.statistics import Summary

IN_PROCESS = -1
"""The server of attempts in the tool's own process."""
FAILED: Final = frozenset[Outcome]({"failed", "unusable", "server_failed", "disconnected"})
"""Outcomes of attempts that failed."""
NO_RESULT: Final = FAILED | frozenset[Outcome]({"lost", "handed_back"})
"""Outcomes of attempts after which others had to try."""
NOTHING_LEFT = "nothing was left to evaluate"
"""The place of a session that only brought a run to its end."""


@dataclass(frozen=True, kw_only=True)
class Session:
    """A process that worked on the run: the first one, then one for each time that it was resumed."""

    session: int
    """From 1 on."""
    started: str
    """ISO 8601, UTC."""
    place: str
    """Where the evaluations were made: servers on which broker, or this process; or `NOTHING_LEFT`."""
    host: str
    machine: str
    """Operating system and processor."""
    versions: dict[str, str]
    """Of Swarmwright, Python, NumPy and the libraries that were used."""
    seconds: float | None
    """Duration; up to the last generation when it was killed; None when it is not known."""
    outcome: str | None
    """done, interrupted, stopped (by a callback), or why it failed; None when it was killed or goes on."""
    code: int | None = None
    """Version of the copy of the source that was used; None where there is none."""


@dataclass(frozen=True, kw_only=True)
class Attempt:
    """One attempt at a batch of evaluations, on one server.

    Of evaluations in the tool's own process, only failed ones have attempts, of the mode `in-process`.
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
    """Steps that the server took, where it takes them one by one."""
    started: float
    """Seconds since 1970."""
    seconds: float
    """Duration; of a first attempt in the tool's own process, that of all evaluations of the generation."""
    outcome: Outcome
    """How it ended."""
    error: str | None
    """Why it brought no results, for people; None where it did."""
    stack: str | None = None
    """Where in the simulation's code, where that is known: the first attempt with this error has it."""


class ServerShare(NamedTuple):
    """What a server did in a run."""

    server: int
    evaluations: int
    """Episodes of all attempts that it answered."""
    failed: int
    """Attempts that failed: the evaluation, the server at it, or its connection."""
    seconds: float
    """During which an attempt was under way; several at the same time count once."""
    slower: int
    """Attempts that ended because another server, which had the same work, was faster."""
    with_failed: bool
    """Whether episodes that failed are among `evaluations`: a server answers many episodes at once."""
    lost: int
    """Attempts at other evaluations that the server had when it failed at one; they were repeated."""
    handed_back: int
    """Attempts that the server handed back, since another tool has it or waits for it."""


class FailureReason(NamedTuple):
    """Attempts that failed for one reason: reasons that differ in numbers or paths alone are the same."""

    reason: str
    """Of the first of them on the server with the lowest number."""
    attempts: int
    servers: dict[int, int]
    """Attempts on each server; those in the tool's own process have -1."""
    lost: int
    """Attempts at other evaluations that these servers had when they failed; they were repeated."""


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
    """A warning of a pool, or a failure that is not one of an attempt."""

    text: str
    candidate: int | None = None
    """Index of the candidate that it is about, if it is about one."""
    error: str | None = None
    """Why an evaluation failed, if one did."""
    episode: int | None = None
    """Index of the episode that it is about, if it is about one: the text begins with it."""
    time: float | None = None
    """When it arose, seconds since 1970, if that is known."""
    failed: FailedEvaluation | None = None
    """The evaluation that a pool has given up, if it is about one."""
    unaudited: bool = False
    """Whether it is about results that count without audits."""

    @classmethod
    def of_episode(cls, episode: int, words: str, candidate: int, error: str) -> Self:
        """Return a warning whose text is `episode N` and these words."""
        return cls(f"{_beginning(episode)}{words}", candidate, error, episode)

    def moved(self, candidate: int | None, episodes: int) -> Self:
        """Return it for a candidate with another index, and for an episode so many later."""
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
    """What was done for evaluations, and what went wrong."""

    attempts: list[AttemptEntry] = field(default_factory=list)
    warnings: list[WarningEntry] = field(default_factory=list)

    @classmethod
    def of(cls, attempts: Iterable[AttemptFields], warnings: Iterable[WarningFields]) -> Self:
        """Return the journal of what a pool returned."""
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
        """Why evaluations failed, in order; failures that are not ones of an attempt come last.

        Attempts that were not needed any more are not among them.
        """
        errors = [entry.error for entry in self.attempts if entry.outcome in NO_RESULT]
        return [error for error in errors + [entry.error for entry in self.warnings] if error]

    def with_warnings(self, warnings: Iterable[WarningEntry]) -> Self:
        """Return a journal with more warnings."""
        return type(self)(self.attempts, [*self.warnings, *warnings])

    def extend(self, other: "Journal") -> None:
        """Append what was done for other evaluations."""
        self.attempts.extend(other.attempts)
        self.warnings.extend(other.warnings)

    def placed(self, candidates: Sequence[int], episode: int = 0) -> Self:
        """Return it with candidates and episodes counted as in the whole of which they are a part.

        Args:
            candidates: their numbers there, in the order in which they are counted here.
            episode: the number there of the first episode here.
        """
        return type(self)(
            [
                attempt._replace(candidate=candidates[attempt.candidate], episode=episode + attempt.episode)
                for attempt in self.attempts
            ],
            [
                warning.moved(None if warning.candidate is None else candidates[warning.candidate], episode)
                for warning in self.warnings
            ],
        )


@dataclass(frozen=True, kw_only=True, eq=False, slots=True)
class GenerationResult:
    """A generation that was evaluated and ranked, and of which the method has been told.

    The loop makes it, the store keeps it as it is, and who reads the store gets it again.
    """

    generation: int
    """Index, from 0."""
    seeds: list[int]
    """Simulation seed of each episode."""
    genomes: Genomes | _engine.Sample
    """(candidates, genome_size), or what they are made from, where the store keeps that."""
    episodes: NDArray[np.float64]
    """(candidates, episodes) fitness, NaN where an episode failed or was left out."""
    metrics: NDArray[np.float64]
    """(candidates, episodes, metrics), what the experiment's fitness is made of; (.., 0) without."""
    fitness: Fitness
    """(candidates,), as the ranking made it, NaN where a candidate failed."""
    summary: Summary
    """Figures of the population after this generation."""
    leader: int
    """Number, counted over the whole run from 0, of the evaluation that is best after this generation."""
    journal: Journal = field(default_factory=Journal)
    """What was done for it; empty where it was read from a store, which has it in tables of its own."""
    digests: _engine.Digests | None = None
    """Of its columns in the store, where another thread has begun to compute them."""

    def made(self) -> Genomes:
        """Return the genomes, (candidates, genome_size)."""
        genomes = self.genomes
        return genomes.genomes(0, len(genomes)) if isinstance(genomes, _engine.Sample) else genomes

    def digested(self) -> Self:
        """Begin to compute the digests, in another thread."""
        if self.digests is not None:
            return self
        digests = _engine.Digests(self.fitness, self.episodes, self.metrics, self.genomes)
        return replace(self, digests=digests)


@dataclass(frozen=True, kw_only=True)
class Event:
    """An event worth noting: a warning of the pool, a result that was refused."""

    session: int
    generation: int | None
    time: str
    """ISO 8601, UTC."""
    kind: str
    text: str


def journal_line(kind: type[Any], values: Mapping[str, Any]) -> Any:  # noqa: ANN401 - one of the kinds above
    """Return a line of the journal. Raises TypeError for values that none was written with: it is damaged."""
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
