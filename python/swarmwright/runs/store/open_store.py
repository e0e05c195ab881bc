"""A store that is being written: at first a draft under another name, which the end of the process takes."""

import _thread
import atexit
import ctypes
import os
import signal
import sqlite3
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from types import FrameType
from typing import Self

from swarmwright.common.errors import RunError
from swarmwright.runs.store.database import FILE, NEW, connect, create, errors, reopen

_LONGEST_WAIT_S = 60.0
"""Seconds for which the end of the process waits for the disk."""


class OpenStore:
    """The connection to a store that is being written.

    An interrupt (Ctrl-C) may come at any place, and then everything here can be called again.
    """

    def __init__(self, file: Path, connection: sqlite3.Connection, *, draft: bool) -> None:
        self.file = file
        self.draft = draft
        """Whether it is a draft."""
        self._connection = connection

    @classmethod
    def create(cls, file: Path, facts: Mapping[str, str], generation: int) -> Self:
        """Begin a new store with a draft; arguments and errors as of `database.create`."""
        return cls(file, create(file, facts, generation), draft=True)

    @classmethod
    def reopen(cls, file: Path) -> Self:
        """Go on with a store; errors as of `database.reopen`."""
        return cls(file, reopen(file), draft=False)

    @property
    def is_open(self) -> bool:
        """Whether the connection is there, which an interrupt may have closed."""
        return _is_open(self._connection)

    @property
    def connection(self) -> sqlite3.Connection:
        """The connection to write on. Raises RunError when it cannot be opened again after an interrupt."""
        if not self.is_open:
            self._go_on()
        return self._connection

    @property
    def name(self) -> str:
        """Of the file that it is in now."""
        _ = self.connection
        return NEW if self.draft else FILE

    def keep(self) -> None:
        """Make a store of a draft: from now on, what is committed survives the end of the process.

        Raises RunError when the disk refuses it.
        """
        if self.draft:
            self._go_on()

    def _go_on(self) -> None:
        self._publish()
        _flush(self.file)
        connection = connect(self.file)
        self.draft = False
        self._connection = connection

    def _publish(self) -> None:
        """Close the draft and give it the store's name."""
        with errors(self.file, RunError):
            self._connection.close()
            new = self.file.with_name(NEW)
            try:
                if new.exists() or not self.file.exists():  # it may have been interrupted before
                    new.rename(self.file)
            except OSError as error:
                raise RunError(f"{self.file}: cannot be written: {error.strerror}") from error

    def finish(self) -> None:
        """Make one file of the store, so that the folder can be copied and read anywhere. Raises RunError."""
        if self.draft:
            self._publish()
            # A power cut must not take the run either, but that need not be waited for.
            _flush_later(self.file)
            return
        with errors(self.file, RunError):
            self.connection.execute("PRAGMA busy_timeout = 100")
            self.connection.execute("PRAGMA journal_mode = DELETE")

    def close(self) -> None:
        """Close the connection."""
        self._connection.close()

    def abandon(self, folder: int) -> None:
        """Leave a store that is not where it was; instead of `finish` and `close`.

        folder: file descriptor of its folder.
        """
        if self.draft:
            self._connection.close()
            with suppress(OSError):
                os.rename(NEW, FILE, src_dir_fd=folder, dst_dir_fd=folder)
            return
        # Closing it, also at the end of the process, would delete the log at the path that it had, which may
        # be that of another run. Without that, the log stays beside the store and is read with it.
        ctypes.pythonapi.Py_IncRef(ctypes.py_object(self._connection))


def _is_open(connection: sqlite3.Connection) -> bool:
    try:
        _ = connection.total_changes
    except sqlite3.ProgrammingError:
        return False
    return True


def _flush(file: Path) -> None:
    """Wait until a file is on the disk, as far as the system offers that."""
    with suppress(OSError), file.open("rb") as opened:
        os.fsync(opened.fileno())


_unfinished: "set[_thread.LockType]" = set()
"""Locks of the threads that flush files."""


def _flush_later(file: Path) -> None:
    """Flush a file in a thread, for which this process waits when it ends."""
    # That of `threading` is waited for until it has begun: while others have work, that takes long.
    done = _thread.allocate_lock()
    done.acquire()
    _unfinished.add(done)
    try:
        _thread.start_new_thread(_flush_now, (file, done))
    except RuntimeError:  # no memory or threads are left
        _flush_now(file, done)


def _flush_now(file: Path, done: "_thread.LockType") -> None:
    try:
        _flush(file)
    finally:
        _unfinished.discard(done)
        done.release()


@atexit.register
def _wait() -> None:
    deadline = time.monotonic() + _LONGEST_WAIT_S
    with suppress(_NoLongerError), _signals_end_the_wait():
        for done in list(_unfinished):
            done.acquire(timeout=max(0.0, deadline - time.monotonic()))


class _NoLongerError(BaseException):
    """A signal has arrived while the end of the process waits."""


def _stop_waiting(_number: int, _frame: FrameType | None) -> None:
    raise _NoLongerError


@contextmanager
def _signals_end_the_wait() -> Iterator[None]:
    """Within this block, SIGINT and SIGTERM that the program ignores while it ends raise `_NoLongerError`.

    The files are written already; only a power cut could still take them.
    """
    ignored = [
        number
        for number in (signal.SIGINT, signal.SIGTERM)
        if _unfinished and signal.getsignal(number) is signal.SIG_IGN
    ]
    try:
        for number in ignored:
            signal.signal(number, _stop_waiting)
        yield
    finally:
        for number in ignored:
            signal.signal(number, signal.SIG_IGN)
