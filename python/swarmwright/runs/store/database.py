"""Open the store, and translate its errors."""

import errno
import os
import resource
import shutil
import sqlite3
import time
from collections.abc import Iterator, Mapping
from contextlib import closing, contextmanager
from functools import lru_cache
from pathlib import Path

from swarmwright.common.errors import InputError, RunError
from swarmwright.common.processes import advise_open_files, has_no_more_files
from swarmwright.experiment.document import STORE
from swarmwright.runs.store import digests

FILE = STORE
"""Name of the store in a run folder."""
NEW = f"{FILE}.new"
"""Name of the draft, before it becomes the store."""
FORMAT = 6
"""Version of the store. No other version is read."""
_PAGE_SIZES = ((1 << 20, 65536), (3 << 14, 16384), (0, 4096))
"""Least bytes per generation, and bytes per page: larger pages take half the time, but make the file larger
if generations do not fill them."""
_PATIENCE_S = 30.0
"""Seconds for which a resuming process waits for readers to finish."""
_PAGE_MARGIN = 1 << 17
"""Bytes below the largest size of a file at which a write may fail: a page and its header."""
_CAN_SERIALIZE = hasattr(sqlite3.Connection, "serialize")  # SQLite can be built without it
_LARGEST_VALUE = 1 << 28
"""Bytes of the longest value that is read. A column of a block has at most 4 MiB, or one evaluation."""
_INSTRUCTIONS = 1_000_000
"""Instructions of SQLite's virtual machine, some milliseconds, between checks for signals."""
_APPLICATION = 0x5377_726D  # "Swrm", identifies the file type

_TABLES = """
CREATE TABLE fact (name TEXT PRIMARY KEY, value TEXT NOT NULL) WITHOUT ROWID;
CREATE TABLE generation (
    generation INTEGER PRIMARY KEY, first INTEGER NOT NULL, seeds TEXT NOT NULL, evaluations INTEGER NOT NULL,
    best REAL, mean REAL, best_so_far REAL, lower_quartile REAL, median REAL, upper_quartile REAL,
    failed INTEGER NOT NULL, leader INTEGER NOT NULL, session INTEGER NOT NULL, seconds REAL NOT NULL,
    evaluations_digest TEXT NOT NULL, digest TEXT NOT NULL);
CREATE TABLE block (
    first INTEGER PRIMARY KEY, generation INTEGER NOT NULL, evaluations INTEGER NOT NULL,
    fitness BLOB NOT NULL, episodes BLOB NOT NULL, metrics BLOB NOT NULL, genomes BLOB NOT NULL);
CREATE TABLE sample (generation INTEGER PRIMARY KEY, address TEXT NOT NULL, numbers BLOB NOT NULL);
CREATE TABLE session (
    session INTEGER PRIMARY KEY, started TEXT NOT NULL, place TEXT NOT NULL, host TEXT NOT NULL,
    machine TEXT NOT NULL, versions TEXT NOT NULL, seconds REAL, outcome TEXT,
    code INTEGER);
CREATE TABLE attempt (
    session INTEGER NOT NULL, generation INTEGER NOT NULL, mode TEXT NOT NULL, candidate INTEGER NOT NULL,
    candidates INTEGER NOT NULL, episode INTEGER NOT NULL, episodes INTEGER NOT NULL, server INTEGER NOT NULL,
    attempt INTEGER NOT NULL, steps INTEGER, started REAL NOT NULL, seconds REAL NOT NULL,
    outcome TEXT NOT NULL, error TEXT, stack TEXT);
CREATE TABLE event (
    session INTEGER NOT NULL, generation INTEGER, time TEXT NOT NULL, kind TEXT NOT NULL, text TEXT NOT NULL);
"""


class FormatError(InputError):
    """A store has a format that this version does not read; its content may be intact."""


def create(file: Path, facts: Mapping[str, str], generation: int = 0) -> sqlite3.Connection:
    """Create the draft of a store with these facts, and return a connection to it.

    The draft has another name, see `OpenStore`, so that a file with the store's name is always readable. A
    draft is lost if its process is killed, but nothing waits for the disk.

    generation: approximate bytes per generation.

    Raises InputError when it cannot be created there, RunError when the disk is full or fails.
    """
    new = file.with_name(NEW)
    with translate_errors(file, InputError, disk=RunError):
        # Overwrite the draft of a killed process.
        page = next(page for least, page in _PAGE_SIZES if generation >= least)
        new.write_bytes(_make_empty_store(page) if _CAN_SERIALIZE else b"")
        connection = sqlite3.connect(new, isolation_level=None)
        try:
            if not _CAN_SERIALIZE:
                _make_tables(connection, page)
            connection.execute("PRAGMA journal_mode = MEMORY")
            connection.execute("PRAGMA synchronous = OFF")
            connection.execute("BEGIN")
            connection.executemany("INSERT INTO fact VALUES (?, ?)", facts.items())
            seal_facts(connection)
            connection.execute("COMMIT")
        except BaseException:
            connection.close()
            raise
    return connection


