"""Opening the store, and the errors when it cannot be used."""

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
"""What it is called while it is made."""
FORMAT = 6
"""Version of the store. No other version is read."""
_PAGES = ((1 << 20, 65536), (3 << 14, 16384), (0, 4096))
"""Least bytes of a generation, and bytes of a page: larger pages take half the time, but make the file larger
where generations do not fill them."""
_PATIENCE = 30.0
"""Seconds for which a process that goes on with a run waits until others do not read it at the moment."""
_PAGE_MARGIN = 1 << 17
"""Bytes below the largest size of a file at which a write may fail: a page and its header."""
_CAN_SERIALIZE = hasattr(sqlite3.Connection, "serialize")  # SQLite can be built without it
_LARGEST_VALUE = 1 << 28
"""Bytes of the longest value that is read. A column of a block has at most 4 MiB, or one evaluation."""
_INSTRUCTIONS = 1_000_000
"""Instructions of SQLite's virtual machine, some milliseconds, between two looks for signals."""
_APPLICATION = 0x5377_726D  # "Swrm", by which `file` and others tell what the file is

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
    """A store is of a version that this one does not read, which says nothing of its content."""


def create(file: Path, facts: Mapping[str, str], generation: int = 0) -> sqlite3.Connection:
    """Return a connection to a draft of a store that holds these facts.

    It is a file of another name, see `OpenStore`, so that a store under its name is always readable; a draft
    whose process is killed is lost. In return, nothing waits for the disk.

    generation: bytes that a generation is going to have, about.

    Raises InputError when it cannot be created there, RunError when the disk is full or fails.
    """
    new = file.with_name(NEW)
    with errors(file, InputError, disk=RunError):
        # In the place of what another process left behind when it was killed.
        page = next(page for least, page in _PAGES if generation >= least)
        new.write_bytes(_without_facts(page) if _CAN_SERIALIZE else b"")
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
    """A store cannot be used. `what` is the reason, without the file's name and without advice."""

    def __init__(self, file: Path, what: str, advice: str = "") -> None:
        super().__init__(f"{file}: {what}{advice}")
        self.what = what


class DamageError(StoreError):
    """The content of a store is not what was written: `what`, and in which generation."""

    def __init__(self, file: Path, what: str, generation: int | None = None) -> None:
        where = "" if generation is None else f"generation {generation}: "
        super().__init__(file, f"is damaged: {where}{what}", _verify(file))
        self.what = what
        self.generation = generation


def _verify(file: Path) -> str:
    return f"; what is still good says: swarmwright runs verify {file.parent}"


