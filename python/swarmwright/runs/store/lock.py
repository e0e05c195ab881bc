"""The lock of a run: one process at a time may write it."""

import errno
import fcntl
import os
import shlex
import time
from contextlib import suppress
from pathlib import Path
from typing import BinaryIO

from swarmwright.common.errors import InputError, RunError

LOCK = "run.lock"
"""A file that users have no reason to edit or replace; it exists while a process works on the run.

Not the store: closing any other handle on that would free SQLite's own locks in this process. Not
experiment.yaml: editors put a new file in its place, whose lock is free.
"""
_PATIENCE = 0.5
"""Seconds for which a process that only tests the lock may hold it."""
_HELD_LOCKS: set[Path] = set()
"""Locks that this process has."""
_NO_LOCKS = {errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP}
_NO_RIGHT = {errno.EACCES, errno.EPERM, errno.EROFS}


class MovedError(RunError):
    """A run's folder was moved, replaced or deleted while this process wrote the run."""


class Lock:
    """Reserves a run for this process; the system frees it when the process ends in any way.

    Raises InputError when another process has it, or files cannot be locked there.
    """

    def __init__(self, folder: Path) -> None:
        self._given = folder
        self._path = folder.absolute() / LOCK
        deadline = time.monotonic() + _PATIENCE
        while True:
            file, locked = _opened(folder, self._path), False
            try:
                # For writing: network file systems (NFS) refuse an exclusive lock on what is open to read.
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                locked = _is_still(file, self._path)
            except BlockingIOError:
                if time.monotonic() > deadline:
                    file.close()
                    raise _taken(folder) from None
                time.sleep(_PATIENCE / 10)
            except OSError as error:
                file.close()
                raise InputError(_unlockable(folder, error)) from error
            if locked:
                self._file = file
                _HELD_LOCKS.add(self._path)
                self.folder = self._held()
                """File descriptor of the folder, wherever it is moved."""
                return
            file.close()

    def _held(self) -> int:
        """Return the folder, open: as long as it is, no other one has the same number."""
        try:
            return os.open(self._path.parent, os.O_PATH | os.O_DIRECTORY)
        except OSError as error:
            self._release()
            many = error.errno in {errno.EMFILE, errno.ENFILE}
            remedy = "; have fewer runs open, or allow more open files (ulimit -n)" if many else ""
            raise InputError(f"{self._given}: cannot be opened: {error.strerror}{remedy}") from error

    def close(self) -> None:
        """Release the run."""
        if self._file.closed:
            return
        self._release()
        os.close(self.folder)

    def _release(self) -> None:
        _HELD_LOCKS.discard(self._path)
        with suppress(OSError):
            # Delete before releasing: a process that has opened it meanwhile notices, and creates a new file.
            if _is_still(self._file, self._path):
                self._path.unlink()
        self._file.close()

    def check(self) -> None:
        """Raise MovedError unless the folder is still where it was: another run may have that name now."""
        try:
            if os.path.samestat(os.fstat(self.folder), self._path.parent.stat()):
                return
        except (FileNotFoundError, NotADirectoryError):
            pass
        except OSError:
            return  # writing tells what is wrong
        raise MovedError(f"{self._given}: {self._whereabouts()}")

    def _whereabouts(self) -> str:
        ended = "while this run was writing it, so the run ended; folders of runs can be moved when those end"
        try:
            now = Path(f"/proc/self/fd/{self.folder}").readlink()
        except OSError:
            return f"this folder was moved or replaced {ended}"
        if os.fstat(self.folder).st_nlink == 0 or not now.is_dir():
            return f"this folder was deleted {ended}"
        command = f"swarmwright resume {shlex.quote(str(now))}"
        return f"this folder was moved to {now} {ended}. What was finished is kept there: `{command}` goes on"


def check_free(folder: Path) -> None:
    """Raise InputError where the run may not be written, or a process works on it that goes on."""
    if not os.access(folder, os.W_OK | os.X_OK):
        raise InputError(f"{folder}: may not be written by this user, or is on a read-only file system")
    deadline = time.monotonic() + _PATIENCE
    while is_locked(folder):
        if time.monotonic() > deadline:
            raise _taken(folder)
        time.sleep(_PATIENCE / 10)


def _taken(folder: Path) -> InputError:
    return InputError(f"{folder}: {who_else(folder)} works on this run; wait for it, or stop it")


def who_else(folder: Path) -> str:
    """Return what has locked a run: another process, or this one, such as another thread of it."""
    return "another part of this process" if folder.absolute() / LOCK in _HELD_LOCKS else "another process"


def is_locked(folder: Path) -> bool:
    """Whether a process works on the run now."""
    try:
        with (folder / LOCK).open("rb") as file:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:
        return False
    return False


def _opened(folder: Path, path: Path) -> BinaryIO:
    try:
        return path.open("ab")
    except OSError as error:
        if error.errno in _NO_RIGHT:
            raise InputError(f"{folder}: may not be written by this user ({error.strerror})") from error
        raise InputError(f"{folder}: cannot be written: {error.strerror}") from error


def _is_still(file: BinaryIO, path: Path) -> bool:
    """Whether an open file is still the one at this path."""
    try:
        return os.path.samestat(os.fstat(file.fileno()), path.stat())
    except FileNotFoundError:
        return False


def _unlockable(folder: Path, error: OSError) -> str:
    if error.errno in _NO_LOCKS:
        return (
            f"{folder}: this file system cannot lock files ({error.strerror}), so that two processes could "
            "write one run; use a folder on another one, such as a local disk"
        )
    return f"{folder}: cannot be locked: {error.strerror}"
