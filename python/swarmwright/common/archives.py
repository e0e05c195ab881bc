"""Reading of untrusted zip archives within limits: a small archive can unpack to any size."""

import re
import zipfile
import zlib
from collections.abc import Iterator
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
