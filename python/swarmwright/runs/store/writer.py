"""Write the store: a generation is stored completely or not at all."""

import json
import math
import platform
import socket
import sqlite3
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

from swarmwright import _engine
from swarmwright.common.arrays import shortest
from swarmwright.common.errors import InputError, RunError, SwarmwrightError
from swarmwright.common.files import write_text
from swarmwright.common.tracebacks import exception_text, locate_error
from swarmwright.common.yaml import dump
from swarmwright.controllers import Representation
from swarmwright.runs.store.database import FILE, NEW, get_error_code, seal_facts, transaction
from swarmwright.runs.store.folder import EXPERIMENT, build_missing_store_error, check_folder
from swarmwright.runs.store.generations import digest_before
from swarmwright.runs.store.insertion import SeedsText, insert_event, insert_generation, insert_journal
from swarmwright.runs.store.journal import format_incidents
from swarmwright.runs.store.lock import Lock, MovedError
from swarmwright.runs.store.open_store import OpenStore
from swarmwright.runs.store.provenance import HASH_SEED, record_experiment, timestamp, versions
from swarmwright.runs.store.reader import StoreReader
from swarmwright.servers.rows import GenerationResult, Journal, ServerUses, add_uses, to_json
from swarmwright.simulations.user_code.copying import FOLDER as CODE
from swarmwright.simulations.user_code.copying import Copy
from swarmwright.simulations.user_code.copying import remove as remove_copies
from swarmwright.simulations.user_code.parts import Part
from swarmwright.simulations.user_code.permission import remember

if TYPE_CHECKING:
    from swarmwright.experiment.experiment import Experiment

_COMMIT_INTERVAL_S = 0.02
"""Seconds within which generations are written in one transaction."""
_WORTHWHILE_GENERATIONS = 32
"""Generations that justify a transaction in idle time."""
_LARGEST_UNWRITTEN_BYTES = 1 << 20
"""Bytes of genomes and results that are written at once, while they are in the processor's cache."""
_DRAFT_S = 1.0
"""Seconds for which a new store is a draft, which is lost if the process is killed."""


