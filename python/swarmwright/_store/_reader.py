"""Reading a store, while a run writes it or afterwards."""

import json
import math
import sqlite3
from collections.abc import Iterator
from contextlib import AbstractContextManager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmwright._errors import InputError, RunError
from swarmwright._statistics import Summary
from swarmwright._store._database import FILE, reading
from swarmwright._store._rows import Attempt, Evaluated, Event, Session
from swarmwright.representations._base import Genome

_CHUNK = 256  # generations' rows are fetched so many evaluations at a time
_HISTORY = (
    "SELECT generation, evaluations, best, mean, best_so_far, lower_quartile, median, upper_quartile, failed "
    "FROM generation ORDER BY generation"
)
_EVALUATIONS = (
    "SELECT generation, candidate, fitness, episodes, metrics, genome FROM evaluation ORDER BY number"
)
_LEADER = "SELECT leader FROM generation ORDER BY generation DESC LIMIT 1"


@dataclass(frozen=True)
class Record:
    """Every evaluation of a run, sorted by generation and candidate."""

    generation: NDArray[np.int64]
    """(evaluations,)"""
    candidate: NDArray[np.int64]
    """(evaluations,)"""
    fitness: NDArray[np.float64]
    """(evaluations,), NaN where it failed."""
    episodes: NDArray[np.float64]
    """(evaluations, episodes)"""
    metrics: NDArray[np.float64]
    """(evaluations, episodes, metrics)"""
    genomes: NDArray[np.float32]
    """(evaluations, genome_size)"""


@dataclass(frozen=True)
class Evaluation:
    """One line of the record."""

    number: int
    """In the whole run, from 0."""
    generation: int
    candidate: int
    fitness: float
    """As the ranking made it; NaN when it failed."""
    seeds: list[int]
    """Simulation seed of each episode."""
    episodes: NDArray[np.float64]
    """(episodes,) fitness"""
    metrics: NDArray[np.float64]
    """(episodes, metrics)"""
    genome: Genome


@dataclass(frozen=True)
class Best:
    """The evaluation that leads in the end; of equals, the first."""

    fitness: float
    generation: int
    candidate: int
    genome: Genome


