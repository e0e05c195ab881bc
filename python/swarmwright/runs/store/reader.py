"""Reading a store, while a run writes it or afterwards."""

import hashlib
import operator
import sqlite3
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Self, SupportsIndex

import numpy as np
from numpy.typing import NDArray

from swarmwright.common.arrays import Genome
from swarmwright.common.json_text import loads
from swarmwright.common.processes import StablePath
from swarmwright.common.ranges import Range
from swarmwright.common.statistics import Summary
from swarmwright.runs.store import journal, pieces
from swarmwright.runs.store.best_of_equals import BestOfEquals
from swarmwright.runs.store.blocks import Record, joined
from swarmwright.runs.store.database import FILE, DamageError, checked_facts, reading, reading_on
from swarmwright.runs.store.generations import LARGEST, Generations, Row
from swarmwright.runs.store.lookup import Best, Evaluation, Lookup
from swarmwright.servers.rows import (
    Attempt,
    Event,
    FailureReason,
    GenerationResult,
    ServerShare,
    Session,
    parse_journal_line,
)
from swarmwright.servers.server_use import ServerUse, from_json


class StoreReader:
    """Reads the store in a run folder: what is in it at any time, or at one moment, see `opened`.

    Raises InputError, here and in every method, when the store is missing, damaged, or of another version.

    Args:
        folder: of the run.
        name: of the file in it.
        connect: returns the connection of who writes the store in this process, which reads faster than a
            new one; it is not used while something is written.
    """

    def __init__(
        self, folder: Path, name: str = FILE, connect: Callable[[], sqlite3.Connection] | None = None
    ) -> None:
        self._where = StablePath(folder)
        self._name = name
        self._connect = connect
        self._moment: Moment | None = None
        _ = self._facts  # report errors now rather than later

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
    def opened(cls, folder: Path) -> Iterator[Self]:
        """Return a reader of what the store holds now; what is added later it leaves out, also afterwards.

        All that is read within is read by one connection.
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
            yield self._opened(connection)

    def _opened(self, connection: sqlite3.Connection) -> Generations:
        return Generations(connection, self.file, self._end)

    @contextmanager
    def _pieces(self) -> Iterator[pieces.Begin]:
        """Yield what begins to read a piece of much that is yielded, see `in_pieces`."""
        if self._connect is not None:
            yield self._reading
            return
        with pieces.in_pieces(self.file) as begin:
            yield begin

    @property
    def _end(self) -> int:
        """Number of the first generation that is left out."""
        return LARGEST if self._moment is None else self._moment.generations

    @cached_property
    def _facts(self) -> dict[str, str]:
        return self._facts_now()

    def _facts_now(self) -> dict[str, str]:
        with self._reading() as connection:
            return checked_facts(connection, self.file)

    def _facts_then(self) -> dict[str, str]:
        """Return the facts at the moment of this reader, which those at its beginning are."""
        return self._facts_now() if self._moment is None else self._facts

    @property
    def created(self) -> str:
        """When the run was started, ISO 8601, UTC."""
        return self._facts["created"]

    @property
    def name(self) -> str:
        """Name of the experiment's file, without its ending, or of the simulation."""
        return self._facts["name"]

    @property
    def metrics(self) -> list[str]:
        """Names of the metrics that are stored."""
        names: list[str] = self._parsed(self._facts["metrics"])
        return names

    def experiment(self) -> dict[str, Any]:
        """Return the experiment as plain values."""
        values: dict[str, Any] = self._parsed(self._facts_then()["experiment"])
        return values

    def _parsed(self, text: str) -> Any:  # noqa: ANN401 - JSON
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
        """How many generations are finished."""
        if self._moment is not None:
            return self._moment.generations
        last = self.last()
        return 0 if last is None else last.generation + 1

    def last(self) -> Summary | None:
        """Return the figures of the last finished generation; None without one."""
        with self._generations() as generations:
            row = generations.last()
        return None if row is None else row.summary

    def digest(self, generation: int | None = None) -> str:
        """Return the digest of the record up to a generation, by default the last; of none, of nothing."""
        with self._generations() as generations:
            row = generations.last() if generation is None else generations.row(generation)
        return hashlib.sha256().hexdigest() if row is None else row.digest

    def generations(self) -> Iterator[GenerationResult]:
        """Yield the generations in order, one in memory at a time; genomes as the store has them."""
        with self._pieces() as begin:
            with begin() as connection:
                rows = self._opened(connection).rows()
            for row in rows:
                with begin() as connection:
                    evaluation = self._evaluated(self._opened(connection), row)
                yield evaluation
                del evaluation  # before the next one is read

    def _evaluated(self, generations: Generations, row: Row) -> GenerationResult:
        sample = generations.sample(row)
        record = self._joined(list(generations.evaluations(row, made=False)))
        return GenerationResult(
            generation=row.generation,
            seeds=self._parsed(row.seeds),
            genomes=record.genomes if sample is None else sample,
            episodes=record.episodes,
            metrics=record.metrics,
            fitness=record.fitness,
            summary=row.summary,
            leader=row.leader,
        )

    def one_generation(self, generation: int) -> Iterator[GenerationResult]:
        """Yield a generation, if it is there."""
        with self._generations() as generations:
            row = generations.row(generation)
            evaluation = None if row is None else self._evaluated(generations, row)
        if evaluation is not None:
            yield evaluation

    def used_seeds(self) -> set[int]:
        """Return every simulation seed of the finished generations, compared with nothing."""
        with self._generations() as generations:
            texts = generations.seeds()
        return {seed for text in texts for seed in self._parsed(text)}

    def ended(self, *, now: bool = False) -> str:
        """Return what ended a run that is done, also after the moment of this reader; empty if not known.

        now: of a run that went on at that moment, where what is stored then is of its session before.
        """
        then = "" if now else self._facts_then().get("ended", "")
        return then or self._facts_now().get("ended", "")

    def outcome(self) -> str | None:
        """Return how the last session that there is now ended; None as long as it has not."""
        with self._reading() as connection:
            rows = session_rows(connection)
        return rows[-1]["outcome"] if rows else None

    def server_use(self) -> dict[str, ServerUse]:
        """Return the use of the servers of each launcher in all sessions, of those that are counted."""
        text = self._facts_then().get("servers")
        try:
            return {} if text is None else from_json(text)
        except (ValueError, KeyError, TypeError, AttributeError) as error:
            raise DamageError(self.file, f"the fact servers: {error}") from error

    def channels(self) -> dict[str, Any] | None:
        """Return what is stored of sensors and actuators, see `catalogue.channels`.

        None of a simulation that only servers know. Raises InputError where it is not such a mapping.
        """
        text = self._facts_then().get("channels")
        if text is None:
            return None
        values = self._parsed(text)
        problem = _problem_of(values)
        if problem:
            raise DamageError(self.file, f"the fact channels: {problem}")
        found: dict[str, Any] = values
        return found

    def validation(self) -> dict[str, Any] | None:
        """Return what is stored of the validation, see `runs.validation`; None of a run that has none yet."""
        facts = self._facts_then()
        if "validation" in facts:
            values: dict[str, Any] = self._parsed(facts["validation"])
            return values
        return None

    def audit(self) -> dict[str, int] | None:
        """Return what is stored of the audit at the end of the run; None of a run without one."""
        text = self._facts_then().get("audit")
        values: dict[str, int] | None = None if text is None else self._parsed(text)
        return values

    def transfer(self) -> dict[str, Any] | None:
        """Return what is stored of the transfer, see `runs.transfer.at_end`; None of a run without one."""
        text = self._facts_then().get("transfer")
        values: dict[str, Any] | None = None if text is None else self._parsed(text)
        return values

    def record(self) -> Record:
        """Return every evaluation of the finished generations."""
        with self._generations() as generations:
            parts = [part for row in generations.rows() for part in generations.evaluations(row)]
        return self._joined(parts)

    def rows(self) -> Iterator[Record]:
        """Yield every evaluation, a block at a time, so that memory stays flat.

        None of a generation is yielded before all of it has been compared with its digest.
        """
        with self._pieces() as begin:
            with begin() as connection:
                rows = self._opened(connection).rows()
            yield from pieces.evaluations(begin, rows, self._opened)

    def episodes_left_out(self) -> int:
        """Return how many episodes candidates did not go through that have not failed: dropped in a race."""
        return sum(int(np.isnan(row.episodes[np.isfinite(row.fitness)]).sum()) for row in self.rows())

    def measured(self, metric: str) -> int:
        """Return how many evaluations have a metric."""
        column = self.metrics.index(metric)
        return sum(int(np.isfinite(part.metrics[:, :, column]).any(axis=1).sum()) for part in self.rows())

    def fitness(self) -> NDArray[np.float64]:
        """Return the fitness of every evaluation of the finished generations, in order."""
        with self._generations() as generations:
            return generations.fitness()

    def best_fitness(self, first: int, end: int) -> float:
        """Return the best fitness of the evaluations from `first` to before `end`; NaN where all failed."""
        with self._generations() as generations:
            return generations.best_fitness(first, end)

    def seeds(self, generation: int) -> list[int]:
        """Return the simulation seed of each episode of a generation."""
        with self._lookup() as lookup:
            seeds: list[int] = self._parsed(lookup.row(generation).seeds)
        return seeds

    @contextmanager
    def _lookup(self) -> Iterator[Lookup]:
        with self._generations() as generations:
            yield Lookup(generations, self._folder, len(self.metrics), self._best_of_equals)

    @cached_property
    def _best_of_equals(self) -> BestOfEquals | None:
        """Finds the best in runs of `nsga2`, one of the front; None: the first of equal ones is the best."""
        method = self._parsed(self._facts["experiment"])["method"]
        return BestOfEquals(method["objectives"], self.metrics) if method["kind"] == "nsga2" else None

    def leading(
        self,
        count: int,
        *,
        last_only: bool = False,
        by_instance: bool = False,
        key: Callable[[Genome], object] = bytes,
    ) -> list[Evaluation]:
        """Return the best evaluation of the run, and the next best with other genomes: `Lookup.leading`."""
        with self._lookup() as lookup:
            return lookup.leading(count, last_only=last_only, by_instance=by_instance, key=key)

    def evaluation(self, candidate: SupportsIndex | None, generation: SupportsIndex | None) -> Evaluation:
        """Return one evaluation; None as in `Run.evaluation`."""
        which, of = (None if number is None else operator.index(number) for number in (candidate, generation))
        with self._lookup() as lookup:
            return lookup.evaluation(which, of)

    def leader(self, generation: int) -> Evaluation:
        """Return the evaluation that would be the best of the run if it had ended after this generation."""
        with self._lookup() as lookup:
            return lookup.leader(generation)

    def evaluations_of(self, evaluation: Evaluation) -> list[Evaluation]:
        """Return the evaluations of the same genome up to `one`, which is the last of them."""
        with self._lookup() as lookup:
            return lookup.evaluations_of(evaluation)

    def best(self) -> Best | None:
        """Return the best evaluation; None when there is none."""
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
                values = {**row, "versions": self._parsed(row["versions"])}
                if values["seconds"] is None:  # killed: known up to its last generation
                    values["seconds"] = reached.get(values["session"])
                sessions.append(parse_journal_line(Session, values))
        return sessions

    def session_of(self, generation: int) -> int:
        """Return the session in which a generation was evaluated. Raises InputError without that one."""
        with self._reading() as connection:
            row = connection.execute(
                "SELECT session FROM generation WHERE generation = ? AND generation < ?",
                (generation, self._end),
            ).fetchone()
        if row is None:
            self.seeds(generation)  # says which there are
            raise AssertionError
        return int(row[0])

    def first_of_present_code(self) -> int:
        """Return the number of the first evaluation since which the simulation's code has not changed."""
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
        """Return the SHA-256 of each version of the source that was copied, from 1 on."""
        numbered = {name.partition(".")[2]: digest for name, digest in self._facts_then().items()}
        return {int(number): digest for number, digest in sorted(numbered.items()) if number.isdecimal()}

    def attempts(self) -> Iterator[Attempt]:
        """Yield every attempt at evaluations, in the order in which they ended."""
        with self._pieces() as begin:
            yield from journal.lines(begin, Attempt, "attempt", self._last_attempt)

    @property
    def _last_attempt(self) -> int:
        return LARGEST if self._moment is None else self._moment.attempts

    def evaluators(self, generations: Collection[int]) -> journal.Evaluators:
        """Return which servers evaluated some generations."""
        with self._reading() as connection:
            return journal.evaluators(connection, generations, self._last_attempt)

    def servers(self) -> list[ServerShare]:
        """Return what each server did, by its number."""
        with self._reading() as connection:
            return journal.shares(connection, self._last_attempt)

    def failures(self) -> list[FailureReason]:
        """Return why attempts failed, the most frequent reason first."""
        with self._reading() as connection:
            return journal.failures(connection, self._last_attempt)

    def events(self) -> Iterator[Event]:
        """Yield the warnings, in order."""
        last = LARGEST if self._moment is None else self._moment.events
        with self._pieces() as begin:
            yield from journal.lines(begin, Event, "event", last)

    def _joined(self, parts: list[Record]) -> Record:
        try:
            return joined(parts, len(self.metrics))
        except ValueError as error:
            raise DamageError(self.file, str(error)) from error