class StoreWriter:
    """Writes a run folder's store. A context manager around one session.

    Created by `create` or `resume`; only one writer can exist at a time. Generations are stored at once, or
    after 20 ms if they follow each other faster. In the first second of a new run, the store is a draft with
    another name, which only `reader` finds. `keep` ends both delays.
    """

    def __init__(self, folder: Path, store: OpenStore, lock: Lock) -> None:
        self.folder = folder
        self.file = store.file
        self._store = store
        self._lock = lock
        self._session = 0
        self._started = self._written = time.monotonic()
        self._outcome: str | None = None
        self._ended: float | None = None
        self._finished: list[tuple[GenerationResult, float]] = []  # unwritten, with seconds of this session
        self._facts: dict[str, str] = {}  # unwritten
        self._bytes = 0  # of genomes and results in `_finished`
        self._seed_texts = SeedsText()
        self._use: Callable[[], ServerUses] | None = None
        self._earlier_use: ServerUses = {}

    @classmethod
    def create(
        cls,
        folder: Path,
        experiment: "Experiment",
        metrics: Sequence[str],
        code: Sequence[Part] = (),
        generation: int = 0,
        channels: Mapping[str, Any] | None = None,
    ) -> Self:
        """Create a run folder with an empty store.

        Args:
            folder: new or empty.
            experiment: with its numbers of sensors and actuators.
            metrics: names, in the order in which they are stored.
            code: user code, of which a copy is kept.
            generation: approximate bytes per generation.
            channels: sensors and actuators, see `catalogue.channels`.

        Raises:
            InputError: the folder cannot be written, or is not empty.
        """
        check_folder(folder)
        facts = {
            "name": experiment.path.stem if experiment.path is not None else experiment.label,
            "metrics": json.dumps(list(metrics)),
            "created": timestamp(),
        }
        if channels is not None:
            facts["channels"] = json.dumps(channels, allow_nan=False)
        try:
            folder.mkdir(parents=True, exist_ok=True)
            (folder / NEW).touch()  # marks the folder as a run folder if the process is killed now
        except OSError as error:
            raise InputError(f"{folder}: cannot be written: {error.strerror}") from error
        lock = Lock(folder)
        try:
            if (folder / FILE).exists():  # another process was faster
                check_folder(folder)
            remove_copies(folder)  # of a process that was killed before it had a store
            copy = Copy.write(folder, 1, code) if code else None
            remember(code)
            values = record_experiment(experiment, copy)
            if copy is not None:
                facts[f"{CODE}.1"] = copy.digest
            facts["experiment"] = json.dumps(values, allow_nan=False)
            write_text(folder / EXPERIMENT, dump(values))
            return cls(folder, OpenStore.create(folder / FILE, facts, generation), lock)
        except OSError as error:
            lock.close()
            raise InputError(f"{folder}: cannot be written: {error.strerror}") from error
        except BaseException:
            lock.close()
            raise

    @classmethod
    def resume(cls, folder: Path) -> Self:
        """Open a run folder to continue the run.

        Raises:
            InputError: it is not a run folder, its store is damaged or not writable, or another process works
                on it.
        """
        file = folder / FILE
        if not file.is_file():
            raise build_missing_store_error(folder)
        lock = Lock(folder)
        try:
            if not (folder / EXPERIMENT).exists():
                write_text(folder / EXPERIMENT, dump(StoreReader(folder).experiment()))
            return cls(folder, OpenStore.reopen(file), lock)
        except BaseException:
            lock.close()
            raise

    def replace_experiment(self, experiment: "Experiment", copy: Copy | None) -> None:
        """Store a changed experiment, such as one with a larger budget.

        copy: copy of the code that the run continues with; None if it has no user code.
        """
        values = record_experiment(experiment, copy)
        with self._writing():
            self._store.connection.execute(
                "UPDATE fact SET value = ? WHERE name = 'experiment'", (json.dumps(values, allow_nan=False),)
            )
            seal_facts(self._store.connection)
        write_text(self.folder / EXPERIMENT, dump(values))

    def keep_code(self, version: int, code: Sequence[Part]) -> Copy:
        """Keep a copy of the code that the run continues with. Raises RunError when the disk refuses it."""
        try:
            copy = Copy.write(self.folder, version, code)
            remember(code)
        except OSError as error:
            raise RunError(f"{self.folder}: cannot be written: {error.strerror}") from error
        with self._writing():
            self._store.connection.execute(
                "INSERT OR REPLACE INTO fact VALUES (?, ?)", (f"{CODE}.{version}", copy.digest)
            )
            seal_facts(self._store.connection)
        return copy

    def begin(
        self,
        place: str,  # pylint: disable=disallowed-name # of the session
        libraries: Sequence[str] = (),
        code: int | None = None,
        notes: Iterable[str] = (),
        classes: Mapping[str, str] | None = None,
        hash_seed: str | None = None,
    ) -> None:
        """Begin a session, and note its time, machine and versions.

        Args:
            place: description of where episodes are evaluated.
            libraries: packages that the method, the simulation and plug-ins import.
            code: version of the copy of their source, if there is one.
            notes: accepted changes since the last session.
            classes: fingerprints of classes without a file, by name.
            hash_seed: Python's hash seed, if Python evaluates and it is known.
        """
        hash_seeds = {} if hash_seed is None else {HASH_SEED: hash_seed}
        self._started = time.monotonic()
        with self._writing():
            cursor = self._store.connection.execute(
                "INSERT INTO session (started, place, host, machine, versions, code) "
                "VALUES (?, ?, ?, ?, ?, ?)",
                (
                    *(timestamp(), place, socket.gethostname(), platform.platform()),
                    *(json.dumps({**versions(libraries), **hash_seeds, **(classes or {})}), code),
                ),
            )
            self._session = int(cursor.lastrowid or 0)
            for note in notes:
                insert_event(self._store.connection, self._session, "changed", note)

    def commit(self, result: GenerationResult) -> None:
        """Write a generation and its journal, completely or not at all.

        Raises RunError when the disk refuses it; everything written before is kept.
        """
        now = time.monotonic()
        self._finished.append((result, now - self._started))
        self._bytes += result.episodes.nbytes + result.metrics.nbytes
        if not isinstance(result.genomes, _engine.Sample):
            self._bytes += result.genomes.nbytes
        if self._bytes >= _LARGEST_UNWRITTEN_BYTES or now - self._written >= _COMMIT_INTERVAL_S:
            self._flush()
        self.keep_soon()

    def use_idle_time(self) -> None:
        """Use idle time to write finished generations if there are many. Raises RunError as `commit`."""
        if len(self._finished) >= _WORTHWHILE_GENERATIONS:
            self._flush()

    def keep_soon(self) -> None:
        """End the draft when its time is over; call it regularly. Raises RunError as `commit`."""
        if self._store.draft and time.monotonic() - self._started >= _DRAFT_S:
            self.keep()

    def keep(self) -> None:
        """Write everything so that it survives a killed process. Raises RunError as `commit`."""
        self._flush()
        self._lock.check()
        self._store.keep()

    def _flush(self) -> None:
        """Write finished generations; if the disk is nearly full, as many as fit."""
        finished, self._bytes = self._finished, 0
        try:
            self._write_now()
        except RunError:
            if len(finished) == 1:
                raise
            self._write_singly(finished)

    def _write_singly(self, finished: list[tuple[GenerationResult, float]]) -> None:
        """Write each generation in its own transaction; unwritten generations stay in `_finished`."""
        try:
            while finished:
                self._finished = finished[:1]
                self._write_now()
                del finished[0]
        finally:
            self._finished = finished

    def _write_now(self) -> None:
        """Write finished generations and facts in one transaction."""
        if self._finished or self._facts:
            with self._writing():
                pass  # `_writing` itself writes them

    def reader(self) -> StoreReader:
        """Return a reader of everything so far, including all finished generations."""
        self._flush()
        return StoreReader(self.folder, self._store.name, lambda: self._store.connection)

    def _write_finished(self) -> None:
        """Write the finished generations, within a transaction."""
        if not self._finished:
            return
        # After an interrupt, some may already be committed.
        (last,) = self._store.connection.execute("SELECT max(generation) FROM generation").fetchone()
        unwritten = [entry for entry in self._finished if last is None or entry[0].generation > last]
        digest = digest_before(self._store.connection, unwritten[0][0].generation) if unwritten else ""
        for result, seconds in unwritten:
            digest = insert_generation(
                self._store.connection, self._session, result, seconds, digest, self._seed_texts
            )

    def note(self, generation: int, journal: Journal) -> None:
        """Write the journal of an incomplete generation, whose evaluations do not count."""
        with self._writing():
            insert_journal(self._store.connection, self._session, generation, journal)

    @contextmanager
    def _writing(self, *, moved: bool = False) -> Iterator[None]:
        """Commit all or nothing, finished generations first.

        moved: write even if the folder was moved.

        Raises RunError when the disk refuses it, another process wrote, or the folder was moved.
        """
        if not moved:
            self._lock.check()
        with transaction(self._store.connection, self.file):
            if self._session:
                # Another program deleted the lock, or the file system ignores it.
                (latest,) = self._store.connection.execute("SELECT max(session) FROM session").fetchone()
                if latest != self._session:
                    raise RunError(
                        f"{self.folder}: another process continues this run, although this process had "
                        "locked it; the other process's results count, and this process ends"
                    )
            self._write_finished()
            if self._use is not None and (uses := add_uses(self._earlier_use, self._use())):
                self._facts["servers"] = to_json(uses)
            if self._facts:
                self._store.connection.executemany(
                    "INSERT OR REPLACE INTO fact VALUES (?, ?)", self._facts.items()
                )
                seal_facts(self._store.connection)
            yield
        self._finished.clear()
        self._facts.clear()
        self._written = time.monotonic()

    def incidents(self, counts: Mapping[str, int]) -> None:
        """Write the counts of faults and countermeasures in this session."""
        if not counts:
            return
        with suppress(RunError), self._writing():
            text = format_incidents(self._store.connection, self._session, counts)
            insert_event(self._store.connection, self._session, "incidents", text)

    def usage(self, text: str) -> None:
        """Write which remote servers were used in this session, and their cost."""
        if text:
            with suppress(RunError), self._writing():
                insert_event(self._store.connection, self._session, "servers", text)

    def follow_use(self, earlier: ServerUses, use: Callable[[], ServerUses]) -> None:
        """Update the stored use of servers in every later transaction of this session.

        Args:
            earlier: use in the sessions before.
            use: returns the use in this session so far.
        """
        self._earlier_use, self._use = earlier, use

    def note_validation(self, values: Mapping[str, Any]) -> None:
        """Write the results of the best candidates on held-out seeds; they are not part of the record."""
        self._note_fact("validation", json.dumps(dict(values), allow_nan=False))
        self.keep_soon()

    def note_transfer(self, values: Mapping[str, Any]) -> None:
        """Write the results of the best candidates in other simulations; they are not part of the record."""
        self._note_fact("transfer", json.dumps(dict(values), allow_nan=False))
        self.keep_soon()

    def note_audit(self, values: Mapping[str, int]) -> None:
        """Write the result of the audit, see `runs.optimization.audit`."""
        self._note_fact("audit", json.dumps(dict(values)))
        self.keep_soon()

    def note_ended(self, ended: str | None) -> None:
        """Write which budget a finished run has used up, or that it reached its target."""
        self._note_fact("ended", ended or "")

    def _note_fact(self, name: str, value: str) -> None:
        """Write a fact: in a draft with the next transaction, otherwise now."""
        self._facts[name] = value
        if not self._store.draft:
            self._flush()

    def conclude(self, outcome: str) -> None:
        """Set the outcome of this session: done, interrupted, stopped, or the reason of a failure.

        Later work, such as the validation, does not count towards the session's duration.
        """
        self._outcome = outcome
        self._ended = time.monotonic()

    @property
    def outcome(self) -> str | None:
        """Outcome of this session, None while it runs."""
        return self._outcome

    def save_best(self, representation: Representation) -> None:
        """Write best.json, the best controller so far, for programs that need only that."""
        best = self.reader().best()
        if best is None:
            return
        controller, genome = representation.specification(best.genome), shortest(best.genome)
        values: dict[str, Any] = {
            "fitness": best.fitness if math.isfinite(best.fitness) else None,
            "generation": best.generation,
            "candidate": best.candidate,
            "controller": controller,
        }
        if genome != controller["weights"]:  # `start_from` needs a genome that is not the weights
            values["genome"] = genome
        target, temporary = self.folder / "best.json", self.folder / "best.json.new"
        self._lock.check()
        try:
            temporary.write_text(json.dumps(values, indent=2, allow_nan=False) + "\n", encoding="utf-8")
            temporary.replace(target)
        except OSError as error:
            raise RunError(
                f"{target}: cannot be written: {error.strerror}; the evaluations are kept in {self.file}"
            ) from error

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, _: TracebackType | None
    ) -> None:
        if self._outcome is None and kind is not None:
            self._outcome = (
                "interrupted" if issubclass(kind, KeyboardInterrupt) else _describe_failure(kind, error)
            )
        try:
            self._lock.check()
        except MovedError as moved:
            if self._store.draft and self._store.is_open:  # no other run can be at the path of a draft
                with suppress(RunError), self._writing(moved=True):
                    pass
            self._store.abandon(self._lock.folder)
            self._lock.close()
            raise moved from error
        try:
            failed = self._close()
        finally:
            self._store.close()
            self._lock.close()
        # Another error that ended the session matters more, unless it is an interrupt.
        if failed is not None and (kind is None or issubclass(kind, KeyboardInterrupt)):
            raise failed from failed.__cause__

    def _close(self) -> RunError | None:
        """Write how the session ended and merge the store into one file; return the disk's error, if any."""
        failed = None
        try:
            self._flush()
        except RunError as error:
            failed = error
            self._finished.clear()  # there is no space for these, but perhaps for the session's end
            self._facts.clear()
        try:
            if self._session:
                with self._writing():
                    self._store.connection.execute(
                        "UPDATE session SET seconds = ?, outcome = ? WHERE session = ?",
                        ((self._ended or time.monotonic()) - self._started, self._outcome, self._session),
                    )
        except RunError as error:
            failed = failed or error
        try:
            self._store.finish()
        except RunError as error:
            if not _is_in_use(error):  # an open reader keeps the log, which does no harm
                failed = failed or error
        return failed


def _describe_failure(kind: type[BaseException], error: BaseException | None) -> str:
    """Describe the exception that ended a session; for errors in user code, with class and line."""
    if error is None:
        return kind.__name__
    return exception_text(error) if isinstance(error, SwarmwrightError) else locate_error(error)


def _is_in_use(error: RunError) -> bool:
    return get_error_code(error.__cause__) in {sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED}
