"""Files that a simulation reads and an experiment names, `servers: {files: [maps/*.json]}`."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path

from swarmwright.core.errors import InputError
from swarmwright.user_code.parts import Part, Source

LARGEST = 1 << 28
"""Bytes of all files of a simulation."""


def home_of(part: Part) -> Path:
    """Return the folder that patterns are relative to: the one that modules of the part are found in."""
    return part.origin.parents[len(Path(part.main).parts) - 1]


def named(home: Path, patterns: Sequence[str]) -> list[Path]:
    """Return the files that patterns name. Raises InputError for a pattern without any."""
    found: set[Path] = set()
    for pattern in patterns:
        if not _lies_inside(pattern):
            raise InputError(f"servers: files: {pattern!r} must lie in {home}, beside the simulation")
        matches = _matches(home, pattern)
        if not matches:
            raise InputError(f"servers: files: there is no file {pattern} in {home}")
        found.update(matches)
    return sorted(found)


def with_data(part: Part, patterns: Sequence[str]) -> Part:
    """Return a part with the files that patterns name now; patterns without any are left out.

    Raises InputError when a file cannot be read, or there are too many.
    """
    if not patterns:
        return part
    home = home_of(part)
    # Patterns of a run folder may be anybody's: nothing outside of the simulation's folder is read.
    paths = {path for pattern in patterns if _lies_inside(pattern) for path in _matches(home, pattern)}
    places = {path.relative_to(home).as_posix(): path for path in sorted(paths)}
    places = {place: path for place, path in places.items() if place not in part.files or place in part.data}
    try:
        size = sum(path.stat().st_size for path in places.values())
    except OSError as error:
        raise InputError(f"servers: files: {error.filename}: cannot be read: {error.strerror}") from error
    if size > LARGEST:
        raise too_large(size)
    data = {place: Source(path, read(path)) for place, path in places.items()}
    return dataclasses.replace(
        part,
        files={**part.files, **data},
        data=part.data | frozenset(data),
        patterns=tuple(dict.fromkeys([*part.patterns, *patterns])),
    )


def too_large(size: int) -> InputError:
    """Return the error for files of so many bytes."""
    return InputError(
        f"servers: files: {size >> 20} MiB are more than {LARGEST >> 20}; copy them to the servers' "
        "machines and name their folder with the option code"
    )


def read(path: Path) -> bytes:
    """Return what a file holds. Raises InputError."""
    try:
        return path.read_bytes()
    except OSError as error:
        raise InputError(f"servers: files: {path}: cannot be read: {error.strerror}") from error


def _lies_inside(pattern: str) -> bool:
    path = Path(pattern)
    return bool(path.parts) and not path.is_absolute() and ".." not in path.parts


def _matches(home: Path, pattern: str) -> list[Path]:
    return [path for path in home.glob(pattern) if path.is_file()]