class StoreReader:
    """Reads the store in a run folder.

    Raises InputError, here and in every method, when the store is missing, damaged, or of another version.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self.file = folder / FILE
        """The store itself."""
        _ = self._facts  # complain now rather than later

    def _reading(self) -> AbstractContextManager[sqlite3.Connection]:
        return reading(self.file)

    @cached_property
    def _facts(self) -> dict[str, str]:
        with self._reading() as connection:
            facts = dict(connection.execute("SELECT name, value FROM fact"))
        missing = {"experiment", "metrics", "name", "created"} - facts.keys()
        if missing:
            raise InputError(f"{self.file}: is damaged: {min(missing)} is missing")
        return facts

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
        with self._reading() as connection:
            (text,) = connection.execute("SELECT value FROM fact WHERE name = 'experiment'").fetchone()
        values: dict[str, Any] = self._parsed(text)
        return values

    def _parsed(self, text: str) -> Any:  # noqa: ANN401 - JSON
        try:
            return json.loads(text)
        except (ValueError, TypeError) as error:
            raise InputError(f"{self.file}: is damaged: {error}") from error

    def history(self) -> list[Summary]:
        """Return the figures of each finished generation."""
        with self._reading() as connection:
            return [_summary(row) for row in connection.execute(_HISTORY)]

    def generations(self) -> Iterator[Evaluated]:
        """Yield the generations in order, one in memory at a time."""
        for index, summary in enumerate(self.history()):
            if summary.generation != index:
                raise InputError(f"{self.file}: is damaged: generation {index} is missing")
            yield self._evaluated(summary)

    def _evaluated(self, summary: Summary) -> Evaluated:
        with self._reading() as connection:
            first, leader, seeds = connection.execute(
                "SELECT first, leader, seeds FROM generation WHERE generation = ?", (summary.generation,)
            ).fetchone()
            rows = connection.execute(
                "SELECT generation, candidate, fitness, episodes, metrics, genome FROM evaluation "
                "WHERE number BETWEEN ? AND ? ORDER BY number",
                (first, summary.evaluations - 1),
            ).fetchall()
            first, leader = int(first), int(leader)
        if len(rows) != summary.evaluations - first:
            missing = summary.evaluations - first - len(rows)
            raise InputError(
                f"{self.file}: is damaged: {missing} evaluations of generation {summary.generation} "
                "are missing"
            )
        record = self._record(rows)
        return Evaluated(
            generation=summary.generation,
            seeds=self._parsed(seeds),
            genomes=record.genomes,
            episodes=record.episodes,
            metrics=record.metrics,
            fitness=record.fitness,
            summary=summary,
            leader=leader,
        )

    def one_generation(self, generation: int) -> Iterator[Evaluated]:
        """Yield a generation, if it is there."""
        for summary in self.history():
            if summary.generation == generation:
                yield self._evaluated(summary)

    def used_seeds(self) -> set[int]:
        """Return every simulation seed of the finished generations."""
        with self._reading() as connection:
            rows = connection.execute("SELECT DISTINCT seeds FROM generation").fetchall()
        return {seed for (text,) in rows for seed in self._parsed(text)}

    def ended(self) -> str:
        """Return what ended a run that is done; empty where that was not written."""
        with self._reading() as connection:
            row = connection.execute("SELECT value FROM fact WHERE name = 'ended'").fetchone()
        return "" if row is None else str(row[0])

    def unseen(self) -> dict[str, Any] | None:
        """Return how the best did on seeds that the run did not use; None when that was not evaluated."""
        with self._reading() as connection:
            row = connection.execute("SELECT value FROM fact WHERE name = 'unseen'").fetchone()
        return None if row is None else self._parsed(row[0])

    def record(self) -> Record:
        """Return every evaluation of the finished generations."""
        with self._reading() as connection:
            rows = connection.execute(_EVALUATIONS).fetchall()
        return self._record(rows)

    def rows(self) -> Iterator[Record]:
        """Yield every evaluation, some hundred at a time, so that memory stays flat."""
        with self._reading() as connection:
            cursor = connection.execute(_EVALUATIONS)
            while rows := cursor.fetchmany(_CHUNK):
                yield self._record(rows)

    def seeds(self, generation: int) -> list[int]:
        """Return the simulation seed of each episode of a generation."""
        with self._reading() as connection:
            seeds: list[int] = self._parsed(self._generation(connection, generation)[0])
        return seeds

    def evaluation(self, candidate: int | None, generation: int | None) -> Evaluation:
        """Return one evaluation; what None means, `Run.evaluation` says."""
        with self._reading() as connection:
            number = self._number(connection, candidate, generation)
            row = connection.execute(
                "SELECT generation, candidate, fitness, episodes, metrics, genome FROM evaluation "
                "WHERE number = ?",
                (number,),
            ).fetchone()
            if row is None:
                (count,) = connection.execute("SELECT count(*) FROM evaluation").fetchone()
                there = _range(count, "evaluation")
                raise InputError(f"{self._folder}: holds {there}, not {number}")
            seeds = self._parsed(self._generation(connection, row[0])[0])
        one = self._record([row])
        return Evaluation(
            number,
            int(one.generation[0]),
            int(one.candidate[0]),
            float(one.fitness[0]),
            seeds,
            one.episodes[0],
            one.metrics[0],
            one.genomes[0],
        )

    def _number(self, connection: sqlite3.Connection, candidate: int | None, generation: int | None) -> int:
        """Return the number, in the whole run, of the evaluation that is meant."""
        if generation is None:
            if candidate is not None:
                return candidate
            leader = connection.execute(_LEADER).fetchone()
            if leader is None:
                raise RunError(nothing(self._folder))
            return int(leader[0])
        _, first, count = self._generation(connection, generation)
        if candidate is None:
            # NULL, of a failed evaluation, comes last.
            (number,) = connection.execute(
                "SELECT number FROM evaluation WHERE number >= ? AND number < ? "
                "ORDER BY fitness DESC, number LIMIT 1",
                (first, first + count),
            ).fetchone() or (first,)
            return int(number)
        if not 0 <= candidate < count:
            there = _range(count, "candidate")
            raise InputError(f"{self._folder}: generation {generation} has {there}, not {candidate}")
        return first + candidate

    def _generation(self, connection: sqlite3.Connection, generation: int) -> tuple[str, int, int]:
        """Return seeds, number of the first evaluation, and number of evaluations of a generation."""
        row = connection.execute(
            "SELECT seeds, first, evaluations - first FROM generation WHERE generation = ?", (generation,)
        ).fetchone()
        if row is None:
            (count,) = connection.execute("SELECT count(*) FROM generation").fetchone()
            there = _range(count, "generation")
            raise InputError(f"{self._folder}: holds {there}, not {generation}")
        seeds, first, count = row
        return seeds, first, count

    def best(self) -> Best | None:
        """Return the best evaluation; None when there is none."""
        with self._reading() as connection:
            return best_of(connection)

    def sessions(self) -> list[Session]:
        """Return who worked on the run, in order."""
        with self._reading() as connection:
            reached = dict(
                connection.execute("SELECT session, max(seconds) FROM generation GROUP BY session")
            )
            cursor = connection.execute("SELECT * FROM session ORDER BY session")
            names = [column[0] for column in cursor.description]
            rows = cursor.fetchall()
        sessions = []
        for row in rows:
            values = dict(zip(names, row, strict=True))
            values["versions"] = self._parsed(values["versions"])
            if values["seconds"] is None:  # killed: known up to its last generation
                values["seconds"] = reached.get(values["session"])
            sessions.append(Session(**values))
        return sessions

    def session_of(self, generation: int) -> int:
        """Return the session in which a generation was evaluated. Raises InputError without that one."""
        with self._reading() as connection:
            row = connection.execute(
                "SELECT session FROM generation WHERE generation = ?", (generation,)
            ).fetchone()
            if row is None:
                self._generation(connection, generation)  # says which there are
                raise AssertionError
        return int(row[0])

    def code(self) -> dict[int, str]:
        """Return the SHA-256 of each version of the source that was copied, from 1 on."""
        with self._reading() as connection:
            rows = connection.execute("SELECT name, value FROM fact WHERE name GLOB 'code.[0-9]*'").fetchall()
        return {int(name.partition(".")[2]): digest for name, digest in sorted(rows)}

    def attempts(self) -> Iterator[Attempt]:
        """Yield every attempt at evaluations, in the order in which they ended."""
        yield from self._each(Attempt, "attempt")

    def events(self) -> Iterator[Event]:
        """Yield the warnings, in order."""
        yield from self._each(Event, "event")

    def _each(self, kind: type[Any], table: str) -> Iterator[Any]:
        with self._reading() as connection:
            cursor = connection.execute(f"SELECT * FROM {table} ORDER BY rowid")  # noqa: S608 - our own names
            names = [column[0] for column in cursor.description]
            for row in cursor:
                yield kind(**dict(zip(names, row, strict=True)))

    def _record(self, rows: list[tuple[Any, ...]]) -> Record:
        count, metrics = len(rows), len(self.metrics)
        try:
            columns = list(zip(*rows, strict=True)) if rows else [()] * 6
            episodes = _numbers(columns[3], "<f8", count)
            return Record(
                np.array(columns[0], dtype=np.int64),
                np.array(columns[1], dtype=np.int64),
                np.array([math.nan if value is None else value for value in columns[2]], dtype=np.float64),
                episodes,
                _numbers(columns[4], "<f8", count).reshape(count, episodes.shape[1], metrics),
                _numbers(columns[5], "<f4", count),
            )
        except (ValueError, TypeError) as error:
            raise InputError(f"{self.file}: is damaged: {error}") from error


def nothing(folder: Path) -> str:
    """Say that there is no best candidate yet."""
    return f"{folder}: holds no finished generation, so there is no best candidate"


def best_of(connection: sqlite3.Connection) -> Best | None:
    """Return the evaluation that leads after the last generation."""
    row = connection.execute(
        f"SELECT fitness, generation, candidate, genome FROM evaluation WHERE number = ({_LEADER})"  # noqa: S608
    ).fetchone()
    if row is None:
        return None
    fitness, generation, candidate, genome = row
    return Best(fitness, generation, candidate, np.frombuffer(genome, dtype="<f4").astype(np.float32))


def _range(count: int, what: str) -> str:
    if count == 0:
        return f"no finished {what}"
    return f"one {what}, number 0" if count == 1 else f"the {what}s 0 to {count - 1}"


def _numbers(blobs: tuple[bytes, ...], kind: str, count: int) -> NDArray[Any]:
    values = np.frombuffer(b"".join(blobs), dtype=kind)
    # Without rows, the width is not known and does not matter.
    return values.astype(kind[1:]).reshape(count, -1 if count else 0)


def _summary(row: tuple[Any, ...]) -> Summary:
    generation, evaluations, *figures, failed = row
    best, mean, best_so_far, lower, median, upper = (
        math.nan if value is None else float(value) for value in figures
    )
    return Summary(
        generation=int(generation),
        evaluations=int(evaluations),
        best=best,
        mean=mean,
        best_so_far=best_so_far,
        lower_quartile=lower,
        median=median,
        upper_quartile=upper,
        failed=int(failed),
    )