@lru_cache
def _without_facts(page: int) -> bytes:
    """Return a store with nothing in it: to make its tables takes longer than to write the file.

    page: bytes of a page.
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
    """Return a connection to write on in a store that this process has created. Raises RunError."""
    with errors(file, RunError):
        connection = sqlite3.connect(file, isolation_level=None)
        connection.execute("PRAGMA journal_mode = WAL")
        _settle(connection)
    return connection


def reopen(file: Path) -> sqlite3.Connection:
    """Return a connection to write on in a store.

    Raises InputError when it is not a store, damaged or read-only, RunError when the disk is full or fails.
    """
    _check_regular(file)
    with errors(file, InputError, disk=RunError):
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
    """Begin a write-ahead log, when no other process reads: with it, readers and a writer do not wait."""
    connection.execute("PRAGMA busy_timeout = 100")  # Ctrl-C is noticed in between
    deadline = time.monotonic() + _PATIENCE
    while True:
        try:
            connection.execute("PRAGMA journal_mode = WAL")
        except sqlite3.OperationalError as error:
            if code_of(error) != sqlite3.SQLITE_BUSY or time.monotonic() > deadline:
                raise
        else:
            return


def seal_facts(connection: sqlite3.Connection) -> None:
    """Write the digest of the facts, within the transaction that has changed them."""
    facts = dict(connection.execute("SELECT name, value FROM fact"))
    connection.execute("INSERT OR REPLACE INTO fact VALUES (?, ?)", (digests.FACT, digests.of_facts(facts)))


def checked_facts(connection: sqlite3.Connection, file: Path) -> dict[str, str]:
    """Return the facts of a store, compared with their digest.

    Raises InputError when they are not what was written.
    """
    facts = dict(connection.execute("SELECT name, value FROM fact"))
    sealed = facts.get(digests.FACT)
    if sealed is None:
        raise DamageError(file, "the digest of the table fact is missing")
    if sealed != digests.of_facts(facts):
        raise DamageError(
            file,
            "the table fact, with the experiment, is not what was written: it disagrees with its digest",
        )
    missing = {"experiment", "metrics", "name", "created"} - facts.keys()
    if missing:
        raise DamageError(file, f"{min(missing)} is missing")
    return facts


@contextmanager
def reading(file: Path) -> Iterator[sqlite3.Connection]:
    """Yield a connection that reads a store, also while a run writes it or in a folder that is read-only.

    Raises InputError when it is not a store, damaged, or of another version.
    """
    with errors(file, InputError):
        connection = connect_to_read(file)
        try:
            # One snapshot for all that is read here, whatever is committed meanwhile.
            connection.execute("BEGIN")
            with reading_on(connection, file):
                yield connection
        finally:
            connection.close()


@contextmanager
def reading_on(connection: sqlite3.Connection, file: Path) -> Iterator[sqlite3.Connection]:
    """Yield a connection that is open already; raise InputError for damage that is found while it is used."""
    with errors(file, InputError), _damage(file):
        yield connection


@contextmanager
def _damage(file: Path) -> Iterator[None]:
    """Raise InputError for values of the wrong kind: SQLite takes text for numbers and any bytes for text."""
    try:
        yield
    except (ValueError, TypeError, OverflowError) as error:
        raise DamageError(file, str(error)) from error


def connect_to_read(file: Path) -> sqlite3.Connection:
    """Return a connection that reads a store, see `reading`. Raises InputError and sqlite3.Error."""
    try:
        return _connect_checked(file, "mode=ro")
    except sqlite3.OperationalError:
        # A write-ahead log needs a file beside it. Where none can be made and no log is left, none is needed.
        if file.with_name(f"{file.name}-wal").exists():
            raise
        return _connect_checked(file, "mode=ro&immutable=1")


def _connect_checked(file: Path, how: str) -> sqlite3.Connection:
    _check_regular(file)
    # An iterator may go on, or be thrown away, in another thread than it was begun in.
    connection = sqlite3.connect(
        f"{file.absolute().as_uri()}?{how}", uri=True, isolation_level=None, check_same_thread=False
    )
    try:
        with _damage(file):
            _check(connection, file)
    except BaseException:
        connection.close()
        raise
    return connection


def _check_regular(file: Path) -> None:
    """Raise InputError for a pipe, a device or a folder in the place of a store: opening it may never end."""
    if file.exists() and not file.is_file():
        raise StoreError(file, "is not a regular file, so it is not a run store")


def _check(connection: sqlite3.Connection, file: Path) -> None:
    """Prepare a connection for a store that may come from anywhere.

    A view or a trigger in a received store would run whatever its author wrote, for as long as it likes, so
    the schema is compared before any table is read. Raises InputError.
    """
    for pragma in ("trusted_schema = OFF", "cell_size_check = ON"):
        connection.execute(f"PRAGMA {pragma}")
    connection.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, _LARGEST_VALUE)
    connection.set_progress_handler(_go_on, _INSTRUCTIONS)
    (application,) = connection.execute("PRAGMA application_id").fetchone()
    (version,) = connection.execute("PRAGMA user_version").fetchone()
    if application != _APPLICATION:
        raise StoreError(file, "is not a Swarmwright run store")
    if version > FORMAT:
        raise FormatError(f"{file}: has format {version}; this Swarmwright reads format {FORMAT}: update it")
    if version < FORMAT:
        raise FormatError(
            f"{file}: has format {version}, which this version of Swarmwright does not read; to compute the "
            f"run again: swarmwright optimize {file.with_name('experiment.yaml')} --out NEW"
        )
    _check_schema(connection, file)


def _go_on() -> int:
    """Let Python handle signals: an exception of a signal handler, as of Ctrl-C, ends the statement."""
    return 0


def _check_schema(connection: sqlite3.Connection, file: Path) -> None:
    """Raise InputError unless a store has exactly the tables of `_TABLES`: no view, trigger or index."""
    expected = _schema()
    try:
        found = _read_schema(connection)
    except UnicodeDecodeError as error:  # of SQLite's message, which quotes what it cannot parse
        raise DamageError(file, "the definitions of its tables are not text") from error
    for key in sorted(expected.keys() | found.keys()):
        if expected.get(key) != found.get(key):
            kind, name = key
            problem = (
                f"lacks the {kind} {name}"
                if key not in found
                else f"has the {kind} {name}, which Swarmwright does not write"
                if key not in expected
                else f"defines the {kind} {name} differently"
            )
            raise StoreError(
                file, f"is not a store that Swarmwright wrote: it {problem}; nothing was read from it"
            )


def _read_schema(connection: sqlite3.Connection) -> dict[tuple[str, str], str]:
    rows = connection.execute("SELECT type, name, tbl_name, sql FROM sqlite_schema")
    return {(str(kind), str(name)): f"{table}: {sql}" for kind, name, table, sql in rows}


@lru_cache
def _schema() -> dict[tuple[str, str], str]:
    with closing(sqlite3.connect(":memory:", isolation_level=None)) as connection:
        _make_tables(connection, _PAGES[-1][1])
        return _read_schema(connection)


def _settle(connection: sqlite3.Connection) -> None:
    # Survives the end of the process at any moment; a power cut may take the last commits, never the rest.
    connection.execute("PRAGMA synchronous = NORMAL")
    connection.execute("PRAGMA busy_timeout = 10000")
    # Each checkpoint waits for the disk; of 64 MiB of log instead of 4, large generations have few.
    connection.execute("PRAGMA wal_autocheckpoint = 16384")


@contextmanager
def transaction(connection: sqlite3.Connection, file: Path) -> Iterator[None]:
    """Commit all or nothing. Raises RunError when the disk does not take it."""
    with errors(file, RunError):
        try:
            connection.execute("BEGIN IMMEDIATE")  # Ctrl-C may come right behind it
            yield
            connection.execute("COMMIT")
        except BaseException:
            if connection.in_transaction:
                connection.execute("ROLLBACK")
            raise


_Kind = type[InputError] | type[RunError]
_DISK = {sqlite3.SQLITE_FULL, sqlite3.SQLITE_IOERR}


@contextmanager
def errors(file: Path, kind: _Kind, *, disk: _Kind | None = None) -> Iterator[None]:
    """Turn SQLite's errors into Swarmwright's, which say what to do.

    disk: instead of `kind` where the disk is to blame.
    """
    try:
        yield
    except sqlite3.Error as error:
        code = code_of(error)
        if code == sqlite3.SQLITE_INTERRUPT:
            # Nothing but `_go_on` interrupts, where a signal handler has raised an exception: that of Ctrl-C.
            raise KeyboardInterrupt from error
        if disk is None and kind is InputError and code in _DISK and _full(file):
            raise StoreError(
                file,
                "cannot be read while the disk is full, since the index of its log needs a file beside it; "
                "free some space and run again",
            ) from error
        ours = disk if disk is not None and code in _DISK else kind
        if code == sqlite3.SQLITE_CORRUPT and ours is InputError:
            raise DamageError(file, str(error)) from error
        reason = _reason(error, code, file)
        raise (StoreError(file, reason) if ours is InputError else RunError(f"{file}: {reason}")) from error


def code_of(error: BaseException | None) -> int:
    """Return SQLite's primary result code; 0 for other errors."""
    return int(getattr(error, "sqlite_errorcode", 0) or 0) & 0xFF


