"""Work folders, and what instances that run side by side on a machine must not share."""

import contextlib
import fcntl
import itertools
import os
import socket
from pathlib import Path

from swarmwright.common.errors import InputError
from swarmwright.common.message_kinds import kind_of
from swarmwright.common.temporary import private_place, remove

_PORTS, _EACH = 21_000, 20
"""First port, and how many belong to an instance."""
_MOST_INSTANCES = 2000
"""Instances."""
_MOST_KINDS = 5
"""Kinds of failures of a process of which a work folder is kept."""
_MOST_FAILED = 10
"""Work folders of failed episodes that are kept for an instance's number, the latest ones."""


class Instance:
    """One of those that run side by side on this machine; its number is its own until the process ends.

    Args:
        place: the folder of work folders.

    Raises InputError when that cannot be written.
    """

    def __init__(self, place: Path) -> None:
        self.place = place
        try:
            # Numbers, and so ports and displays, are the user's, wherever the work folders are.
            self.number = self._lock(private_place())
            place.mkdir(mode=0o700, parents=True, exist_ok=True)
            self.folder = place / f"instance-{self.number}"
            self._make_folder()
        except OSError as error:
            raise InputError(
                f"simulation.work: {place} cannot be written: {error.strerror}; name another folder"
            ) from error
        self._next = 0
        self._kinds: set[str] = set()

    def _lock(self, locks: Path) -> int:
        for number in range(_MOST_INSTANCES):
            descriptor = os.open(locks / f"{number}.lock", os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
            try:
                fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError:
                os.close(descriptor)
                continue
            self._descriptor = descriptor
            return number
        raise InputError(f"more than {_MOST_INSTANCES} instances of commands run on this machine")

    def _make_folder(self) -> None:
        if self.folder.is_symlink():  # a program has replaced it
            remove(self.folder)
        self.folder.mkdir(exist_ok=True)

    def port(self) -> int:
        """Return a TCP port that no process listens on, and that no other instance gets."""
        first = _PORTS + self.number * _EACH
        for _ in range(_EACH):
            port = first + self._next % _EACH
            self._next += 1
            with socket.socket() as probe, contextlib.suppress(OSError):
                probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
                probe.bind(("127.0.0.1", port))
                return port
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            return int(probe.getsockname()[1])

    def clear(self) -> None:
        """Delete the work folders that a process has left that was killed."""
        for folder in [*self.folder.glob("episode*"), self.folder / "stepwise"]:
            remove(folder)

    def new_folder(self, name: str) -> Path:
        """Return a new, empty work folder."""
        self._make_folder()
        folder = self.folder / name
        remove(folder)
        folder.mkdir()
        return folder

    def is_first_of_kind(self, reason: str) -> bool:
        """Note a failure; return whether it is the first of its kind, and among the first kinds."""
        kind = kind_of(reason)
        if kind in self._kinds or len(self._kinds) >= _MOST_KINDS:
            return False
        self._kinds.add(kind)
        return True

    def keep_failed(self, folder: Path) -> Path:
        """Put the folder of a failed episode aside; return where it is, and stays.

        To be called for the first failure of each kind. The ten latest folders of this number stay, whichever
        processes had it, so that no other run takes them away at once.
        """
        # Another instance of this process, or a former process with its id, may have had this number.
        names = (self.folder / f"failed-{os.getpid()}-{count}" for count in itertools.count(1))
        kept = next(name for name in names if not name.exists())
        folder.rename(kept)
        os.utime(kept)
        failed = sorted(self.folder.glob("failed*"), key=lambda one: one.lstat().st_mtime_ns)
        for older in failed[:-_MOST_FAILED]:
            remove(older)
        return kept

    def close(self) -> None:
        """Give the number back, and remove the folder when nothing was kept."""
        with contextlib.suppress(OSError):
            self.folder.rmdir()
        with contextlib.suppress(OSError):
            os.close(self._descriptor)


def size_of(folder: Path) -> int:
    """Return the bytes that the files in a folder take on the disk."""
    total, open_ = 0, [str(folder)]
    while open_:
        with contextlib.suppress(OSError), os.scandir(open_.pop()) as entries:
            for entry in entries:
                with contextlib.suppress(OSError):
                    if entry.is_dir(follow_symlinks=False):
                        open_.append(entry.path)
                    else:
                        total += entry.stat(follow_symlinks=False).st_blocks * 512
    return total
