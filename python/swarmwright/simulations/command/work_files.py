"""Files and folders that are put into the work folder of each episode: `files` of a command's definition."""

import os
import stat
from collections.abc import Iterator, Mapping
from pathlib import Path

from swarmwright.common.errors import InputError

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
            found |= {f"{name}/{one.relative_to(path).as_posix()}": one for one in within(path)}
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
