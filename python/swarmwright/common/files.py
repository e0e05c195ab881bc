"""Reading files that a person or an experiment names, and writing those that a person asked for."""

import codecs
import errno
import os
import stat
import sys
import threading
from contextlib import suppress
from os import PathLike
from pathlib import Path

from swarmwright.common.errors import InputError
from swarmwright.common.suggestions import nearest

_CHUNK_BYTES = 1 << 20
"""Read at a time."""
_LARGEST_FILE_BYTES = 1 << 28
"""Of files that are read as text."""
IS_UTF16 = "is UTF-16 text; save it as UTF-8"
"""What is said of a file in UTF-16 where that cannot be read."""
_YAML = frozenset({".yaml", ".yml"})
_KINDS = (
    (stat.S_ISFIFO, "a pipe"),
    (stat.S_ISSOCK, "a socket"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
)


def suggest_file(path: Path) -> str:
    """Return "; did you mean 'x.yaml'?" for a file of the same kind beside one that is not there, or ""."""
    try:
        beside = sorted(
            neighbour for neighbour in path.parent.iterdir() if neighbour.suffix.lower() in _alike(path)
        )
    except (OSError, ValueError):  # no such folder, or one that may not be read; no path
        return ""
    # Without suffixes, which make names of the same kind alike.
    names = {neighbour.stem: neighbour.name for neighbour in beside}
    near = nearest(path.stem, names)
    return "" if near is None else f"; did you mean '{names[near]}'?"


def _alike(path: Path) -> frozenset[str]:
    """Return the suffixes of files that hold the same as one of this name."""
    suffix = path.suffix.lower()
    return _YAML if suffix in _YAML else frozenset({suffix})


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


def read_contents(path: Path) -> bytes:
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

    The text may be in UTF-16, as XML can be. Raises InputError as `read_contents` does.
    """
    return first_character_of(read_contents(path))


def first_character_of(data: bytes) -> str:
    """Return the first character that is not white space of what a text file holds, none of an empty one."""
    if is_utf16(data):
        return data.decode("utf-16", "replace").lstrip()[:1]
    return data.removeprefix(b"\xef\xbb\xbf").lstrip()[:1].decode("latin-1")


def is_utf16(data: bytes) -> bool:
    """Whether what a file holds begins with the byte order mark of UTF-16."""
    return data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))


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


def write_text(path: str | PathLike[str], text: str) -> None:
    """Write UTF-8 text. Raises InputError, naming the file and the reason, when that is not possible."""
    try:
        Path(path).write_text(text, encoding="utf-8")
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror}") from error


def check_utf8(text: str) -> None:
    """Raise InputError where a text has bytes of a file's name that are not characters.

    Python keeps these as surrogates, which cannot be written into files, all of which are UTF-8.
    """
    try:
        text.encode()
    except UnicodeEncodeError as error:
        raise InputError(explain_not_utf8(error)) from None


def explain_not_utf8(error: UnicodeEncodeError) -> str:
    """Return what is said of a text that cannot be written: which part of it, and how to avoid that."""
    text, start = error.object, error.start
    begin = max(text.rfind(sign, 0, start) for sign in '"\n') + 1
    end = min((at for sign in '"\n' if (at := text.find(sign, start)) >= 0), default=len(text))
    try:
        part = os.fsencode(text[begin:end]).decode("utf-8", "backslashreplace")
    except UnicodeEncodeError:  # it is not from a file's name
        part = text[begin:end].encode("ascii", "backslashreplace").decode()
    remedy = "use another name"
    if sys.getfilesystemencoding().lower() not in {"utf-8", "utf8"}:
        remedy = "set PYTHONUTF8=1, or a locale with UTF-8 (LC_ALL=C.UTF-8)"
    return f"{part}: is not UTF-8 here, which files of runs and brokers are written in; {remedy}"
