"""Writing the store: a generation is stored completely or not at all."""

import json
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
from swarmwright.runs.store.database import FILE, NEW, code_of, seal_facts, transaction
from swarmwright.runs.store.folder import EXPERIMENT, check_folder, without_store
from swarmwright.runs.store.generations import digest_before
from swarmwright.runs.store.insertion import SeedsText, insert_event, insert_generation, insert_journal
from swarmwright.runs.store.journal import incidents
from swarmwright.runs.store.lock import Lock, MovedError
from swarmwright.runs.store.open_store import OpenStore
from swarmwright.runs.store.provenance import HASH_SEED, recorded, timestamp, versions
from swarmwright.runs.store.reader import StoreReader
from swarmwright.servers.rows import GenerationResult, Journal
from swarmwright.servers.server_use import ServerUses, add_uses, to_json
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
"""Generations that are worth a transaction while there is nothing else to do."""
_LARGEST_UNWRITTEN_BYTES = 1 << 20
"""Bytes of genomes and results that are written at once all the same: memory used soon again is cached."""
_DRAFT_S = 1.0
"""Seconds for which a new store is a draft, which the end of the process at any moment would take."""


class StoreWriter:
    """Writes a run folder's store. A context manager around one session.

    Made by `create` or `resume`. Only one writer is possible at a time. What is written is in the store at
    once, or 20 ms later where generations follow each other faster. In the first second of a new run the
    store is a draft under another name, which only `reader` finds. `keep` ends both.
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
        self._finished: list[tuple[GenerationResult, float]] = []  # and seconds of this session before
        self._facts: dict[str, str] = {}  # that are to be written
        self._bytes = 0  # of genomes and results, in what is finished
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
        """Make a run folder with an empty store.

        Args:
            folder: new or empty.
            experiment: as it is run, sensors and actuators known.
            metrics: names, in the order in which they are stored.
            code: the source that is not Swarmwright's own, of which a copy is kept.
            generation: bytes that a generation is going to have, about.
            channels: what is known of sensors and actuators, see `catalogue.channels`.

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
            (folder / NEW).touch()  # marks the folder as a run folder should the process end now
        except OSError as error:
            raise InputError(f"{folder}: cannot be written: {error.strerror}") from error
        lock = Lock(folder)
        try:
            if (folder / FILE).exists():  # another process was faster
                check_folder(folder)
            remove_copies(folder)  # of a process that ended before there was a store
            copy = Copy.write(folder, 1, code) if code else None
            remember(code)
            values = recorded(experiment, copy)
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
        """Open a run folder to go on with it.

        Raises:
            InputError: it is not a run folder, its store is damaged or may not be written, or another process
                works on it.
        """
        file = folder / FILE
        if not file.is_file():
            raise without_store(folder)
        lock = Lock(folder)
        try:
            if not (folder / EXPERIMENT).exists():
                write_text(folder / EXPERIMENT, dump(StoreReader(folder).experiment()))
            return cls(folder, OpenStore.reopen(file), lock)
        except BaseException:
            lock.close()
            raise

    def replace_experiment(self, experiment: "Experiment", copy: Copy | None) -> None:
        """Note a changed experiment: a larger budget.

        copy: of the code with which the run goes on; None when there is none.
        """
        values = recorded(experiment, copy)
        with self._writing():
            self._store.connection.execute(
                "UPDATE fact SET value = ? WHERE name = 'experiment'", (json.dumps(values, allow_nan=False),)
            )
            seal_facts(self._store.connection)
        write_text(self.folder / EXPERIMENT, dump(values))

    def keep_code(self, version: int, code: Sequence[Part]) -> Copy:
        """Keep a copy of the source with which the run goes on. Raises RunError when the disk refuses it."""
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
        place: str,
        libraries: Sequence[str] = (),
        code: int | None = None,
        notes: Iterable[str] = (),
        classes: Mapping[str, str] | None = None,
        hash_seed: str | None = None,
    ) -> None:
        """Begin a session: note where, when and with what.

        Args:
            place: where it is evaluated.
            libraries: packages that the method, the simulation and plug-ins import.
            code: version of their source, if there is a copy.
            notes: what was changed deliberately since the last session.
            classes: fingerprints of classes that have no file, by their names.
            hash_seed: Python's, where it evaluates and that is known.
        """
        known = {} if hash_seed is None else {HASH_SEED: hash_seed}
        self._started = time.monotonic()
        with self._writing():
            cursor = self._store.connection.execute(
                "INSERT INTO session (started, place, host, machine, versions, code) "
                "VALUES (?, ?, ?, ?, ?, ?)",
                (
                    *(timestamp(), place, socket.gethostname(), platform.platform()),
                    *(json.dumps({**versions(libraries), **known, **(classes or {})}), code),
                ),
            )
            self._session = int(cursor.lastrowid or 0)
            for note in notes:
                insert_event(self._store.connection, self._session, "changed", note)

    def commit(self, result: GenerationResult) -> None:
        """Write a generation and how it was evaluated, wholly or not at all.

        Raises RunError when the disk does not take it; what was written before is kept.
        """
        now = time.monotonic()
        self._finished.append((result, now - self._started))
        self._bytes += result.episodes.nbytes + result.metrics.nbytes
        if not isinstance(result.genomes, _engine.Sample):
            self._bytes += result.genomes.nbytes
        if self._bytes >= _LARGEST_UNWRITTEN_BYTES or now - self._written >= _COMMIT_INTERVAL_S:
            self._flush()
        self.keep_soon()

    def has_time(self) -> None:
        """Write what is finished if there is enough of it: who calls waits for something anyway.

        Raises RunError as `commit`.
        """
        if len(self._finished) >= _WORTHWHILE_GENERATIONS:
            self._flush()

    def keep_soon(self) -> None:
        """End the draft when its time is over; called from time to time. Raises RunError as `commit`."""
        if self._store.draft and time.monotonic() - self._started >= _DRAFT_S:
            self.keep()

    def keep(self) -> None:
        """See to it that the end of the process does not take anything. Raises RunError as `commit`."""
        self._flush()
        self._lock.check()
        self._store.keep()

    def _flush(self) -> None:
        """Write what is finished; where the disk is nearly full, as many generations as fit."""
        finished, self._bytes = self._finished, 0
        try:
            self._write_now()
        except RunError:
            if len(finished) == 1:
                raise
            self._one_by_one(finished)

    def _one_by_one(self, finished: list[tuple[GenerationResult, float]]) -> None:
        """Write generations in a transaction each; those that were not written stay finished."""
        try:
            while finished:
                self._finished = finished[:1]
                self._write_now()
                del finished[0]
        finally:
            self._finished = finished

    def _write_now(self) -> None:
        """Write what is finished, in one transaction."""
        if self._finished or self._facts:
            with self._writing():
                pass  # that comes before anything else

    def reader(self) -> StoreReader:
        """Return a reader of what has been written so far, all that is finished among it."""
        self._flush()
        return StoreReader(self.folder, self._store.name, lambda: self._store.connection)

    def _write_finished(self) -> None:
        """Write the generations that are finished, within a transaction."""
        if not self._finished:
            return
        # After an interrupt some of them may have been committed.
        (last,) = self._store.connection.execute("SELECT max(generation) FROM generation").fetchone()
        left = [
            generation for generation in self._finished if last is None or generation[0].generation > last
        ]
        digest = digest_before(self._store.connection, left[0][0].generation) if left else ""
        for result, seconds in left:
            digest = insert_generation(
                self._store.connection, self._session, result, seconds, digest, self._seed_texts
            )

    def note(self, generation: int, journal: Journal) -> None:
        """Write the attempts of evaluations that do not count: those of an incomplete generation."""
        with self._writing():
            insert_journal(self._store.connection, self._session, generation, journal)

    @contextmanager
    def _writing(self, *, moved: bool = False) -> Iterator[None]:
        """Commit all or nothing, what is finished first.

        moved: write also where the folder was moved.

        Raises RunError when the disk does not take it, another process wrote, or the folder was moved.
        """
        if not moved:
            self._lock.check()
        with transaction(self._store.connection, self.file):
            if self._session:
                # The lock was deleted by another program, or is not effective on this file system.
                (latest,) = self._store.connection.execute("SELECT max(session) FROM session").fetchone()
                if latest != self._session:
                    raise RunError(
                        f"{self.folder}: another process has gone on with this run, although this one had "
                        "reserved it; what it writes counts, and this one ends"
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
        """Write how often faults occurred in this session, and how often countermeasures were taken."""
        if not counts:
            return
        with suppress(RunError), self._writing():
            text = incidents(self._store.connection, self._session, counts)
            insert_event(self._store.connection, self._session, "incidents", text)

    def usage(self, text: str) -> None:
        """Write what servers elsewhere were used in this session, and what they cost."""
        if text:
            with suppress(RunError), self._writing():
                insert_event(self._store.connection, self._session, "servers", text)

    def follow_use(self, earlier: ServerUses, use: Callable[[], ServerUses]) -> None:
        """Write, with everything that is written in this session, how servers were used in the whole run.

        Args:
            earlier: their use in the sessions before.
            use: returns their use in this session so far.
        """
        self._earlier_use, self._use = earlier, use

    def note_validation(self, values: Mapping[str, Any]) -> None:
        """Write what is known of the best candidates on held-out seeds; it is not part of the record."""
        self._note_fact("validation", json.dumps(dict(values), allow_nan=False))
        self.keep_soon()

    def note_transfer(self, values: Mapping[str, Any]) -> None:
        """Write what is known of the best candidates in other simulations; it is not part of the record."""
        self._note_fact("transfer", json.dumps(dict(values), allow_nan=False))
        self.keep_soon()

    def note_audit(self, values: Mapping[str, int]) -> None:
        """Write how many evaluations were repeated at the end, and how they came out; see `runs.audit`."""
        self._note_fact("audit", json.dumps(dict(values)))
        self.keep_soon()

    def note_ended(self, ended: str | None) -> None:
        """Write which budget a run that is done has used, or that the target was reached."""
        self._note_fact("ended", ended or "")

    def _note_fact(self, name: str, value: str) -> None:
        """Write a fact; with what is written next, where the end of the process would take it anyway."""
        self._facts[name] = value
        if not self._store.draft:
            self._flush()

    def conclude(self, outcome: str) -> None:
        """Say how this session ended: done, interrupted, stopped, or why it failed.

        What is done after it, the validation, is not part of the session's duration.
        """
        self._outcome = outcome
        self._ended = time.monotonic()

    @property
    def outcome(self) -> str | None:
        """How this session ended, None as long as it has not."""
        return self._outcome

    def save_best(self, representation: Representation) -> None:
        """Write best.json, the best controller so far, for programs that want nothing else."""
        best = self.reader().best()
        if best is None:
            return
        controller, genome = representation.specification(best.genome), shortest(best.genome)
        values = {
            "fitness": best.fitness,
            "generation": best.generation,
            "candidate": best.candidate,
            "controller": controller,
        }
        if genome != controller["weights"]:  # which are decoded from it; `start_from` needs it
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
            self._outcome = "interrupted" if issubclass(kind, KeyboardInterrupt) else _why(kind, error)
        try:
            self._lock.check()
        except MovedError as moved:
            if self._store.draft and self._store.is_open:  # a draft has nothing else at the path that it had
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
        # What ended the session otherwise says more; an interrupt does not.
        if failed is not None and (kind is None or issubclass(kind, KeyboardInterrupt)):
            raise failed from failed.__cause__

    def _close(self) -> RunError | None:
        """Write how the session ended, make one file of the store; return why the disk did not take it."""
        failed = None
        try:
            self._flush()
        except RunError as error:
            failed = error
            self._finished.clear()  # there is no space for it, but perhaps for how the session ended
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
            if not _in_use(error):  # an open reader keeps the log, which does no harm
                failed = failed or error
        return failed


def _why(kind: type[BaseException], error: BaseException | None) -> str:
    """Return what a session ended with; of an exception of the user's code, its class and line too."""
    if error is None:
        return kind.__name__
    return exception_text(error) if isinstance(error, SwarmwrightError) else locate_error(error)


def _in_use(error: RunError) -> bool:
    return code_of(error.__cause__) in {sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED}
