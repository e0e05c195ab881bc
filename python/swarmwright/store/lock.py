"""The lock of a run: one process at a time may write it."""

import errno
import fcntl
import os
import time
from contextlib import suppress
from pathlib import Path
from typing import BinaryIO

from swarmwright.core.errors import InputError

LOCK = "run.lock"
"""A file that users have no reason to edit or replace; it exists while a process works on the run.

Not the store: closing any other handle on that would free SQLite's own locks in this process. Not
experiment.yaml: editors put a new file in its place, whose lock is free.
"""
_PATIENCE = 0.5
"""Seconds for which a process that only tests the lock may hold it."""
_NO_LOCKS = {errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP}
_NO_RIGHT = {errno.EACCES, errno.EPERM, errno.EROFS}


class Lock:
    """Reserves a run for this process; the system frees it when the process ends in any way.

    Raises InputError when another process has it, or files cannot be locked there.
    """

    def __init__(self, folder: Path) -> None:
        self._path = folder / LOCK
        deadline = time.monotonic() + _PATIENCE
        while True:
            file = _opened(folder, self._path)
            try:
                # For writing: network file systems (NFS) refuse an exclusive lock on what is open to read.
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                if _is_still(file, self._path):
                    self._file = file
                    return
            except BlockingIOError:
                if time.monotonic() > deadline:
                    file.close()
                    raise _taken(folder) from None
                time.sleep(_PATIENCE / 10)
            except OSError as error:
                file.close()
                raise InputError(_unlockable(folder, error)) from error
            file.close()

    def close(self) -> None:
        """Release the run."""
        if self._file.closed:
            return
        with suppress(OSError):
            # Delete before releasing: a process that has opened it meanwhile notices, and creates a new file.
            if _is_still(self._file, self._path):
                self._path.unlink()
        self._file.close()


def check_free(folder: Path) -> None:
    """Raise InputError where a process works on the run, and does not end at once."""
    deadline = time.monotonic() + _PATIENCE
    while is_locked(folder):
        if time.monotonic() > deadline:
            raise _taken(folder)
        time.sleep(_PATIENCE / 10)


def _taken(folder: Path) -> InputError:
    return InputError(f"{folder}: another process works on this run; wait for it, or stop it")


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