@dataclass(frozen=True)
class Moment:
    """What a store holds at a moment; it only grows."""

    generations: int
    """Finished ones."""
    attempts: int
    """Number of the last row of the table; 0 without one."""
    events: int
    """The same."""
    sessions: tuple[dict[str, Any], ...]
    """Rows of the table, by column: the last one changes when its session ends."""

    @classmethod
    def of(cls, connection: sqlite3.Connection) -> Self:
        """Return the moment that the connection's transaction reads."""

        def last(column: str, table: str) -> int | None:
            found = connection.execute(f"SELECT max({column}) FROM {table}").fetchone()[0]  # noqa: S608 - our own names
            return None if found is None else int(found)

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


def _problem_of(channels: Any) -> str | None:  # noqa: ANN401 - whatever a file says
    """Return what is wrong with channels as `catalogue.channels` describes them; None when nothing is."""
    if not isinstance(channels, Mapping) or not isinstance(channels.get("groups", {}), Mapping):
        return "a mapping was expected"
    for where in (channels, *channels.get("groups", {}).values()):
        if not isinstance(where, Mapping):
            return "groups: a mapping for each group was expected"
        for which in ("sensor", "actuator"):
            for about in ("names", "units", "ranges"):
                found = where.get(f"{which}_{about}", [])
                if not isinstance(found, list):
                    return f"{which}_{about}: a list was expected"
                if about != "ranges" and not all(isinstance(name, str) for name in found):
                    return f"{which}_{about}: texts were expected"
            try:
                _ = [Range.of(ends) for ends in where.get(f"{which}_ranges", [])]
            except ValueError as error:
                return f"{which}_ranges: {error}"
    seconds = channels.get("step_seconds")
    if seconds is not None and not (isinstance(seconds, int | float) and 0 < seconds < float("inf")):
        return f"step_seconds: {seconds!r} found, expected seconds above 0, or null"
    return None
