"""Private temporary files of this user; those of killed processes are deleted by a later one."""

import contextlib
import fcntl
import os
import shutil
import stat
import tempfile
import time
import weakref
from collections.abc import Iterator
from pathlib import Path
from types import TracebackType

from swarmwright.common.errors import InputError

_ENDING = ".tmp"
"""Suffix of folders that are deleted with their process."""
_PATIENCE_S = 1.0
"""Seconds to wait for another process that creates the folder; other users can hold that lock, too."""


def private_folder() -> Path:
    """Return this user's folder in the system's temporary folder; create it if necessary.

    Its name is random, so that no other user can create it first. All processes of the user find the same
    one. Raises InputError if it cannot be created.
    """
    temporary = Path(tempfile.gettempdir())
    prefix = f"swarmwright-{os.getuid()}-"
    try:
        folder = _first_of_this_user(temporary, prefix)
        if folder is None:
            with _hold_lock(temporary, _PATIENCE_S):
                folder = _first_of_this_user(temporary, prefix)
                if folder is None:
                    folder = Path(tempfile.mkdtemp(prefix=prefix, dir=temporary))  # mode 0700
    except OSError as error:
        raise InputError(
            f"{temporary}: cannot create a temporary folder: {error.strerror}; set TMPDIR to another folder"
        ) from error
    return folder


def _first_of_this_user(temporary: Path, prefix: str) -> Path | None:
    """Return the first private folder of this user; ignore links and folders of other users."""
    for path in sorted(temporary.glob(f"{prefix}*")):
        with contextlib.suppress(OSError):
            status = path.lstat()
            is_private = stat.S_ISDIR(status.st_mode) and not status.st_mode & 0o077
            if is_private and status.st_uid == os.getuid():
                return path
    return None


class TemporaryFolder:
    """A private folder that is deleted with its content, like `tempfile.TemporaryDirectory`.

    The folder of a killed process is deleted when a later process creates another one. As a context manager
    it returns its path.

    Args:
        kind: purpose, the beginning of its name.

    Raises InputError if it cannot be created.
    """

    def __init__(self, kind: str) -> None:
        parent = private_folder()
        try:
            with _hold_lock(parent):
                _remove_abandoned(parent)
                self.path = Path(tempfile.mkdtemp(prefix=f"{kind}-", suffix=_ENDING, dir=parent))
                lock = os.open(self.path, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
                fcntl.flock(lock, fcntl.LOCK_EX)
        except OSError as error:
            raise InputError(f"{parent}: cannot be written: {error.strerror}") from error
        self.close = weakref.finalize(self, _close, self.path, lock)
        """Deletes the folder; later calls do nothing."""

    def __enter__(self) -> Path:
        return self.path

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def _close(folder: Path, lock: int) -> None:
    remove(folder)
    os.close(lock)


def _remove_abandoned(parent: Path) -> None:
    """Delete the folders of dead processes, whose locks the system has released."""
    for folder in parent.glob(f"*{_ENDING}"):
        with contextlib.suppress(OSError):
            lock = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW | os.O_CLOEXEC)
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                remove(folder)
            finally:
                os.close(lock)


@contextlib.contextmanager
def _hold_lock(folder: Path, patience: float = float("inf")) -> Iterator[None]:
    """Hold the lock of a folder; after `patience` seconds, continue without it."""
    lock = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    deadline = time.monotonic() + patience
    try:
        while True:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            except BlockingIOError:
                if time.monotonic() > deadline:
                    break
                time.sleep(0.01)
        yield
    finally:
        os.close(lock)


def remove(folder: Path) -> None:
    """Delete a folder with its content, including read-only files; delete a link without its target.

    Files that cannot be deleted remain, without an error.
    """
    with contextlib.suppress(OSError):
        if not stat.S_ISDIR(folder.lstat().st_mode):
            folder.unlink()
            return
    shutil.rmtree(folder, ignore_errors=True)
    if folder.exists():
        _make_writable(folder)
        shutil.rmtree(folder, ignore_errors=True)


def _make_writable(folder: Path) -> None:
    """Make a folder and all folders in it writable, without following links."""
    pending = [str(folder)]
    while pending:
        with contextlib.suppress(OSError):
            # Of the folder itself, even if a link replaces it meanwhile.
            descriptor = os.open(pending.pop(), os.O_PATH | os.O_DIRECTORY | os.O_NOFOLLOW | os.O_CLOEXEC)
            try:
                inside = f"/proc/self/fd/{descriptor}"
                os.chmod(inside, 0o700)  # noqa: PTH101
                with os.scandir(inside) as entries:
                    names = [entry.name for entry in entries if entry.is_dir(follow_symlinks=False)]
                pending += [os.path.join(os.readlink(inside), name) for name in names]  # noqa: PTH115, PTH118
            finally:
                os.close(descriptor)
