"""Comparison of the current source with a run's copy, and warnings about changes."""

import difflib
import hashlib
import os
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from swarmwright.common.errors import InputError
from swarmwright.common.simulation_names import SimulationName, is_command, is_environment
from swarmwright.common.warn_once import warn_once
from swarmwright.simulations.user_code.copying import CopiedPart, Copy, list_paths_beside
from swarmwright.simulations.user_code.parts import (
    Part,
    Source,
    is_plug_in,
    read_plug_in,
    read_simulation,
    with_data,
)

LINES = 60
"""Largest number of lines of a difference."""
_SHOWN_CHARACTERS = 200
"""Largest number of characters of a displayed line."""


def read_current(copy: Copy, copied_part: CopiedPart) -> Part | None:
    """Return the current source at the origin of a copy; None if it no longer exists.

    A file is searched at its path relative to the run folder, then in and beside the run folder, then at its
    absolute path. Raises InputError if it cannot be read.
    """
    part = _read_current_code(copy, copied_part)
    return None if part is None else with_data(part, copied_part.patterns)


def _read_current_code(copy: Copy, copied: CopiedPart) -> Part | None:
    """Return the current source without data files."""
    if is_plug_in(copied.name) and not copied.in_file:
        try:
            return read_plug_in(copied.name, copied.component)
        except InputError:
            return None  # not installed, which is reported when it is used
    if is_environment(copied.component):
        return read_simulation(copied.component)
    if is_command(copied.component):
        return _read_current_command(copy, copied)
    if copied.module is not None:
        part = Part.from_module(copied.name, copied.component, copied.module)
        if part is not None or "." in copied.module:
            return part
    for path in _list_candidates(copy.run, copied):
        if path.is_file():
            return Part.from_file(copied.name, copied.component, path)
    return None


def _read_current_command(copy: Copy, copied: CopiedPart) -> Part | None:
    """Return the current files of a command; its definition is part of the run and cannot change."""
    imported = set(copied.digests) - {copied.main} - copied.data
    for path in _list_candidates(copy.run, copied):
        with suppress(InputError):
            part = read_simulation(SimulationName.parse(copied.component).with_file(path))
            if part is not None and (not imported or imported & set(part.files)):
                return part
    return None


@dataclass(frozen=True)
class Choice:
    """The source that is used for a component of a run."""

    part: Part
    copied: bool
    """Whether the source is the copy."""
    current: Part | None
    """If it is the copy: the current source at its origin, if any."""


def choose(copy: Copy, copied: CopiedPart) -> Choice:
    """Choose the current source if it equals the copy, else the copy.

    Of the data files, the copy has only those that the experiment names. Raises InputError if the copy was
    changed.
    """
    current = read_current(copy, copied)
    if current is not None and current.digests == dict(copied.digests):
        return Choice(current, copied=False, current=None)
    folder = copy.folder / copied.name
    files = {location: Source(folder / location, copy.read(copied, location)) for location in copied.digests}
    names = copied.name, copied.component, copied.main, copied.module
    part = Part(*names, files, frozenset(), copied.data, copied.patterns)
    return Choice(part, copied=True, current=current)


def _list_candidates(run: Path, copied: CopiedPart) -> Iterator[Path]:
    yield Path(os.path.normpath(run.resolve() / copied.relative_origin))
    yield from list_paths_beside(run, copied.origin)
    yield copied.origin


def list_files(simulation: str) -> dict[str, str]:
    """Return the current files of a class: path -> SHA-256, in hexadecimal.

    Empty for classes without source and for a run's copy. Raises InputError.
    """
    location = SimulationName.parse(simulation).location
    if not location or Copy.find_containing(Path(location)) is not None:
        return {}
    part = read_simulation(simulation)
    if part is None:
        return {}
    # A command's definition is not a file.
    virtual = part.main if is_command(simulation) else None
    return {str(file.origin): file.digest for name, file in part.files.items() if name != virtual}


def check_unchanged(files: Mapping[str, str]) -> None:
    """Raise InputError if a file has changed since `list_files` was called."""
    for name, digest in files.items():
        try:
            data = Path(name).read_bytes()
        except OSError as error:
            raise InputError(f"{name}: can no longer be read: {error.strerror}") from error
        if hashlib.sha256(data).hexdigest() != digest:
            raise InputError(
                f"{name}: was edited since this run was started, so a new server would compute different "
                "results; restore it, and continue with `swarmwright resume`"
            )


def summarize_changes(copied: CopiedPart, part: Part) -> str:
    """Return the differences in files as a phrase."""
    now = part.digests
    edited = [
        location
        for location in copied.digests
        if location in now and copied.digests[location] != now[location]
    ]
    words = [f"{shorten_path(part.files[location].origin)} was edited" for location in edited]
    before, after = (SimulationName.parse(either.component).label for either in (copied, part))
    if before != after:
        words.append(f"class {after} instead of {before}")
    words += [
        f"{location} {'was deleted' if location in copied.data else 'was removed from the imports'}"
        for location in copied.digests
        if location not in now
    ]
    words += [
        f"{shorten_path(part.files[location].origin)} "
        f"{'is new' if location in part.data else 'was added to the imports'}"
        for location in now
        if location not in copied.digests
    ]
    return ", ".join(words)


def format_difference(copy: Copy, copied: CopiedPart, part: Part) -> str:
    """Return a unified diff from the copy to the current source, of at most `LINES` lines.

    Raises InputError if the copy itself was changed.
    """
    lines: list[str] = []
    for location in sorted({*copied.digests, *part.files}):
        old = copy.read(copied, location) if location in copied.digests else b""
        source = part.files.get(location)
        new = b"" if source is None else source.data
        if old == new:
            continue
        before = (
            str(shorten_path(copy.folder / copied.name / location))
            if location in copied.digests
            else os.devnull
        )
        after = os.devnull if source is None else str(shorten_path(source.origin))
        lines += _format_unified(old, new, before, after)
    more = len(lines) - LINES
    if more > 0:
        lines = [*lines[:LINES], f".. and {more} more lines"]
    return "\n".join(lines)


def _format_unified(old: bytes, new: bytes, before: str, after: str) -> list[str]:
    try:
        texts = old.decode().splitlines(), new.decode().splitlines()
    except UnicodeDecodeError:
        return [f"binary files {before} and {after} differ"]
    lines = [_printable(line) for line in difflib.unified_diff(*texts, before, after, lineterm="")]
    return lines or [f"{before} and {after} differ in the ends of their lines"]


def _printable(line: str) -> str:
    """Replace terminal control characters in a line, as the copy may come from anyone."""
    clean = "".join(sign if sign.isprintable() or sign == "\t" else "\ufffd" for sign in line)
    return clean if len(clean) <= _SHOWN_CHARACTERS else f"{clean[:_SHOWN_CHARACTERS]} .."


def shorten_path(path: Path) -> Path:
    """Return a path relative to the working folder if it is inside."""
    folder = Path.cwd()
    return path.relative_to(folder) if path.is_relative_to(folder) else path


def warn_of_copy(copy: Copy, copied: CopiedPart, current: Part, hint: str = "") -> None:
    """Warn once that the run's copy is used because the original has changed.

    hint: a remedy to append, beginning with a semicolon; it does not make the warning a different one.
    """
    changes = summarize_changes(copied, current)
    text = f"{shorten_path(copy.run.absolute())}: {changes} since the run; its copy in the run folder is used"
    warn_once(f"{text}{hint}", key=text)
