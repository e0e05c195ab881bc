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

The store cannot be the lock, because closing another handle to it would release SQLite's locks in this
process; nor can experiment.yaml, because editors replace it with a new, unlocked file.
"""
_PATIENCE_S = 0.5
"""Seconds for which a process that only tests the lock may hold it."""
_HELD_LOCKS: set[Path] = set()
"""Locks that this process holds."""
_NO_LOCKS = {errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP}
_NO_RIGHT = {errno.EACCES, errno.EPERM, errno.EROFS}


class MovedError(RunError):
    """A run's folder was moved, replaced or deleted while this process wrote the run."""


class Lock:
    """Locks a run for this process; the system releases it when the process ends in any way.

    Raises InputError when another process holds it, or the file system has no locks.
    """

    def __init__(self, folder: Path) -> None:
        self._name = folder
        self._path = folder.absolute() / LOCK
        deadline = time.monotonic() + _PATIENCE_S
        while True:
            file, locked = _open_lock_file(folder, self._path), False
            try:
                # Open for writing: network file systems (NFS) refuse exclusive locks on files open to read.
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                locked = _is_still(file, self._path)
            except BlockingIOError:
                if time.monotonic() > deadline:
                    file.close()
                    raise _build_busy_error(folder) from None
                time.sleep(_PATIENCE_S / 10)
            except OSError as error:
                file.close()
                raise InputError(_explain_lock_failure(folder, error)) from error
            if locked:
                self._file = file
                _HELD_LOCKS.add(self._path)
                self.folder = self._open_folder()
                """File descriptor of the folder, valid even if it is moved."""
                return
            file.close()

    def _open_folder(self) -> int:
        """Open the folder: while it is open, no other folder can have its inode number."""
        try:
            return os.open(self._path.parent, os.O_PATH | os.O_DIRECTORY)
        except OSError as error:
            self._release()
            many = error.errno in {errno.EMFILE, errno.ENFILE}
            remedy = "; open fewer runs, or allow more open files (ulimit -n)" if many else ""
            raise InputError(f"{self._name}: cannot be opened: {error.strerror}{remedy}") from error

    def close(self) -> None:
        """Release the lock."""
        if self._file.closed:
            return
        self._release()
        os.close(self.folder)

    def _release(self) -> None:
        _HELD_LOCKS.discard(self._path)
        with suppress(OSError):
            # Delete it before releasing it: a process that has just opened it notices and creates a new file.
            if _is_still(self._file, self._path):
                self._path.unlink()
        self._file.close()

    def check(self) -> None:
        """Raise MovedError if the folder has moved, since another run may have its path now."""
        try:
            if os.path.samestat(os.fstat(self.folder), self._path.parent.stat()):
                return
        except (FileNotFoundError, NotADirectoryError):
            pass
        except OSError:
            return  # the next write reports the problem
        raise MovedError(f"{self._name}: {self._describe_move()}")

    def _describe_move(self) -> str:
        ended = "during the run, which has ended; move run folders only when their runs have finished"
        try:
            location = Path(f"/proc/self/fd/{self.folder}").readlink()
        except OSError:
            return f"the folder was moved or replaced {ended}"
        if os.fstat(self.folder).st_nlink == 0 or not location.is_dir():
            return f"the folder was deleted {ended}"
        command = f"swarmwright resume {shlex.quote(str(location))}"
        return (
            f"the folder was moved to {location} {ended}. It has all finished generations; continue with "
            f"`{command}`"
        )


def check_free(folder: Path) -> None:
    """Raise InputError if the run is not writable, or another process works on it."""
    if not os.access(folder, os.W_OK | os.X_OK):
        raise InputError(f"{folder}: is not writable by this user, or is on a read-only file system")
    deadline = time.monotonic() + _PATIENCE_S
    while is_locked(folder):
        if time.monotonic() > deadline:
            raise _build_busy_error(folder)
        time.sleep(_PATIENCE_S / 10)


def _build_busy_error(folder: Path) -> InputError:
    return InputError(f"{folder}: {describe_owner(folder)} is writing this run; wait for it, or stop it")


def describe_owner(folder: Path) -> str:
    """Name the owner of a run's lock: another process, or another part of this process, such as a thread."""
    return "another part of this process" if folder.absolute() / LOCK in _HELD_LOCKS else "another process"


def is_locked(folder: Path) -> bool:
    """Return whether a process works on the run now."""
    try:
        with (folder / LOCK).open("rb") as file:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:
        return False
    return False


def _open_lock_file(folder: Path, path: Path) -> BinaryIO:
    try:
        return path.open("ab")
    except OSError as error:
        if error.errno in _NO_RIGHT:
            raise InputError(f"{folder}: is not writable by this user ({error.strerror})") from error
        raise InputError(f"{folder}: cannot be written: {error.strerror}") from error


def _is_still(file: BinaryIO, path: Path) -> bool:
    """Return whether an open file is still the file at this path."""
    try:
        return os.path.samestat(os.fstat(file.fileno()), path.stat())
    except FileNotFoundError:
        return False


def _explain_lock_failure(folder: Path, error: OSError) -> str:
    if error.errno in _NO_LOCKS:
        return (
            f"{folder}: this file system cannot lock files ({error.strerror}), so two processes could write "
            "the same run; use a folder on another file system, such as a local disk"
        )
    return f"{folder}: cannot be locked: {error.strerror}"
