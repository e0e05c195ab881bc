"""Temporary files of this user: private, and deleted by a later process where theirs was killed."""

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
"""Of the names of folders that go with their process."""
_PATIENCE_S = 1.0
"""Seconds to wait for another process that makes the place; other users can hold that lock, too."""


def private_folder() -> Path:
    """Return this user's own folder in the system's folder for temporary files; make it where there is none.

    Its name is random, so that no other user can take it first. All processes of the user find the same one.
    Raises InputError when it cannot be made.
    """
    temporary = Path(tempfile.gettempdir())
    prefix = f"swarmwright-{os.getuid()}-"
    try:
        place = _first_of_this_user(temporary, prefix)
        if place is None:
            with _hold_lock(temporary, _PATIENCE_S):
                place = _first_of_this_user(temporary, prefix)
                if place is None:
                    place = Path(tempfile.mkdtemp(prefix=prefix, dir=temporary))  # mode 0700
    except OSError as error:
        raise InputError(
            f"{temporary}: no temporary folder can be made: {error.strerror}; set TMPDIR to another folder"
        ) from error
    return place


def _first_of_this_user(temporary: Path, prefix: str) -> Path | None:
    """Return the first folder that is this user's alone; links and folders of other users are passed over."""
    for path in sorted(temporary.glob(f"{prefix}*")):
        with contextlib.suppress(OSError):
            status = path.lstat()
            is_private = stat.S_ISDIR(status.st_mode) and not status.st_mode & 0o077
            if is_private and status.st_uid == os.getuid():
                return path
    return None


class TemporaryFolder:
    """A private folder that is deleted with everything in it, at the latest when a process makes another one.

    As `tempfile.TemporaryDirectory`, except that what a killed process left behind goes, too. As a context
    manager it gives its path.

    Args:
        kind: what it is for, the beginning of its name.

    Raises InputError when it cannot be made.
    """

    def __init__(self, kind: str) -> None:
        place = private_folder()
        try:
            with _hold_lock(place):
                _remove_abandoned(place)
                self.path = Path(tempfile.mkdtemp(prefix=f"{kind}-", suffix=_ENDING, dir=place))
                lock = os.open(self.path, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
                fcntl.flock(lock, fcntl.LOCK_EX)
        except OSError as error:
            raise InputError(f"{place}: cannot be written: {error.strerror}") from error
        self.close = weakref.finalize(self, _close, self.path, lock)
        """Deletes it; later calls do nothing."""

    def __enter__(self) -> Path:
        return self.path

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def _close(folder: Path, lock: int) -> None:
    remove(folder)
    os.close(lock)


def _remove_abandoned(place: Path) -> None:
    """Delete the folders whose process does not live any more: the system has freed their locks."""
    for folder in place.glob(f"*{_ENDING}"):
        with contextlib.suppress(OSError):
            lock = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW | os.O_CLOEXEC)
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                remove(folder)
            finally:
                os.close(lock)


@contextlib.contextmanager
def _hold_lock(folder: Path, patience: float = float("inf")) -> Iterator[None]:
    """Hold the lock of a folder; after `patience` seconds, go on without it."""
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
    """Delete a folder with everything in it, also what cannot be written; of a link, the link alone.

    What cannot be deleted stays, without an error.
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
    """Let the user write in a folder and all those in it, wherever links in it point to."""
    left = [str(folder)]
    while left:
        with contextlib.suppress(OSError):
            # Of the folder itself, also where a link takes its place meanwhile.
            descriptor = os.open(left.pop(), os.O_PATH | os.O_DIRECTORY | os.O_NOFOLLOW | os.O_CLOEXEC)
            try:
                inside = f"/proc/self/fd/{descriptor}"
                os.chmod(inside, 0o700)  # noqa: PTH101
                with os.scandir(inside) as entries:
                    names = [entry.name for entry in entries if entry.is_dir(follow_symlinks=False)]
                left += [os.path.join(os.readlink(inside), name) for name in names]  # noqa: PTH115, PTH118
            finally:
                os.close(descriptor)
