"""A store that is being written, at first as a draft with another name, which is lost if the process ends."""

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
from swarmwright.runs.store.database import FILE, NEW, connect, create, reopen, translate_errors

_LONGEST_WAIT_S = 60.0
"""Largest time for which the exit of the process waits for the disk."""


class OpenStore:
    """The connection to a store that is being written.

    After an interrupt (Ctrl-C) anywhere, every method can be called again.
    """

    def __init__(self, file: Path, connection: sqlite3.Connection, *, draft: bool) -> None:
        self.file = file
        self.draft = draft
        """Whether the store is a draft."""
        self._connection = connection

    @classmethod
    def create(cls, file: Path, facts: Mapping[str, str], generation: int) -> Self:
        """Create a draft of a new store; arguments and errors as for `database.create`."""
        return cls(file, create(file, facts, generation), draft=True)

    @classmethod
    def reopen(cls, file: Path) -> Self:
        """Open an existing store; errors as for `database.reopen`."""
        return cls(file, reopen(file), draft=False)

    @property
    def is_open(self) -> bool:
        """Whether the connection is open; an interrupt may have closed it."""
        return _is_open(self._connection)

    @property
    def connection(self) -> sqlite3.Connection:
        """The writing connection. Raises RunError when it cannot be reopened after an interrupt."""
        if not self.is_open:
            self._end_draft()
        return self._connection

    @property
    def name(self) -> str:
        """Current name of the file."""
        _ = self.connection
        return NEW if self.draft else FILE

    def keep(self) -> None:
        """Turn a draft into a store, so that everything committed survives a killed process.

        Raises RunError when the disk refuses it.
        """
        if self.draft:
            self._end_draft()

    def _end_draft(self) -> None:
        self._publish()
        _flush(self.file)
        connection = connect(self.file)
        self.draft = False
        self._connection = connection

    def _publish(self) -> None:
        """Close the draft and give it the store's name."""
        with translate_errors(self.file, RunError):
            self._connection.close()
            new = self.file.with_name(NEW)
            try:
                if new.exists() or not self.file.exists():  # false after an interrupt of an earlier call
                    new.rename(self.file)
            except OSError as error:
                raise RunError(f"{self.file}: cannot be written: {error.strerror}") from error

    def finish(self) -> None:
        """Merge the store into one file that can be copied and read anywhere. Raises RunError."""
        if self.draft:
            self._publish()
            # The run must also survive a power cut, but the caller need not wait for that.
            _flush_later(self.file)
            return
        with translate_errors(self.file, RunError):
            self.connection.execute("PRAGMA busy_timeout = 100")
            self.connection.execute("PRAGMA journal_mode = DELETE")

    def close(self) -> None:
        """Close the connection."""
        self._connection.close()

    def abandon(self, folder: int) -> None:
        """Leave a store whose folder has moved; call it instead of `finish` and `close`.

        folder: file descriptor of its folder.
        """
        if self.draft:
            self._connection.close()
            with suppress(OSError):
                os.rename(NEW, FILE, src_dir_fd=folder, dst_dir_fd=folder)
            return
        # Closing it, even at exit, would delete the log at its former path, which may now belong to another
        # run. The leaked connection leaves the log beside the store, where readers use it.
        ctypes.pythonapi.Py_IncRef(ctypes.py_object(self._connection))


def _is_open(connection: sqlite3.Connection) -> bool:
    try:
        _ = connection.total_changes
    except sqlite3.ProgrammingError:
        return False
    return True


def _flush(file: Path) -> None:
    """Wait until a file is on the disk, if the system supports it."""
    with suppress(OSError), file.open("rb") as stream:
        os.fsync(stream.fileno())


_unfinished: "set[_thread.LockType]" = set()
"""Locks of the threads that flush files."""


def _flush_later(file: Path) -> None:
    """Flush a file in a thread that this process waits for at exit."""
    # `threading.Thread.start` waits until the thread runs, which takes long while other threads are busy.
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
    with suppress(_WaitEndedError), _let_signals_end_wait():
        for done in list(_unfinished):
            done.acquire(timeout=max(0.0, deadline - time.monotonic()))


class _WaitEndedError(BaseException):
    """A signal has arrived while the process waits at exit."""


def _stop_waiting(_number: int, _frame: FrameType | None) -> None:
    raise _WaitEndedError


@contextmanager
def _let_signals_end_wait() -> Iterator[None]:
    """Raise `_WaitEndedError` within this block for SIGINT and SIGTERM that the exiting program ignores.

    The files are already written, so only a power cut could still lose them.
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
