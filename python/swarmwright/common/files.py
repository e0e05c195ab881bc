"""Input and output of files named by users and experiments."""

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
_LARGEST_FILE_BYTES = 1 << 28
"""Largest size of text files."""
IS_UTF16 = "is UTF-16 text; save it as UTF-8"
"""Message on a file in UTF-16 where UTF-8 is required."""
_YAML = frozenset({".yaml", ".yml"})
_KINDS = (
    (stat.S_ISFIFO, "a pipe"),
    (stat.S_ISSOCK, "a socket"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
)


def suggest_file(path: Path) -> str:
    """Return "; did you mean 'x.yaml'?" for a similar file beside a missing one, or ""."""
    try:
        beside = sorted(
            neighbour
            for neighbour in path.parent.iterdir()
            if neighbour.suffix.lower() in _find_suffixes(path)
        )
    except (OSError, ValueError):  # the folder is missing or unreadable; not a path
        return ""
    # Without suffixes, which would make all names similar.
    names = {neighbour.stem: neighbour.name for neighbour in beside}
    match = nearest(path.stem, names)
    return "" if match is None else f"; did you mean '{names[match]}'?"


def _find_suffixes(path: Path) -> frozenset[str]:
    """Return the suffixes of files of the same kind."""
    suffix = path.suffix.lower()
    return _YAML if suffix in _YAML else frozenset({suffix})


def read_bytes(path: Path, largest: int) -> bytes:
    """Return the content of a regular file.

    Other kinds of files could block the process or never end: a pipe, /dev/zero.

    largest: limit in bytes.

    Raises OSError if it cannot be read, and InputError if it is not a regular file or is larger.
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
    """Return the content of a file named by the user.

    Raises InputError if it cannot be read, is not a regular file, or is larger than 256 MiB.
    """
    try:
        return read_bytes(path, _LARGEST_FILE_BYTES)
    except FileNotFoundError:
        raise InputError(f"{path}: there is no such file") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from error


def first_character(path: Path) -> str:
    """Return the first character of a text file that is not white space, "" if there is none.

    The text may be in UTF-16, as XML can be. Raises the errors of `read_contents`.
    """
    return first_character_of(read_contents(path))


def first_character_of(data: bytes) -> str:
    """Return the first character of a file's content that is not white space, "" if there is none."""
    if is_utf16(data):
        return data.decode("utf-16", "replace").lstrip()[:1]
    return data.removeprefix(b"\xef\xbb\xbf").lstrip()[:1].decode("latin-1")


def is_utf16(data: bytes) -> bool:
    """Return whether data begins with the byte order mark of UTF-16."""
    return data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))


def _check_kind(path: Path, mode: int) -> None:
    if stat.S_ISDIR(mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    for is_kind, words in _KINDS:
        if is_kind(mode):
            raise InputError(f"{path}: is {words}; expected a file")


def write_whole(path: Path, data: bytes) -> None:
    """Write a file atomically through a temporary file beside it, since the disk may be full.

    Raises OSError; then the previous file remains.
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
    """Write UTF-8 text. Raises InputError with the file and the reason if that is not possible."""
    try:
        Path(path).write_text(text, encoding="utf-8")
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror}") from error


def check_utf8(text: str) -> None:
    """Raise InputError if a text has bytes of a file name that are not characters.

    Python keeps these as surrogates, which cannot be written to UTF-8 files.
    """
    try:
        text.encode()
    except UnicodeEncodeError as error:
        raise InputError(explain_not_utf8(error)) from None


def explain_not_utf8(error: UnicodeEncodeError) -> str:
    """Return a message on text that cannot be written, with the part and the remedy."""
    text, start = error.object, error.start
    begin = max(text.rfind(sign, 0, start) for sign in '"\n') + 1
    end = min((at for sign in '"\n' if (at := text.find(sign, start)) >= 0), default=len(text))
    try:
        part = os.fsencode(text[begin:end]).decode("utf-8", "backslashreplace")
    except UnicodeEncodeError:  # not from a file name
        part = text[begin:end].encode("ascii", "backslashreplace").decode()
    remedy = "use another name"
    if sys.getfilesystemencoding().lower() not in {"utf-8", "utf8"}:
        remedy = "set PYTHONUTF8=1, or a locale with UTF-8 (LC_ALL=C.UTF-8)"
    return f"{part}: is not valid UTF-8, in which files of runs and brokers are written; {remedy}"


def make_private_folder(folder: Path) -> None:
    """Create a folder that only this user can enter, and its missing parents likewise; existing ones stay.

    Raises OSError.
    """
    for level in (*reversed(folder.parents), folder):
        level.mkdir(mode=0o700, exist_ok=True)


def state_folder() -> Path | None:
    """Return the folder of what Swarmwright remembers of this user: below XDG_STATE_HOME or ~/.local/state.

    A relative XDG_STATE_HOME is ignored, as the XDG Base Directory Specification requires. None for a user
    without a home folder, such as in containers.
    """
    state = Path(os.environ.get("XDG_STATE_HOME", ""))
    if not state.is_absolute():
        try:
            state = Path.home() / ".local" / "state"
        except RuntimeError:
            return None
    return state / "swarmwright"
