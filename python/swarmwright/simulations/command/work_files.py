"""Files and folders that are put into the work folder of each episode: `files` of a command's definition.

Work folders, and what instances that run side by side on a machine must not share.
"""

import contextlib
import fcntl
import itertools
import os
import socket
import stat
from collections.abc import Iterator, Mapping
from pathlib import Path

from swarmwright.common.errors import InputError
from swarmwright.common.message_kinds import kind_of
from swarmwright.common.temporary import private_folder, remove

LARGEST_BYTES = 1 << 26
"""Bytes of one file of a simulation; larger ones are not copied into run folders."""
_MOST_FILES = 10_000
"""Of all folders together: they are copied for every episode."""


def within(folder: Path) -> Iterator[Path]:
    """Yield the files of a folder, sorted, without hidden ones and __pycache__."""
    for path in sorted(folder.rglob("*")):
        parts = path.relative_to(folder).parts
        if path.is_file() and not any(part.startswith(".") or part == "__pycache__" for part in parts):
            yield path


def named(files: Mapping[str, str], folder: Path) -> dict[str, Path]:
    """Return the files by their names in the work folder, those of folders one by one.

    Args:
        files: name in the work folder -> path of a file or folder.
        folder: that the paths are relative to.

    """
    found: dict[str, Path] = {}
    for name, given in files.items():
        path = folder / given
        if path.is_dir():
            found |= {f"{name}/{file.relative_to(path).as_posix()}": file for file in within(path)}
        else:
            found[name] = path
    return found


def problem_of(files: Mapping[str, str], folder: Path) -> str | None:
    """Return why files cannot be put into a work folder; None if all can."""
    for given in files.values():
        path = folder / given
        if not path.exists():
            return f"{path}: there is no such file or folder"
        if path.is_dir() and next(within(path), None) is None:
            return f"{path}: is a folder without files (hidden ones and __pycache__ do not count)"
    found = named(files, folder)
    if len(found) > _MOST_FILES:
        return (
            f"{len(found)} files are more than {_MOST_FILES}, all of which every episode copies; name the "
            "folder in the command instead, {here}/FOLDER"
        )
    for path in found.values():
        try:
            status = path.stat()
            readable = os.access(path, os.R_OK)
        except OSError as error:
            return f"{path}: cannot be read: {error.strerror}"
        if not stat.S_ISREG(status.st_mode):
            return f"{path}: is neither a file nor a folder"
        if not readable:
            return f"{path}: cannot be read: Permission denied"
        if status.st_size > LARGEST_BYTES:
            return (
                f"{path}: {status.st_size >> 20} MiB are more than {LARGEST_BYTES >> 20}; name it in the "
                "command instead, {here}/NAME, and keep it where the servers run"
            )
    return None


def read(path: Path) -> bytes:
    """Return what a file holds. Raises InputError."""
    try:
        return path.read_bytes()
    except OSError as error:
        raise InputError(f"files: {path}: cannot be read: {error.strerror}") from error


def text_of(data: bytes) -> str | None:
    """Return the text in which placeholders are filled in; None for binary files, which contain a NUL byte.

    Other bytes that are not UTF-8, as of text in Latin-1, are kept: encode with "surrogateescape".
    """
    return None if b"\0" in data else data.decode("utf-8", "surrogateescape")


def texts(files: Mapping[str, str], folder: Path) -> Iterator[tuple[str, str]]:
    """Yield the files that may have placeholders, with their texts, as far as they can be read."""
    for name, path in named(files, folder).items():
        try:
            text = text_of(read(path))
        except InputError:  # reported where it is copied
            continue
        if text is not None:
            yield name, text


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
            self.number = self._lock(private_folder())
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
        failed = sorted(self.folder.glob("failed*"), key=lambda file: file.lstat().st_mtime_ns)
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
