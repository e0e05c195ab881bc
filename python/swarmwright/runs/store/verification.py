"""Verification of a run folder against its digests, generation by generation, however much is damaged."""

import sqlite3
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from swarmwright.common.errors import InputError, SwarmwrightError
from swarmwright.runs.store.database import FILE, DamageError, FormatError, StoreError, checked_facts, reading
from swarmwright.runs.store.folder import without_store
from swarmwright.runs.store.generations import (
    MISSING,
    ROW_DISAGREES,
    Generations,
    Row,
    digest_before,
)
from swarmwright.simulations.user_code.copying import Copy

_CODE = "code."
_UNREADABLE = (SwarmwrightError, sqlite3.Error, ValueError, TypeError, OverflowError)


@dataclass
class Problem:
    """Something that is damaged."""

    what: str
    generations: list[int] = field(default_factory=list)
    """In which it is; empty for what belongs to none."""


@dataclass
class Verified:
    """What was found in a run folder."""

    good: list[int] = field(default_factory=list)
    """Generations that are what was written."""
    evaluations: int = 0
    """In these."""
    problems: list[Problem] = field(default_factory=list)
    """What is damaged; empty when nothing is."""
    not_compared: list[str] = field(default_factory=list)
    """What there was nothing to compare with, in words with the reason."""

    def add(self, what: str, generation: int | None = None) -> None:
        """Note what is damaged."""
        last = self.problems[-1] if self.problems else None
        if last is None or last.what != what or generation is None:
            last = Problem(what)
            self.problems.append(last)
        last.generations += [] if generation is None else [generation]


def verify(folder: Path) -> Verified:
    """Compare everything in a run folder that has a digest.

    Raises InputError when there is no run, its files cannot be read, or another version of Swarmwright has
    written them in a format that this one does not read: none of these says anything of their content.
    """
    file = folder / FILE
    if not file.is_file():
        raise without_store(folder)
    try:
        file.open("rb").close()
    except OSError as error:
        raise InputError(f"{file}: cannot be read, so it was not verified: {error.strerror}") from error
    found = Verified()
    try:
        with reading(file) as connection:
            _structure(connection, found)
            facts = _facts(connection, file, found)
            generations = Generations(connection, file)
            _generations(connection, generations, found)
    except FormatError:
        raise
    except InputError as error:
        found.add(_words(error))
        return found
    for version, digest in facts.items():
        if version.startswith(_CODE):
            _try(found, lambda version=version, digest=digest: _code(folder, version, digest))  # type: ignore[misc]
    return found


def _structure(connection: sqlite3.Connection, found: Verified) -> None:
    """Let SQLite look through its file, tables of the journal included."""
    try:
        lines = [line for (line,) in connection.execute("PRAGMA integrity_check(5)")]
    except sqlite3.Error as error:
        lines = [str(error)]
    for line in lines:
        if line != "ok":
            found.add(f"SQLite says: {line}")


def _facts(connection: sqlite3.Connection, file: Path, found: Verified) -> dict[str, str]:
    try:
        facts = checked_facts(connection, file)
    except _UNREADABLE as error:
        found.add(_words(error))
        return {}
    return facts


def _generations(connection: sqlite3.Connection, generations: Generations, found: Verified) -> None:
    (last,) = connection.execute("SELECT max(generation) FROM generation").fetchone()
    row, before = None, ""  # the digest of the generation before, as it ought to be
    for number in range(0 if last is None else int(last) + 1):
        try:
            row = _row(generations, number)
            # What is written of the one before may itself be what is damaged.
            wanted = [
                generations.expected(row, predecessor)
                for predecessor in (before, digest_before(connection, number))
            ]
            before = row.digest if row.digest in wanted else wanted[0]
            if row.digest not in wanted:
                raise generations.damaged(ROW_DISAGREES, number)
            for _ in generations.evaluations(row, made=False):
                pass
        except _UNREADABLE as error:
            found.add(_words(error), number)
            continue
        found.good.append(number)
        found.evaluations += row.count
    try:
        generations.check_end(row)
    except DamageError as error:
        found.add(error.what)


def _row(generations: Generations, number: int) -> Row:
    rows = generations.select("WHERE generation = ?", number)
    if not rows:
        raise generations.damaged(MISSING, number)
    return rows[0]


def _code(folder: Path, version: str, digest: str) -> None:
    """Compare a copy of the source, if it was not deleted."""
    copy = Copy.find(folder, int(version.removeprefix(_CODE)))
    if copy is None:
        return
    if copy.digest != digest:
        raise InputError(f"{copy.folder}: its manifest is not what was written")
    for kept in copy.parts.values():
        for place in kept.digests:
            copy.read(kept, place)


def _try(found: Verified, check: Callable[[], None]) -> None:
    try:
        check()
    except _UNREADABLE as error:
        found.add(str(error))


def _words(error: Exception) -> str:
    """Return what is wrong, without the file's name and without advice to do what is being done."""
    return error.what if isinstance(error, StoreError) else str(error)