def _reason(error: sqlite3.Error, code: int, file: Path) -> str:
    if code in _DISK and _full(file):
        return "the disk is full; what was written before is kept"
    largest = _largest_file()
    if code in _DISK and largest is not None and _reaches(file, largest):
        return (
            f"this process may write files of at most {largest >> 10:,} KiB (ulimit -f), which is too little "
            "for it: let it write larger ones; what was written before is kept"
        )
    if code == sqlite3.SQLITE_CANTOPEN and has_no_more_files():
        return f"cannot be opened: {os.strerror(errno.EMFILE)}; {advise_open_files()}"
    reasons = {
        sqlite3.SQLITE_FULL: "the disk is full; what was written before is kept",
        sqlite3.SQLITE_IOERR: f"the disk reports an error ({error}); what was written before is kept",
        sqlite3.SQLITE_READONLY: "may not be written by this user",
        sqlite3.SQLITE_CANTOPEN: "cannot be opened; is the folder there, and may this user write in it?",
        sqlite3.SQLITE_BUSY: "is being used by another program, or by another part of this one, that has it "
        "open in a transaction of SQLite; close that and try again",
        sqlite3.SQLITE_CORRUPT: f"is damaged: {error}{_verify(file)}",
        sqlite3.SQLITE_NOTADB: "is damaged or is not a run store: it is not an SQLite file",
    }
    return reasons.get(code, f"cannot be used: {error}")


def _largest_file() -> int | None:
    """Return how many bytes a file may have that this process writes; None where nothing limits it."""
    limit = resource.getrlimit(resource.RLIMIT_FSIZE)[0]
    return None if limit == resource.RLIM_INFINITY else limit


def _reaches(file: Path, largest: int) -> bool:
    """Return whether a store, its log or its draft has reached the largest size that it may have."""
    places = [file.with_name(f"{name}{end}") for name in (FILE, NEW) for end in ("", "-wal", "-journal")]
    return any(place.exists() and place.stat().st_size > largest - _PAGE_MARGIN for place in places)


def _full(file: Path) -> bool:
    try:
        return shutil.disk_usage(file.parent).free < 1 << 16
    except OSError:
        return False