class StoreError(InputError):
    """A store cannot be used. `reason` is without the file's name and without advice."""

    def __init__(self, file: Path, reason: str, advice: str = "") -> None:
        super().__init__(f"{file}: {reason}{advice}")
        self.reason = reason


class DamageError(StoreError):
    """The content of a store is damaged: `reason`, and the generation."""

    def __init__(self, file: Path, reason: str, generation: int | None = None) -> None:
        location = "" if generation is None else f"generation {generation}: "
        super().__init__(file, f"is damaged: {location}{reason}", _suggest_verification(file))
        self.reason = reason
        self.generation = generation


def _suggest_verification(file: Path) -> str:
    return f"; find the undamaged generations with: swarmwright runs verify {file.parent}"


@lru_cache
def _make_empty_store(page: int) -> bytes:
    """Return the bytes of an empty store: writing them is faster than creating its tables in the file.

    page: bytes per page.
    """
    with closing(sqlite3.connect(":memory:", isolation_level=None)) as connection:
        _make_tables(connection, page)
        return connection.serialize()


def _make_tables(connection: sqlite3.Connection, page: int) -> None:
    connection.executescript(
        f"PRAGMA page_size = {page}; BEGIN; PRAGMA application_id = {_APPLICATION};"
        f"PRAGMA user_version = {FORMAT};{_TABLES} COMMIT"
    )


def connect(file: Path) -> sqlite3.Connection:
    """Return a writing connection to a store that this process has created. Raises RunError."""
    with translate_errors(file, RunError):
        connection = sqlite3.connect(file, isolation_level=None)
        connection.execute("PRAGMA journal_mode = WAL")
        _settle(connection)
    return connection


def reopen(file: Path) -> sqlite3.Connection:
    """Return a writing connection to an existing store.

    Raises InputError when it is not a store, damaged or read-only, RunError when the disk is full or fails.
    """
    _check_regular(file)
    with translate_errors(file, InputError, disk=RunError):
        connection = sqlite3.connect(f"{file.absolute().as_uri()}?mode=rw", uri=True, isolation_level=None)
        try:
            _check(connection, file)
            _begin_log(connection)
            _settle(connection)
            for (line,) in connection.execute("PRAGMA quick_check(1)"):
                if line != "ok":
                    raise DamageError(file, str(line))
        except BaseException:
            connection.close()
            raise
    return connection


def _begin_log(connection: sqlite3.Connection) -> None:
    """Begin a write-ahead log when no other process reads; afterwards readers and the writer never wait."""
    connection.execute("PRAGMA busy_timeout = 100")  # short, to handle Ctrl-C in between
    deadline = time.monotonic() + _PATIENCE_S
    while True:
        try:
            connection.execute("PRAGMA journal_mode = WAL")
        except sqlite3.OperationalError as error:
            if get_error_code(error) != sqlite3.SQLITE_BUSY or time.monotonic() > deadline:
                raise
        else:
            return


def seal_facts(connection: sqlite3.Connection) -> None:
    """Write the digest of the facts within the transaction that has changed them."""
    facts = dict(connection.execute("SELECT name, value FROM fact"))
    connection.execute(
        "INSERT OR REPLACE INTO fact VALUES (?, ?)", (digests.FACT, digests.digest_facts(facts))
    )


def read_facts(connection: sqlite3.Connection, file: Path) -> dict[str, str]:
    """Return the facts of a store after comparing them with their digest.

    Raises InputError when they are damaged.
    """
    facts = dict(connection.execute("SELECT name, value FROM fact"))
    sealed = facts.get(digests.FACT)
    if sealed is None:
        raise DamageError(file, "the digest of the table fact is missing")
    if sealed != digests.digest_facts(facts):
        raise DamageError(
            file,
            "the table fact, which holds the experiment, was changed: it does not match its digest",
        )
    missing = {"experiment", "metrics", "name", "created"} - facts.keys()
    if missing:
        raise DamageError(file, f"{min(missing)} is missing")
    return facts


