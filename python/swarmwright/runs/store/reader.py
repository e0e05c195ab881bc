"""Read a store, while a run writes it or afterwards."""

import hashlib
import operator
import sqlite3
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import Any, Self, SupportsIndex

import numpy as np
from numpy.typing import NDArray

from swarmwright.common.arrays import Genome
from swarmwright.common.json_text import loads
from swarmwright.common.processes import StablePath
from swarmwright.common.ranges import Range
from swarmwright.common.statistics import Summary
from swarmwright.methods.constraints import Limits, measure_violations
from swarmwright.runs.store import journal, pieces
from swarmwright.runs.store.best_of_equals import BestOfEquals
from swarmwright.runs.store.blocks import Record, concatenate_records
from swarmwright.runs.store.database import FILE, DamageError, read_facts, reading, reading_on
from swarmwright.runs.store.generations import LARGEST, Generations, Row
from swarmwright.runs.store.lookup import Best, Evaluation, Lookup
from swarmwright.runs.store.timing import Part, Timing, Waiting, read_bounds, read_timing, read_waiting
from swarmwright.servers.rows import (
    Attempt,
    Event,
    FailureReason,
    GenerationResult,
    ServerShare,
    ServerUse,
    Session,
    from_json,
    parse_journal_line,
)


class StoreReader:
    """Reads the store in a run folder: its current content, or that of one moment, see `open_snapshot`.

    All methods raise InputError when the store is missing, damaged, or of another version.

    Args:
        folder: folder of the run.
        name: name of the file in it.
        connect: returns the connection of the writer in this process, which reads faster than a new one; it
            must not be used during a write.
    """

    def __init__(
        self, folder: Path, name: str = FILE, connect: Callable[[], sqlite3.Connection] | None = None
    ) -> None:
        self._where = StablePath(folder)
        self._name = name
        self._connect = connect
        self._moment: Moment | None = None
        _ = self._facts  # report errors early

    @property
    def _folder(self) -> Path:
        return self._where.path

    @property
    def file(self) -> Path:
        """The store itself."""
        return self._folder / self._name

    def _reading(self) -> AbstractContextManager[sqlite3.Connection]:
        if self._connect is not None:
            return reading_on(self._connect(), self.file)
        return reading(self.file)

    @classmethod
    @contextmanager
    def open_snapshot(cls, folder: Path) -> Iterator[Self]:
        """Yield a reader of the present content; it ignores later additions, even after the block.

        Within the block, one connection reads everything.
        """
        with reading(folder / FILE) as connection:
            reader = cls(folder, FILE, lambda: connection)
            reader._moment = Moment.of(connection)
            try:
                yield reader
            finally:
                reader._connect = None

    @contextmanager
    def _generations(self) -> Iterator[Generations]:
        with self._reading() as connection:
            yield self._open_tables(connection)

    def _open_tables(self, connection: sqlite3.Connection) -> Generations:
        return Generations(connection, self.file, self._end)

    @contextmanager
    def _pieces(self) -> Iterator[pieces.Begin]:
        """Yield a function that begins the transaction of a piece, see `read_in_pieces`."""
        if self._connect is not None:
            yield self._reading
            return
        with pieces.read_in_pieces(self.file) as begin:
            yield begin

    @property
    def _end(self) -> int:
        """Number of the first generation that the reader ignores."""
        return LARGEST if self._moment is None else self._moment.generations

    @cached_property
    def _facts(self) -> dict[str, str]:
        return self._read_facts()

    def _read_facts(self) -> dict[str, str]:
        with self._reading() as connection:
            return read_facts(connection, self.file)

    def _read_facts_at_moment(self) -> dict[str, str]:
        """Return the facts at the moment of this reader."""
        return self._read_facts() if self._moment is None else self._facts

    @property
    def created(self) -> str:
        """When the run was started, ISO 8601, UTC."""
        return self._facts["created"]

    @property
    def name(self) -> str:
        """Name of the experiment's file without its suffix, or of the simulation."""
        return self._facts["name"]

    @property
    def metrics(self) -> list[str]:
        """Names of the stored metrics."""
        names: list[str] = self._parse(self._facts["metrics"])
        return names

    def experiment(self) -> dict[str, Any]:
        """Return the experiment as plain values."""
        values: dict[str, Any] = self._parse(self._read_facts_at_moment()["experiment"])
        return values

    def _parse(self, text: str) -> Any:  # noqa: ANN401 - JSON
        try:
            return loads(text)
        except (ValueError, TypeError) as error:
            raise DamageError(self.file, str(error)) from error

    def history(self) -> list[Summary]:
        """Return the figures of each finished generation."""
        with self._generations() as generations:
            return [row.summary for row in generations.rows()]

    @property
    def finished(self) -> int:
        """Number of finished generations."""
        if self._moment is not None:
            return self._moment.generations
        last = self.last()
        return 0 if last is None else last.generation + 1

    def last(self) -> Summary | None:
        """Return the figures of the last finished generation; None if there is none."""
        with self._generations() as generations:
            row = generations.last()
        return None if row is None else row.summary

    def digest(self, generation: int | None = None) -> str:
        """Return the digest of the record up to a generation, by default the last.

        Without a generation, it is the digest of an empty record.
        """
        with self._generations() as generations:
            row = generations.last() if generation is None else generations.row(generation)
        return hashlib.sha256().hexdigest() if row is None else row.digest

    def generations(self) -> Iterator[GenerationResult]:
        """Yield the generations in order, one in memory at a time; genomes as the store has them."""
        with self._pieces() as begin:
            with begin() as connection:
                rows = self._open_tables(connection).rows()
            for row in rows:
                with begin() as connection:
                    evaluation = self._read_generation(self._open_tables(connection), row)
                yield evaluation
                del evaluation  # before the next one is read

    def _read_generation(self, generations: Generations, row: Row) -> GenerationResult:
        sample = generations.sample(row)
        record = self._concatenate(list(generations.evaluations(row, make_genomes=False)))
        return GenerationResult(
            generation=row.generation,
            seeds=self._parse(row.seeds),
            genomes=record.genomes if sample is None else sample,
            episodes=record.episodes,
            metrics=record.metrics,
            fitness=record.fitness,
            summary=row.summary,
            leader=row.leader,
        )

    def read_generation(self, generation: int) -> Iterator[GenerationResult]:
        """Yield a generation, if it exists."""
        with self._generations() as generations:
            row = generations.row(generation)
            evaluation = None if row is None else self._read_generation(generations, row)
        if evaluation is not None:
            yield evaluation

    def read_generations(self, numbers: Iterable[int]) -> Iterator[GenerationResult]:
        """Yield those of some generations that exist, in the order of `numbers`."""
        with self._pieces() as begin:
            for number in numbers:
                with begin() as connection:
                    tables = self._open_tables(connection)
                    row = tables.row(number)
                    result = None if row is None else self._read_generation(tables, row)
                if result is not None:
                    yield result
                    del result  # before the next one is read

    def measure_generation_bytes(self) -> int:
        """Return the approximate mean size of a generation's evaluations in bytes; 0 without generations."""
        with self._generations() as generations:
            row = generations.last()
            if row is None:
                return 0
            return generations.measure_bytes(row) * row.summary.evaluations // (row.generation + 1)

    def collect_seeds(self) -> set[int]:
        """Return all simulation seeds of the finished generations, without checking their digests."""
        with self._generations() as generations:
            texts = generations.seeds()
        return {seed for text in texts for seed in self._parse(text)}

    def find_end_reason(self, *, now: bool = False) -> str:
        """Return what ended a finished run, even if after the moment of this reader; empty if unknown.

        now: ignore the stored reason of an earlier session, for a run that was in progress at that moment.
        """
        then = "" if now else self._read_facts_at_moment().get("ended", "")
        return then or self._read_facts().get("ended", "")

    def outcome(self) -> str | None:
        """Return the outcome of the last session; None while it runs."""
        with self._reading() as connection:
            rows = session_rows(connection)
        return rows[-1]["outcome"] if rows else None

    def server_use(self) -> dict[str, ServerUse]:
        """Return the use of the servers of each launcher in all sessions, if it is counted."""
        text = self._read_facts_at_moment().get("servers")
        try:
            return {} if text is None else from_json(text)
        except (ValueError, KeyError, TypeError, AttributeError) as error:
            raise DamageError(self.file, f"the fact servers: {error}") from error

    def channels(self) -> dict[str, Any] | None:
        """Return the stored sensors and actuators, see `catalogue.channels`.

        None for a simulation that only servers know. Raises InputError if they are invalid.
        """
        text = self._read_facts_at_moment().get("channels")
        if text is None:
            return None
        values = self._parse(text)
        problem = _find_channel_problem(values)
        if problem:
            raise DamageError(self.file, f"the fact channels: {problem}")
        channels: dict[str, Any] = values
        return channels

    def validation(self) -> dict[str, Any] | None:
        """Return the stored validation, see `runs.validation`; None if there is none yet."""
        facts = self._read_facts_at_moment()
        if "validation" in facts:
            values: dict[str, Any] = self._parse(facts["validation"])
            return values
        return None

    def audit(self) -> dict[str, int] | None:
        """Return the stored audit at the end of the run; None if there is none."""
        text = self._read_facts_at_moment().get("audit")
        values: dict[str, int] | None = None if text is None else self._parse(text)
        return values

    def transfer(self) -> dict[str, Any] | None:
        """Return the stored transfer, see `runs.transfer.at_end`; None if there is none."""
        text = self._read_facts_at_moment().get("transfer")
        values: dict[str, Any] | None = None if text is None else self._parse(text)
        return values

    def record(self) -> Record:
        """Return every evaluation of the finished generations."""
        with self._generations() as generations:
            parts = [part for row in generations.rows() for part in generations.evaluations(row)]
        return self._concatenate(parts)

    def rows(self) -> Iterator[Record]:
        """Yield all evaluations in blocks, in constant memory.

        Each generation is compared with its digest before its first block.
        """
        with self._pieces() as begin:
            with begin() as connection:
                rows = self._open_tables(connection).rows()
            yield from pieces.evaluations(begin, rows, self._open_tables)

    def episodes_left_out(self) -> int:
        """Return how many episodes were skipped by candidates that a race dropped and that did not fail."""
        return sum(int(np.isnan(row.episodes[np.isfinite(row.fitness)]).sum()) for row in self.rows())

    def count_measured(self, metric: str) -> int:
        """Return how many evaluations have a finite value of a metric."""
        column = self.metrics.index(metric)
        return sum(int(np.isfinite(part.metrics[:, :, column]).any(axis=1).sum()) for part in self.rows())

    def fitness(self) -> NDArray[np.float64]:
        """Return the fitness of every evaluation of the finished generations, in order."""
        with self._generations() as generations:
            return generations.fitness()

    def ends(self) -> NDArray[np.int64]:
        """Return the number of evaluations after each finished generation, in order."""
        with self._generations() as generations:
            return generations.ends()

    def iterate_parts(
        self, ends: Sequence[int], start: int = 0
    ) -> Iterator[tuple[int, NDArray[np.float64], NDArray[np.float64]]]:
        """Yield fitness and metrics of evaluations in large parts: `Generations.iterate_parts`."""
        with self._generations() as generations:
            yield from generations.iterate_parts(ends, len(self.metrics), start)

    def best_fitness(self, first: int, end: int) -> float:
        """Return the best fitness of the evaluations from `first` to before `end`; NaN if all failed."""
        with self._generations() as generations:
            return generations.best_fitness(first, end)

    def seeds(self, generation: int) -> list[int]:
        """Return the simulation seed of each episode of a generation."""
        with self._lookup() as lookup:
            seeds: list[int] = self._parse(lookup.row(generation).seeds)
        return seeds

    @contextmanager
    def _lookup(self) -> Iterator[Lookup]:
        with self._generations() as generations:
            yield Lookup(
                generations,
                self._folder,
                len(self.metrics),
                self._best_of_equals,
                ends_with_best=self._is_competition,
                violations=self._violations,
            )

    @cached_property
    def _is_competition(self) -> bool:
        ranking: Any = self._parse(self._facts["experiment"])["ranking"]
        return bool(ranking["kind"] == "tournament")

    @cached_property
    def _violations(self) -> Callable[[NDArray[np.float64]], NDArray[np.float64]] | None:
        """Returns the violations of candidates by their metrics; None without constraints."""
        stored = self._parse(self._facts["experiment"]).get("constraints")
        if not stored:
            return None
        constraints = {name: Limits.model_validate(limits) for name, limits in stored.items()}
        return partial(measure_violations, constraints, self.metrics)

    @cached_property
    def _best_of_equals(self) -> BestOfEquals | None:
        """Finds a best member of the front in runs that have one; None: the first of equals is the best."""
        method = self._parse(self._facts["experiment"])["method"]
        has_front = method["kind"] in ("nsga2", "nsga3")
        return BestOfEquals(method["objectives"], self.metrics) if has_front else None

    def leading(
        self,
        count: int,
        *,
        last_only: bool = False,
        by_instance: bool = False,
        key: Callable[[Genome], object] = bytes,
    ) -> list[Evaluation]:
        """Return the best evaluations of the run, with different genomes: `Lookup.leading`."""
        with self._lookup() as lookup:
            return lookup.leading(count, last_only=last_only, by_instance=by_instance, key=key)

    def evaluation(self, candidate: SupportsIndex | None, generation: SupportsIndex | None) -> Evaluation:
        """Return an evaluation; None as in `Run.evaluation`."""
        with self._lookup() as lookup:
            return lookup.evaluation(
                *(None if number is None else operator.index(number) for number in (candidate, generation))
            )

    def leader(self, generation: int) -> Evaluation:
        """Return the best evaluation of the run up to this generation."""
        with self._lookup() as lookup:
            return lookup.leader(generation)

    def evaluations_of(self, evaluation: Evaluation) -> list[Evaluation]:
        """Return all evaluations of the same genome up to this evaluation, in order."""
        with self._lookup() as lookup:
            return lookup.evaluations_of(evaluation)

    def best(self) -> Best | None:
        """Return the best evaluation; None if there is none."""
        with self._lookup() as lookup:
            return lookup.best()

    def sessions(self) -> list[Session]:
        """Return the sessions of the run, in order."""
        with self._reading() as connection:
            reached = dict(
                connection.execute(
                    "SELECT session, max(seconds) FROM generation WHERE generation < ? GROUP BY session",
                    (self._end,),
                )
            )
            rows = session_rows(connection) if self._moment is None else self._moment.sessions
            sessions = []
            for row in rows:
                values = {**row, "versions": self._parse(row["versions"])}
                if values["seconds"] is None:  # killed: use the time of its last generation
                    values["seconds"] = reached.get(values["session"])
                sessions.append(parse_journal_line(Session, values))
        return sessions

    def session_of(self, generation: int) -> int:
        """Return the session in which a generation was evaluated. Raises InputError if it does not exist."""
        with self._reading() as connection:
            row = connection.execute(
                "SELECT session FROM generation WHERE generation = ? AND generation < ?",
                (generation, self._end),
            ).fetchone()
        if row is None:
            self.seeds(generation)  # raises, with the existing generations
            raise AssertionError
        return int(row[0])

    def find_first_of_present_code(self) -> int:
        """Return the number of the first evaluation with the present code of the simulation."""
        sessions = self.sessions()
        first = sessions[-1]
        for session in reversed(sessions):
            if session.code != first.code:
                break
            first = session
        with self._reading() as connection:
            (number,) = connection.execute(
                "SELECT min(first) FROM generation WHERE session >= ? AND generation < ?",
                (first.session, self._end),
            ).fetchone()
        return int(number or 0)

    def code(self) -> dict[int, str]:
        """Return the SHA-256 of each copied version of the source, by its number from 1."""
        numbered = {name.partition(".")[2]: digest for name, digest in self._read_facts_at_moment().items()}
        return {int(number): digest for number, digest in sorted(numbered.items()) if number.isdecimal()}

    def attempts(self) -> Iterator[Attempt]:
        """Yield all attempts at evaluations, in the order in which they ended."""
        with self._pieces() as begin:
            yield from journal.read_rows(begin, Attempt, "attempt", self._last_attempt)

    @property
    def _last_attempt(self) -> int:
        return LARGEST if self._moment is None else self._moment.attempts

    def evaluators(self, generations: Collection[int]) -> journal.Evaluators:
        """Return which servers evaluated some generations."""
        with self._reading() as connection:
            return journal.read_evaluators(connection, generations, self._last_attempt)

    def attempt_bounds(self, session: int) -> tuple[float | None, float | None]:
        """Return when the attempts of a session began and ended: `timing.read_bounds`."""
        with self._reading() as connection:
            return read_bounds(connection, session, self._last_attempt)

    def timing(self, part: Part) -> Timing:
        """Return what the servers did in a part of a session."""
        with self._reading() as connection:
            return read_timing(connection, part, self._last_attempt, self._end)

    def waiting(self, session: int) -> dict[int, Waiting]:
        """Return how long the others waited for each server in a session."""
        with self._reading() as connection:
            return read_waiting(connection, session, self._last_attempt)

    def servers(self) -> list[ServerShare]:
        """Return what each server did, by its number."""
        with self._reading() as connection:
            return journal.read_shares(connection, self._last_attempt)

    def failures(self) -> list[FailureReason]:
        """Return the reasons of failed attempts, the most frequent first."""
        with self._reading() as connection:
            return journal.read_failures(connection, self._last_attempt)

    def events(self) -> Iterator[Event]:
        """Yield the warnings, in order."""
        last = LARGEST if self._moment is None else self._moment.events
        with self._pieces() as begin:
            yield from journal.read_rows(begin, Event, "event", last)

    def _concatenate(self, parts: list[Record]) -> Record:
        try:
            return concatenate_records(parts, len(self.metrics))
        except ValueError as error:
            raise DamageError(self.file, str(error)) from error


