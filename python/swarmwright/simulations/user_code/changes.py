"""The current source in the place of what a run has copied, and how it differs.

Warnings about source that has changed since a run.
"""

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
from swarmwright.simulations.user_code.copying import Copy, Kept, beside
from swarmwright.simulations.user_code.parts import (
    Part,
    Source,
    is_plug_in,
    of_plug_in,
    of_simulation,
    with_data,
)

LINES = 60
"""Of a difference, at most."""
_SHOWN_CHARACTERS = 200
"""Characters of a line that are shown."""


def present(copy: Copy, kept: Kept) -> Part | None:
    """Return the source that is now where the copy was taken from; None when nothing is there any more.

    A file is looked for where it was seen from the run folder, then in and beside the run folder, then where
    it was: of several candidates the nearest file is meant. Raises InputError when it cannot be read.
    """
    part = _code(copy, kept)
    return None if part is None else with_data(part, kept.patterns)


def _code(copy: Copy, kept: Kept) -> Part | None:
    """Return the source without the files that it reads."""
    if is_plug_in(kept.name) and not kept.in_file:
        try:
            return of_plug_in(kept.name, kept.component)
        except InputError:
            return None  # not installed; reported where it is used
    if is_environment(kept.component):
        return of_simulation(kept.component)
    if is_command(kept.component):
        return _present_command(copy, kept)
    if kept.module is not None:
        part = Part.of_module(kept.name, kept.component, kept.module)
        if part is not None or "." in kept.module:
            return part
    for path in _places(copy.run, kept):
        if path.is_file():
            return Part.of_file(kept.name, kept.component, path)
    return None


def _present_command(copy: Copy, kept: Kept) -> Part | None:
    """Return a command's files where they are now: its definition is the run's, only these can change."""
    others = set(kept.digests) - {kept.main} - kept.data
    for path in _places(copy.run, kept):
        with suppress(InputError):
            part = of_simulation(SimulationName.parse(kept.component).in_file(path))
            if part is not None and (not others or others & set(part.files)):
                return part
    return None


@dataclass(frozen=True)
class Choice:
    """Which source of a kept component is used."""

    part: Part
    copied: bool
    """Whether it is the copy."""
    instead: Part | None
    """Where it is the copy: what is there now in the place of what was copied, if anything is."""


def choose(copy: Copy, kept: Kept) -> Choice:
    """Take what is there now where it is what was copied, else the copy.

    Of files that the code reads, the copy has only those that the experiment names. Raises InputError when
    the copy was changed.
    """
    now = present(copy, kept)
    if now is not None and now.digests == dict(kept.digests):
        return Choice(now, copied=False, instead=None)
    folder = copy.folder / kept.name
    files = {place: Source(folder / place, copy.read(kept, place)) for place in kept.digests}
    names = kept.name, kept.component, kept.main, kept.module
    part = Part(*names, files, frozenset(), kept.data, kept.patterns)
    return Choice(part, copied=True, instead=now)


def _places(run: Path, kept: Kept) -> Iterator[Path]:
    yield Path(os.path.normpath(run.resolve() / kept.beside))
    yield from beside(run, kept.origin)
    yield kept.origin


def files_of(simulation: str) -> dict[str, str]:
    """Return the files of a class as they are now: path -> SHA-256, in hexadecimal.

    Classes without source and those of a run's copy have none. Raises InputError.
    """
    place = SimulationName.parse(simulation).place
    if not place or Copy.holding(Path(place)) is not None:
        return {}
    part = of_simulation(simulation)
    if part is None:
        return {}
    # A command's definition is in no file.
    virtual = part.main if is_command(simulation) else None
    return {str(file.origin): file.digest for name, file in part.files.items() if name != virtual}


def check_unchanged(files: Mapping[str, str]) -> None:
    """Raise InputError when one of these files has changed since `files_of` was called."""
    for name, digest in files.items():
        try:
            data = Path(name).read_bytes()
        except OSError as error:
            raise InputError(f"{name}: cannot be read any more: {error.strerror}") from error
        if hashlib.sha256(data).hexdigest() != digest:
            raise InputError(
                f"{name}: was edited since this run was started, so that a new server would not compute "
                "what the others do; restore it, and go on with `swarmwright resume`"
            )


def summary(kept: Kept, part: Part) -> str:
    """Return which files differ, in words."""
    now = part.digests
    edited = [place for place in kept.digests if place in now and kept.digests[place] != now[place]]
    words = [f"{near(part.files[place].origin)} was edited" for place in edited]
    before, after = (SimulationName.parse(either.component).label for either in (kept, part))
    if before != after:
        words.append(f"class {after} instead of {before}")
    words += [
        f"{place} {'is gone' if place in kept.data else 'was dropped from the imports'}"
        for place in kept.digests
        if place not in now
    ]
    words += [
        f"{near(part.files[place].origin)} {'is new' if place in part.data else 'was added to the imports'}"
        for place in now
        if place not in kept.digests
    ]
    return ", ".join(words)


def difference(copy: Copy, kept: Kept, part: Part) -> str:
    """Return a unified difference from the copy to what is there now, not longer than `LINES` lines.

    Raises InputError when the copy itself was changed.
    """
    lines: list[str] = []
    for place in sorted({*kept.digests, *part.files}):
        old = copy.read(kept, place) if place in kept.digests else b""
        source = part.files.get(place)
        new = b"" if source is None else source.data
        if old == new:
            continue
        before = str(near(copy.folder / kept.name / place)) if place in kept.digests else os.devnull
        after = os.devnull if source is None else str(near(source.origin))
        lines += _unified(old, new, before, after)
    more = len(lines) - LINES
    if more > 0:
        lines = [*lines[:LINES], f".. and {more} more lines"]
    return "\n".join(lines)


def _unified(old: bytes, new: bytes, before: str, after: str) -> list[str]:
    try:
        texts = old.decode().splitlines(), new.decode().splitlines()
    except UnicodeDecodeError:
        return [f"binary files {before} and {after} differ"]
    found = [_printable(line) for line in difflib.unified_diff(*texts, before, after, lineterm="")]
    return found or [f"{before} and {after} differ in the ends of their lines"]


def _printable(line: str) -> str:
    """Return a line without terminal control characters: the copy may come from anywhere."""
    clean = "".join(sign if sign.isprintable() or sign == "\t" else "\ufffd" for sign in line)
    return clean if len(clean) <= _SHOWN_CHARACTERS else f"{clean[:_SHOWN_CHARACTERS]} .."


def near(path: Path) -> Path:
    """Return a path relative to the working folder where it lies in there."""
    here = Path.cwd()
    return path.relative_to(here) if path.is_relative_to(here) else path


def copy_is_used(copy: Copy, kept: Kept, now: Part, hint: str = "") -> None:
    """Say once that the simulation is the run's copy, as what it was copied from has changed.

    hint: what else can be done, from its semicolon on; where it differs, the warning is the same.
    """
    text = f"{near(copy.run.absolute())}: {summary(kept, now)} since; the copy in the run is used"
    warn_once(f"{text}{hint}", key=text)
