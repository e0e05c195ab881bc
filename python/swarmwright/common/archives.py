"""Reading of untrusted zip archives within limits: a small archive can unpack to any size."""

import re
import stat
import zipfile
import zlib
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from pathlib import Path

from swarmwright.common.errors import InputError
from swarmwright.common.untrusted import escape_line

_UNPACKED_BYTES = 1 << 28
"""Unpacked bytes that any archive may have."""
_UNPACKED_TIMES = 20
"""Largest ratio of a larger archive's unpacked size to its own: FMUs shrink to a third or a tenth."""
_MOST_ENTRIES = 100_000
_METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
"""Methods with limited output; FMI and SSP allow no others."""
_DRIVE = re.compile(r"[A-Za-z]:")
DAMAGED = (
    zipfile.BadZipFile, zipfile.LargeZipFile, zlib.error, RuntimeError, NotImplementedError, EOFError,
)  # fmt: skip
"""Exceptions of `zipfile` for damaged or encrypted archives."""


@contextmanager
def open_archive(path: Path, kind: str) -> Iterator[zipfile.ZipFile]:
    """Open an archive after checking that its unpacked size is within the limits.

    kind: expected content, for messages, such as "an FMU".

    Raises InputError if the archive cannot be read, is damaged, encrypted or too large, or has names outside
    of its folder; also for problems found while it is open.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            infos = archive.infolist()
            for info in infos:
                _check(path, info)
            if len(infos) > _MOST_ENTRIES:
                raise InputError(f"{path}: has {len(infos):,} entries, more than {_MOST_ENTRIES:,}")
            check_size(path, count_unpacked_bytes(archive), "unpacks to")
            yield archive
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from error
    except DAMAGED as error:
        raise InputError(f"{path}: is not {kind}, or is damaged: {error}") from error


def count_unpacked_bytes(archive: zipfile.ZipFile) -> int:
    """Return the unpacked size of an archive; `zipfile` stops at entries that are larger than declared."""
    return sum(info.file_size for info in archive.infolist())


def check_size(path: Path, size: int, phrase: str) -> None:
    """Raise InputError if an archive, with those inside it, unpacks to too much.

    Args:
        path: the archive.
        size: unpacked size, bytes.
        phrase: verb before the size in the message, such as "unpacks to".
    """
    limit = max(_UNPACKED_BYTES, _UNPACKED_TIMES * path.stat().st_size)
    if size > limit:
        raise InputError(
            f"{path}: {phrase} {size >> 20:,} MiB, more than {_UNPACKED_BYTES >> 20} MiB and "
            f"{_UNPACKED_TIMES} "
            "times its own size; if you trust it, repack it without compression (zip -0 -r)"
        )


def read_entry(archive: zipfile.ZipFile, path: Path, name: str, largest: int) -> bytes:
    """Return an entry of an archive. Raises InputError if it is missing or exceeds `largest` bytes."""
    try:
        info = archive.getinfo(name)
    except KeyError:
        raise InputError(f"{path}: has no {name}") from None
    if info.file_size > largest:
        raise InputError(
            f"{path}: {name} has {info.file_size >> 20:,} MiB, more than {largest >> 20} MiB, the limit"
        )
    # Without a size, zipfile unpacks more than declared, and cuts it off afterwards.
    with archive.open(info) as file:
        return file.read(info.file_size) + file.read(1)


def is_outside(name: str) -> bool:
    """Return whether some programs would unpack an entry of this name outside of the folder."""
    return name.startswith("/") or "\\" in name or bool(_DRIVE.match(name)) or ".." in name.split("/")


def _check(path: Path, info: zipfile.ZipInfo) -> None:
    name = escape_line(info.filename)
    if is_outside(info.filename):
        raise InputError(
            f"{path}: {name}: is not a name inside a folder (absolute, with .., a backslash or a drive "
            "letter); do not unpack this archive"
        )
    if info.compress_type not in _METHODS:
        raise InputError(
            f"{path}: {name}: is compressed by method {info.compress_type}; expected deflate or none, as "
            "written by `zip`"
        )


FORMAT = 1
"""Version of the archive's layout."""
MANIFEST = "manifest.json"
CONTROLLER = "controller.json"
EVALUATION = "evaluation.json"
_LARGEST_BUNDLE_BYTES = 1 << 28
"""Largest size of all files of a bundle, in bytes."""


def read_files(path: Path) -> dict[str, bytes]:
    """Return the files of a bundle by name, from the archive or its unpacked folder.

    Raises InputError when it cannot be read, has no manifest, or has invalid files: names outside its folder,
    links or devices, duplicate names, or too many bytes.
    """
    if path.is_dir():
        return _read_folder(path)
    with open_archive(path, "a bundle") as archive:
        for info in archive.infolist():
            if stat.S_IFMT(info.external_attr >> 16) not in (0, stat.S_IFREG, stat.S_IFDIR):
                raise InputError(_describe_special_file(path, info.filename))
        infos = [info for info in archive.infolist() if not info.is_dir()]  # other programs add folders
        _check_size(path, sum(info.file_size for info in infos))
        names = [info.filename for info in infos]
        if len(set(names)) < len(names):
            raise InputError(f"{path}: duplicate file name {escape_line(_find_duplicate(names))}")
        _check_manifest(path, names)
        return {name: read_entry(archive, path, name, _LARGEST_BUNDLE_BYTES) for name in names}


def _read_folder(folder: Path) -> dict[str, bytes]:
    """Return the files of an unpacked bundle by name; links are not followed."""
    try:
        files = {
            file.relative_to(folder).as_posix(): file
            for file in sorted(folder.rglob("*"))
            if file.is_symlink() or not file.is_dir()
        }
        _check_manifest(folder, files)
        for name, file in files.items():
            _check_name(folder, name)
            if file.is_symlink() or not file.is_file():
                raise InputError(_describe_special_file(folder, name))
        _check_size(folder, sum(file.stat().st_size for file in files.values()))
        return {name: file.read_bytes() for name, file in files.items()}
    except OSError as error:
        raise InputError(f"{folder}: cannot be read: {error.strerror or error}") from error


def _describe_special_file(path: Path, name: str) -> str:
    return f"{path}: {escape_line(name)}: is not a regular file; the archive was not written by Swarmwright"


def _check_name(path: Path, name: str) -> None:
    """Raise InputError for a name that some programs unpack outside the bundle's folder."""
    if is_outside(name):
        raise InputError(
            f"{path}: {escape_line(name)}: is not a path inside the folder (absolute, or with .., a "
            "backslash or a drive letter); the archive was not written by Swarmwright"
        )


def _check_size(path: Path, size: int) -> None:
    if size > _LARGEST_BUNDLE_BYTES:
        raise InputError(f"{path}: its files exceed the limit of {_LARGEST_BUNDLE_BYTES >> 20} MiB")


def _check_manifest(path: Path, names: Collection[str]) -> None:
    if MANIFEST not in names:
        raise InputError(
            f"{path}: is not a bundle, because {MANIFEST} is missing; create a bundle with "
            "`swarmwright export RUN --bundle FILE.zip`"
        )


def _find_duplicate(names: list[str]) -> str:
    return next(name for name in names if names.count(name) > 1)