@dataclass(frozen=True)
class Moment:
    """The extent of a store at a moment; a store only grows."""

    generations: int
    """Number of finished generations."""
    attempts: int
    """Number of the last row of the table, 0 if it is empty."""
    events: int
    """Number of the last row of the table, 0 if it is empty."""
    sessions: tuple[dict[str, Any], ...]
    """Rows of the table by column; the last row changes when its session ends."""

    @classmethod
    def of(cls, connection: sqlite3.Connection) -> Self:
        """Return the extent of the store that the connection's transaction sees."""

        def last(column: str, table: str) -> int | None:
            value = connection.execute(f"SELECT max({column}) FROM {table}").fetchone()[0]  # noqa: S608 - our own names
            return None if value is None else int(value)

        generation = last("generation", "generation")
        return cls(
            generations=0 if generation is None else generation + 1,
            attempts=last("rowid", "attempt") or 0,
            events=last("rowid", "event") or 0,
            sessions=session_rows(connection),
        )


def session_rows(connection: sqlite3.Connection) -> tuple[dict[str, Any], ...]:
    """Return the rows of the table session, in order, by column."""
    cursor = connection.execute("SELECT * FROM session ORDER BY session")
    names = [column[0] for column in cursor.description]
    return tuple(dict(zip(names, row, strict=True)) for row in cursor)


def _find_channel_problem(channels: Any) -> str | None:  # noqa: ANN401 - unchecked JSON
    """Return the problem of channels that differ from `catalogue.channels`; None if there is none."""
    if not isinstance(channels, Mapping) or not isinstance(channels.get("groups", {}), Mapping):
        return "expected a mapping"
    for group in (channels, *channels.get("groups", {}).values()):
        if not isinstance(group, Mapping):
            return "groups: expected a mapping for each group"
        for kind in ("sensor", "actuator"):
            for key in ("names", "units", "ranges"):
                values = group.get(f"{kind}_{key}", [])
                if not isinstance(values, list):
                    return f"{kind}_{key}: expected a list"
                if key != "ranges" and not all(isinstance(name, str) for name in values):
                    return f"{kind}_{key}: expected strings"
            try:
                _ = [Range.parse(ends) for ends in group.get(f"{kind}_ranges", [])]
            except ValueError as error:
                return f"{kind}_ranges: {error}"
    seconds = channels.get("step_seconds")
    if seconds is not None and not (isinstance(seconds, int | float) and 0 < seconds < float("inf")):
        return f"step_seconds: {seconds!r} found, expected a positive number of seconds, or null"
    return None
