"""Files that a simulation reads and an experiment names, `servers: {files: [maps/*.json]}`."""

import dataclasses
import itertools
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from swarmwright.common.errors import InputError
from swarmwright.simulations.user_code.parts import Part, Source

LARGEST_BYTES = 1 << 28
"""Bytes of all files of a simulation."""
_OF_A_RUN = ("run.sqlite", "run.sqlite.new")
"""By which a run folder is known."""


def home_of(part: Part) -> Path:
    """Return the folder that patterns are relative to: the one that modules of the part are found in."""
    return part.origin.parents[len(Path(part.main).parts) - 1]


def named(home: Path, patterns: Sequence[str]) -> list[Path]:
    """Return the files that patterns name.

    Raises InputError for a pattern without any, and one that leads out of the folder.
    """
    found: set[Path] = set()
    for pattern in patterns:
        if not _lies_inside(pattern):
            raise InputError(f"servers: files: {pattern!r} must lie in {home}, beside the simulation")
        try:
            matches = _matches(home, pattern)
        except (ValueError, NotImplementedError) as error:
            raise InputError(
                f"servers: files: {pattern!r} is no pattern: {error}; write a path, * for any name in one "
                "folder, or **/ for any folders"
            ) from None
        if not matches:
            raise InputError(
                f"servers: files: there is no file {pattern} in {home}, the folder from which the "
                f"simulation's code is imported{_left_out(pattern)}"
            )
        outside = next((path for path in matches if not _is_in(home, path)), None)
        if outside is not None:
            raise InputError(
                f"servers: files: {outside} leads through a link out of {home}, to {outside.resolve()}; put "
                "the file itself there, or name files without it"
            )
        found.update(matches)
    return sorted(found)


def with_data(part: Part, patterns: Sequence[str]) -> Part:
    """Return a part with the files that patterns name now; patterns without any are left out.

    Raises InputError when a file cannot be read, or there are too many.
    """
    if not patterns:
        return part
    home = home_of(part)
    paths = {path for pattern in patterns for path in _safe_matches(home, pattern)}
    places = {path.relative_to(home).as_posix(): path for path in sorted(paths)}
    places = {place: path for place, path in places.items() if place not in part.files or place in part.data}
    try:
        size = sum(path.stat().st_size for path in places.values())
    except OSError as error:
        raise InputError(f"servers: files: {error.filename}: cannot be read: {error.strerror}") from error
    if size > LARGEST_BYTES:
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
        f"servers: files: {size >> 20} MiB are more than {LARGEST_BYTES >> 20}; copy them to the servers' "
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


def _is_in(home: Path, path: Path) -> bool:
    return path.resolve().is_relative_to(home.resolve())


def _safe_matches(home: Path, pattern: str) -> list[Path]:
    """Return what a pattern of a run folder names, which may be anybody's: nothing outside of the folder."""
    if not _lies_inside(pattern):
        return []
    with suppress(ValueError, NotImplementedError):
        return [path for path in _matches(home, pattern) if _is_in(home, path)]
    return []


def _matches(home: Path, pattern: str) -> list[Path]:
    """Return the files that a pattern names. Raises ValueError and NotImplementedError as `Path.glob` does.

    Below a run folder, a hidden one and __pycache__ it names none, unless it names that folder without a
    wildcard: runs lie beside their simulation, and no run could go on once it has written its own files.
    """
    named = len(_folders_named(pattern))
    passed: dict[Path, bool] = {home: True}

    def is_passed(folder: Path) -> bool:
        if folder not in passed:
            own = len(folder.relative_to(home).parts) <= named or not _is_left_out(folder)
            passed[folder] = own and is_passed(folder.parent)
        return passed[folder]

    return [path for path in home.glob(pattern) if is_passed(path.parent) and path.is_file()]


def _folders_named(pattern: str) -> tuple[str, ...]:
    """Return the folders that a pattern begins with, up to its first wildcard."""
    folders = Path(pattern).parts[:-1]
    return tuple(itertools.takewhile(lambda name: not set("*?[") & set(name), folders))


def _is_left_out(folder: Path) -> bool:
    if folder.name.startswith(".") or folder.name == "__pycache__":
        return True
    return any((folder / name).exists() for name in _OF_A_RUN)


def _left_out(pattern: str) -> str:
    """Return, for an error, where a pattern finds nothing."""
    if len(_folders_named(pattern)) == len(Path(pattern).parts) - 1:
        return ""
    return ", apart from folders that a wildcard leaves out: of runs, hidden ones and __pycache__"