@contextmanager
def reading(file: Path) -> Iterator[sqlite3.Connection]:
    """Yield a connection that reads a store, even while a run writes it or in a read-only folder.

    Raises InputError when it is not a store, damaged, or of another version.
    """
    with translate_errors(file, InputError):
        connection = connect_to_read(file)
        try:
            # All reads see one snapshot, whatever is committed meanwhile.
            connection.execute("BEGIN")
            with reading_on(connection, file):
                yield connection
        finally:
            connection.close()


@contextmanager
def reading_on(connection: sqlite3.Connection, file: Path) -> Iterator[sqlite3.Connection]:
    """Yield an open connection; raise InputError for damage found while it is used."""
    with translate_errors(file, InputError), _detect_damage(file):
        yield connection


@contextmanager
def _detect_damage(file: Path) -> Iterator[None]:
    """Raise DamageError for values of the wrong type, since SQLite accepts any type in any column."""
    try:
        yield
    except (ValueError, TypeError, OverflowError) as error:
        raise DamageError(file, str(error)) from error


def connect_to_read(file: Path) -> sqlite3.Connection:
    """Return a connection that reads a store, see `reading`. Raises InputError and sqlite3.Error."""
    try:
        return _connect_checked(file, "mode=ro")
    except sqlite3.OperationalError:
        # Reading a write-ahead log needs an index file. If there is no log, no index is needed.
        if file.with_name(f"{file.name}-wal").exists():
            raise
        return _connect_checked(file, "mode=ro&immutable=1")


def _connect_checked(file: Path, how: str) -> sqlite3.Connection:
    _check_regular(file)
    # An iterator may be continued or discarded in another thread.
    connection = sqlite3.connect(
        f"{file.absolute().as_uri()}?{how}", uri=True, isolation_level=None, check_same_thread=False
    )
    try:
        with _detect_damage(file):
            _check(connection, file)
    except BaseException:
        connection.close()
        raise
    return connection


def _check_regular(file: Path) -> None:
    """Raise InputError if a store is a pipe, a device or a folder: opening it might never end."""
    if file.exists() and not file.is_file():
        raise StoreError(file, "is not a regular file, so it is not a run store")


def _check(connection: sqlite3.Connection, file: Path) -> None:
    """Prepare a connection for a store from an untrusted source.

    A view or a trigger in it could run arbitrary statements for any time, so the schema is compared before
    any table is read. Raises InputError.
    """
    for pragma in ("trusted_schema = OFF", "cell_size_check = ON"):
        connection.execute(f"PRAGMA {pragma}")
    connection.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, _LARGEST_VALUE)
    connection.set_progress_handler(_handle_signals, _INSTRUCTIONS)
    (application,) = connection.execute("PRAGMA application_id").fetchone()
    (version,) = connection.execute("PRAGMA user_version").fetchone()
    if application != _APPLICATION:
        raise StoreError(file, "is not a Swarmwright run store")
    if version > FORMAT:
        raise FormatError(
            f"{file}: has format {version}, but this version of Swarmwright reads format {FORMAT}; update "
            "Swarmwright"
        )
    if version < FORMAT:
        raise FormatError(
            f"{file}: has format {version}, which this version of Swarmwright does not read; repeat the run "
            f"with: swarmwright optimize {file.with_name('experiment.yaml')} --out NEW"
        )
    _check_schema(connection, file)


def _handle_signals() -> int:
    """Let Python handle signals: an exception in a signal handler, as for Ctrl-C, ends the statement."""
    return 0


def _check_schema(connection: sqlite3.Connection, file: Path) -> None:
    """Raise InputError unless a store has exactly the tables of `_TABLES`: no view, trigger or index."""
    expected = _make_schema()
    try:
        schema = _read_schema(connection)
    except UnicodeDecodeError as error:  # in SQLite's message, which quotes the invalid definition
        raise DamageError(file, "the definitions of its tables are not text") from error
    for key in sorted(expected.keys() | schema.keys()):
        if expected.get(key) != schema.get(key):
            kind, name = key
            problem = (
                f"lacks the {kind} {name}"
                if key not in schema
                else f"has the {kind} {name}, which Swarmwright does not write"
                if key not in expected
                else f"defines the {kind} {name} differently"
            )
            raise StoreError(file, f"was not written by Swarmwright: it {problem}; nothing was read from it")


def _read_schema(connection: sqlite3.Connection) -> dict[tuple[str, str], str]:
    rows = connection.execute("SELECT type, name, tbl_name, sql FROM sqlite_schema")
    return {(str(kind), str(name)): f"{table}: {sql}" for kind, name, table, sql in rows}


