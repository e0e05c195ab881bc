"""Reading files that a person or an experiment names, and writing those that a person asked for."""

import errno
import os
import stat
import threading
from contextlib import suppress
from pathlib import Path

from swarmwright.core.errors import InputError

_CHUNK_BYTES = 1 << 20
"""Read at a time."""
_LARGEST_FILE_BYTES = 1 << 28
"""Of files that are read as text."""
_KINDS = (
    (stat.S_ISFIFO, "a pipe"),
    (stat.S_ISSOCK, "a socket"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
)


def read_bytes(path: Path, largest: int) -> bytes:
    """Return what a regular file holds.

    Other kinds of files could block the process or never end: a pipe, /dev/zero.

    largest: bytes.

    Raises OSError when it cannot be read, and InputError when it is not a regular file or is larger.
    """
    _check_kind(path, path.stat().st_mode)
    # Non-blocking, in case the file has been replaced by a pipe.
    descriptor = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
    with os.fdopen(descriptor, "rb") as file:
        status = os.fstat(descriptor)
        _check_kind(path, status.st_mode)
        if status.st_size <= largest:
            # Files in /proc report size 0 although they have content.
            data = file.read(status.st_size + 1)
            while len(data) <= largest and (more := file.read(_CHUNK_BYTES)):
                data += more
            if len(data) <= largest:
                return data
    raise InputError(f"{path}: is larger than {largest >> 20} MiB")


def contents(path: Path) -> bytes:
    """Return what a file that a person named holds.

    Raises InputError when it cannot be read, is not a regular file, or is larger than 256 MiB.
    """
    try:
        return read_bytes(path, _LARGEST_FILE_BYTES)
    except FileNotFoundError:
        raise InputError(f"{path}: there is no such file") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from error


def first_character(path: Path) -> str:
    """Return the first character of a text that is not white space, none of an empty one.

    Always "<" for UTF-16, which XML can be in. Raises InputError as `contents` does.
    """
    data = contents(path)
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        return "<"
    return data.removeprefix(b"\xef\xbb\xbf").lstrip()[:1].decode("latin-1")


def _check_kind(path: Path, mode: int) -> None:
    if stat.S_ISDIR(mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    for is_kind, words in _KINDS:
        if is_kind(mode):
            raise InputError(f"{path}: is {words}; expected a file")


def write_whole(path: Path, data: bytes) -> None:
    """Write a file that is there as a whole or not at all, beside its place first: the disk may be full.

    Raises OSError; what was there before then stays.
    """
    if path.exists() and not path.is_file():  # a device, such as /dev/null
        path.write_bytes(data)
        return
    target = path.resolve()
    part = target.with_name(f".{os.getpid()}-{threading.get_ident()}.part")
    try:
        part.write_bytes(data)
        part.replace(target)
    except BaseException:
        with suppress(OSError):
            part.unlink(missing_ok=True)
        raise


def write_text(path: str | Path, text: str) -> None:
    """Write UTF-8 text. Raises InputError, naming the file and the reason, when that is not possible."""
    try:
        Path(path).write_text(text, encoding="utf-8")
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror}") from error
