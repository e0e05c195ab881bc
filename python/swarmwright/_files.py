"""Writing files that a person asked for."""

from pathlib import Path

from swarmwright._errors import InputError


def write_text(path: str | Path, text: str) -> None:
    """Write UTF-8 text. Raises InputError, naming the file and the reason, when that is not possible."""
    try:
        Path(path).write_text(text, encoding="utf-8")
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror}") from error