@lru_cache
def _make_schema() -> dict[tuple[str, str], str]:
    with closing(sqlite3.connect(":memory:", isolation_level=None)) as connection:
        _make_tables(connection, _PAGE_SIZES[-1][1])
        return _read_schema(connection)


def _settle(connection: sqlite3.Connection) -> None:
    # Safe when the process is killed; a power cut may lose the last commits, but nothing else.
    connection.execute("PRAGMA synchronous = NORMAL")
    connection.execute("PRAGMA busy_timeout = 10000")
    # Each checkpoint waits for the disk; a log of 64 MiB instead of 4 makes them rare for large generations.
    connection.execute("PRAGMA wal_autocheckpoint = 16384")


@contextmanager
def transaction(connection: sqlite3.Connection, file: Path) -> Iterator[None]:
    """Commit all or nothing. Raises RunError when the disk refuses it."""
    with translate_errors(file, RunError):
        try:
            connection.execute("BEGIN IMMEDIATE")  # Ctrl-C may come right after it
            yield
            connection.execute("COMMIT")
        except BaseException:
            if connection.in_transaction:
                connection.execute("ROLLBACK")
            raise


_Kind = type[InputError] | type[RunError]
_DISK = {sqlite3.SQLITE_FULL, sqlite3.SQLITE_IOERR}


@contextmanager
def translate_errors(file: Path, kind: _Kind, *, disk: _Kind | None = None) -> Iterator[None]:
    """Translate SQLite's errors into Swarmwright's, with a remedy.

    disk: raised instead of `kind` if the disk is the cause.
    """
    try:
        yield
    except sqlite3.Error as error:
        code = get_error_code(error)
        if code == sqlite3.SQLITE_INTERRUPT:
            # Only `_handle_signals` interrupts: a signal handler has raised an exception, as for Ctrl-C.
            raise KeyboardInterrupt from error
        if disk is None and kind is InputError and code in _DISK and _is_disk_full(file):
            raise StoreError(
                file,
                "cannot be read while the disk is full, since the index of its log needs a new file; free "
                "some disk space and try again",
            ) from error
        kind = disk if disk is not None and code in _DISK else kind
        if code == sqlite3.SQLITE_CORRUPT and kind is InputError:
            raise DamageError(file, str(error)) from error
        reason = _explain(error, code, file)
        raise (StoreError(file, reason) if kind is InputError else RunError(f"{file}: {reason}")) from error


def get_error_code(error: BaseException | None) -> int:
    """Return SQLite's primary result code; 0 for other errors."""
    return int(getattr(error, "sqlite_errorcode", 0) or 0) & 0xFF


def _explain(error: sqlite3.Error, code: int, file: Path) -> str:
    if code in _DISK and _is_disk_full(file):
        return "the disk is full; all earlier results are kept"
    limit = resource.getrlimit(resource.RLIMIT_FSIZE)[0]
    if code in _DISK and limit != resource.RLIM_INFINITY and _reaches_limit(file, limit):
        return (
            f"exceeds the largest file size of this process ({limit >> 10:,} KiB); raise the limit with "
            "ulimit -f; all earlier results are kept"
        )
    if code == sqlite3.SQLITE_CANTOPEN and has_no_more_files():
        return f"cannot be opened: {os.strerror(errno.EMFILE)}; {advise_open_files()}"
    reasons = {
        sqlite3.SQLITE_FULL: "the disk is full; all earlier results are kept",
        sqlite3.SQLITE_IOERR: f"the disk reports an error ({error}); all earlier results are kept",
        sqlite3.SQLITE_READONLY: "is not writable by this user",
        sqlite3.SQLITE_CANTOPEN: "cannot be opened; check that the folder exists and is writable",
        sqlite3.SQLITE_BUSY: "is locked by an SQLite transaction of another program, or of another part of "
        "this one; close it and try again",
        sqlite3.SQLITE_CORRUPT: f"is damaged: {error}{_suggest_verification(file)}",
        sqlite3.SQLITE_NOTADB: "is damaged or is not a run store: it is not an SQLite file",
    }
    return reasons.get(code, f"cannot be used: {error}")


def _reaches_limit(file: Path, limit: int) -> bool:
    """Return whether a store, its log or its draft has reached the largest allowed file size."""
    files = [file.with_name(f"{name}{end}") for name in (FILE, NEW) for end in ("", "-wal", "-journal")]
    return any(path.exists() and path.stat().st_size > limit - _PAGE_MARGIN for path in files)


def _is_disk_full(file: Path) -> bool:
    try:
        return shutil.disk_usage(file.parent).free < 1 << 16
    except OSError:
        return False
