"""Work folders, and the `files` of a command's definition that are copied into them.

Instances that run side by side on a machine have separate folders and ports.
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
from swarmwright.common.formatting import kind_of
from swarmwright.common.temporary import private_folder, remove

LARGEST_BYTES = 1 << 26
"""Largest size of a file of a simulation in bytes; larger files are not copied into run folders."""
_MOST_FILES = 10_000
"""Largest number of files of all folders together, as they are copied for every episode."""


def iterate_files(folder: Path) -> Iterator[Path]:
    """Yield the files of a folder, sorted, except for hidden ones and __pycache__."""
    for path in sorted(folder.rglob("*")):
        parts = path.relative_to(folder).parts
        if path.is_file() and not any(part.startswith(".") or part == "__pycache__" for part in parts):
            yield path


def resolve_files(files: Mapping[str, str], folder: Path) -> dict[str, Path]:
    """Return all files by their names in the work folder, including those of folders.

    Args:
        files: name in the work folder -> path of a file or folder.
        folder: folder that the paths are relative to.
    """
    resolved: dict[str, Path] = {}
    for name, location in files.items():
        path = folder / location
        if path.is_dir():
            resolved |= {f"{name}/{file.relative_to(path).as_posix()}": file for file in iterate_files(path)}
        else:
            resolved[name] = path
    return resolved


def find_problem(files: Mapping[str, str], folder: Path) -> str | None:
    """Return why files cannot be copied into a work folder; None if they can."""
    for location in files.values():
        path = folder / location
        if not path.exists():
            return f"{path}: there is no such file or folder"
        if path.is_dir() and next(iterate_files(path), None) is None:
            return f"{path}: is a folder without files, apart from hidden ones and __pycache__"
    resolved = resolve_files(files, folder)
    if len(resolved) > _MOST_FILES:
        return (
            f"{len(resolved)} files are more than {_MOST_FILES}, too many to copy for every episode; name "
            "the folder in the command instead, {here}/FOLDER"
        )
    for path in resolved.values():
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
                "command instead, {here}/NAME, and copy it to the servers' machines"
            )
    return None


def read(path: Path) -> bytes:
    """Return the bytes of a file. Raises InputError."""
    try:
        return path.read_bytes()
    except OSError as error:
        raise InputError(f"files: {path}: cannot be read: {error.strerror}") from error


def decode_text(data: bytes) -> str | None:
    """Return the text of a file with placeholders; None for binary files, which contain a NUL byte.

    Other bytes that are not UTF-8, such as Latin-1, are preserved: encode with "surrogateescape".
    """
    return None if b"\0" in data else data.decode("utf-8", "surrogateescape")


def iterate_texts(files: Mapping[str, str], folder: Path) -> Iterator[tuple[str, str]]:
    """Yield the names and texts of readable files that may have placeholders."""
    for name, path in resolve_files(files, folder).items():
        try:
            text = decode_text(read(path))
        except InputError:  # reported when it is copied
            continue
        if text is not None:
            yield name, text


_PORTS, _EACH = 21_000, 20
"""First port, and number of ports of an instance."""
_MOST_INSTANCES = 2000
"""Largest number of instances on a machine."""
_MOST_KINDS = 5
"""Largest number of kinds of failures of a process for which a work folder is kept."""
_MOST_FAILED = 10
"""Largest number of work folders of failed episodes that are kept for an instance's number; the latest are
kept."""


class Instance:
    """One of the instances that run side by side on this machine, with a number that is locked until it ends.

    Args:
        root: the parent folder of work folders.

    Raises InputError if that folder cannot be written.
    """

    def __init__(self, root: Path) -> None:
        self.root = root
        try:
            # Numbers, and thus ports and displays, are unique for the user, wherever the work folders are.
            self.number = self._lock(private_folder())
            root.mkdir(mode=0o700, parents=True, exist_ok=True)
            self.folder = root / f"instance-{self.number}"
            self._make_folder()
        except OSError as error:
            raise InputError(
                f"simulation.work: {root} cannot be written: {error.strerror}; name another folder"
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
        """Return a free TCP port that no other instance uses."""
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
        """Delete the work folders of a killed process."""
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
        """Record a failure; return whether it is the first of its kind, and among the first kinds."""
        kind = kind_of(reason)
        if kind in self._kinds or len(self._kinds) >= _MOST_KINDS:
            return False
        self._kinds.add(kind)
        return True

    def keep_failed(self, folder: Path) -> Path:
        """Rename the folder of a failed episode to keep it; return its new path.

        Called for the first failure of each kind. The ten latest folders of this number are kept, including
        those of other processes, so that another run does not delete them immediately.
        """
        # Another instance of this process, or an earlier process with its id, may have had this number.
        names = (self.folder / f"failed-{os.getpid()}-{count}" for count in itertools.count(1))
        target = next(name for name in names if not name.exists())
        folder.rename(target)
        os.utime(target)
        failed = sorted(self.folder.glob("failed*"), key=lambda file: file.lstat().st_mtime_ns)
        for older in failed[:-_MOST_FAILED]:
            remove(older)
        return target

    def close(self) -> None:
        """Release the number, and remove the folder if it is empty."""
        with contextlib.suppress(OSError):
            self.folder.rmdir()
        with contextlib.suppress(OSError):
            os.close(self._descriptor)


def measure_size(folder: Path) -> int:
    """Return the bytes that the files in a folder occupy on the disk."""
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
