"""Password files of the embedded broker: one line `user:hash` per user, argon2id."""

import contextlib
import os
import tempfile
from pathlib import Path

from swarmwright import _engine
from swarmwright.common.errors import InputError
from swarmwright.common.files import read_bytes


def check_user(name: str) -> str:
    """Return the name if it is valid in password and access files; else raise InputError."""
    if (
        not name
        or name.startswith("#")
        or ":" in name
        or not name.isprintable()
        or any(map(str.isspace, name))
    ):
        raise InputError(
            f"{name!r} is not a valid user name; it must not contain spaces or ':', nor begin with '#'"
        )
    return name


_LARGEST_FILE_BYTES = 1 << 26  # bytes


def set_password(path: Path, user: str, password: str) -> bool:
    """Set a user's password; create the file (mode 0600) and the user if necessary.

    Other lines, including comments, stay unchanged; the file is replaced atomically.

    Returns:
        Whether the user is new.

    Raises:
        InputError: The name is invalid, the password is empty, or the file cannot be read or written.
    """
    check_user(user)
    if not password:
        raise InputError("an empty password would admit every client; give one with at least one character")
    line = f"{user}:{_engine.hash_password(password)}\n"
    try:
        content = read_bytes(path, _LARGEST_FILE_BYTES).decode() if path.exists() else ""
        lines = content.splitlines(keepends=True)
        if lines and not lines[-1].endswith("\n"):
            lines[-1] += "\n"
        matches = [index for index, text in enumerate(lines) if text.lstrip().startswith(f"{user}:")]
        if matches:
            lines[matches[0]] = line
        else:
            lines.append(line)
        _replace(path, "".join(lines))
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "is not UTF-8 text"
        raise InputError(f"{path}: cannot be changed: {reason}") from error
    return not matches


def _replace(path: Path, text: str) -> None:
    path = path.resolve()
    descriptor, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")  # mode 0600
    try:
        with os.fdopen(descriptor, "w", encoding="utf-8") as file:
            file.write(text)
            file.flush()
            os.fsync(descriptor)
            if path.exists():
                before = path.stat()
                os.fchmod(descriptor, before.st_mode & 0o7777)
                with contextlib.suppress(PermissionError):
                    os.fchown(descriptor, before.st_uid, before.st_gid)
        Path(name).replace(path)
    except BaseException:
        Path(name).unlink(missing_ok=True)
        raise
