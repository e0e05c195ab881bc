"""Verify a run folder against its digests, generation by generation, and report all damage."""

import sqlite3
from dataclasses import dataclass, field
from pathlib import Path

from swarmwright.common.errors import InputError, SwarmwrightError
from swarmwright.runs.store.database import FILE, DamageError, FormatError, StoreError, read_facts, reading
from swarmwright.runs.store.folder import build_missing_store_error
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
    """A damaged part of a run folder."""

    message: str
    generations: list[int] = field(default_factory=list)
    """The affected generations; empty if the damage belongs to none."""


@dataclass
class Verification:
    """The result of verifying a run folder."""

    good: list[int] = field(default_factory=list)
    """Undamaged generations."""
    evaluations: int = 0
    """Number of evaluations in the undamaged generations."""
    problems: list[Problem] = field(default_factory=list)
    """All damage; empty if there is none."""
    not_compared: list[str] = field(default_factory=list)
    """Descriptions of parts that could not be compared, with the reason."""

    def add(self, message: str, generation: int | None = None) -> None:
        """Add a damaged part."""
        last = self.problems[-1] if self.problems else None
        if last is None or last.message != message or generation is None:
            last = Problem(message)
            self.problems.append(last)
        last.generations += [] if generation is None else [generation]


def verify(folder: Path) -> Verification:
    """Compare everything in a run folder that has a digest.

    Raises InputError when there is no run, its files cannot be read, or another version of Swarmwright wrote
    them in an unsupported format; the content may be intact in these cases.
    """
    file = folder / FILE
    if not file.is_file():
        raise build_missing_store_error(folder)
    try:
        file.open("rb").close()
    except OSError as error:
        raise InputError(f"{file}: cannot be read, so it was not verified: {error.strerror}") from error
    result = Verification()
    try:
        with reading(file) as connection:
            _verify_structure(connection, result)
            facts = _verify_facts(connection, file, result)
            generations = Generations(connection, file)
            _verify_generations(connection, generations, result)
    except FormatError:
        raise
    except InputError as error:
        result.add(_get_reason(error))
        return result
    for version, digest in facts.items():
        if version.startswith(_CODE):
            try:
                _verify_code(folder, version, digest)
            except _UNREADABLE as error:
                result.add(str(error))
    return result


def _verify_structure(connection: sqlite3.Connection, result: Verification) -> None:
    """Let SQLite check its file, including the tables of the journal."""
    try:
        lines = [line for (line,) in connection.execute("PRAGMA integrity_check(5)")]
    except sqlite3.Error as error:
        lines = [str(error)]
    for line in lines:
        if line != "ok":
            result.add(f"SQLite reports: {line}")


def _verify_facts(connection: sqlite3.Connection, file: Path, result: Verification) -> dict[str, str]:
    try:
        facts = read_facts(connection, file)
    except _UNREADABLE as error:
        result.add(_get_reason(error))
        return {}
    return facts


def _verify_generations(
    connection: sqlite3.Connection, generations: Generations, result: Verification
) -> None:
    (last,) = connection.execute("SELECT max(generation) FROM generation").fetchone()
    row, before = None, ""  # the correct digest of the previous generation
    for number in range(0 if last is None else int(last) + 1):
        try:
            row = _select_row(generations, number)
            # The stored digest of the previous generation may itself be damaged.
            candidates = [
                generations.compute_digest(row, predecessor)
                for predecessor in (before, digest_before(connection, number))
            ]
            before = row.digest if row.digest in candidates else candidates[0]
            if row.digest not in candidates:
                raise generations.build_damage_error(ROW_DISAGREES, number)
            for _ in generations.evaluations(row, make_genomes=False):
                pass
        except _UNREADABLE as error:
            result.add(_get_reason(error), number)
            continue
        result.good.append(number)
        result.evaluations += row.count
    try:
        generations.check_end(row)
    except DamageError as error:
        result.add(error.reason)


def _select_row(generations: Generations, number: int) -> Row:
    rows = generations.select("WHERE generation = ?", number)
    if not rows:
        raise generations.build_damage_error(MISSING, number)
    return rows[0]


def _verify_code(folder: Path, version: str, digest: str) -> None:
    """Compare a copy of the source, if it was not deleted."""
    copy = Copy.find(folder, int(version.removeprefix(_CODE)))
    if copy is None:
        return
    if copy.digest != digest:
        raise InputError(f"{copy.folder}: the manifest does not match its digest")
    for part in copy.parts.values():
        for path in part.digests:
            copy.read(part, path)


def _get_reason(error: Exception) -> str:
    """Return the reason of an error, without the file's name and the advice to verify the run."""
    return error.reason if isinstance(error, StoreError) else str(error)
