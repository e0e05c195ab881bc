"""Folders of sweeps and their runs, from the record `sweep.json`."""

import logging
import os
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from swarmwright.analysis.episodes import LeftOut
from swarmwright.common.arguments import path_of, require_list
from swarmwright.common.errors import InputError
from swarmwright.common.files import read_contents
from swarmwright.common.json_text import loads
from swarmwright.runs.run import Run
from swarmwright.runs.store import FILE as STORE
from swarmwright.runs.store.folder import SWEEP

WRITTEN = {SWEEP, "comparison.csv", "comparison.tex", "comparison.png"}
"""Files that a sweep writes into its folder."""


def runs_of(folder: Path) -> list[Path] | None:
    """Return the folders of a sweep's runs, whether they exist or not, in the order of the variants.

    None if the folder has no record of a sweep, or is a run. Raises InputError if it cannot be read.
    """
    file = folder / SWEEP
    if not file.is_file() or (folder / STORE).exists():
        return None
    try:
        names = [names_of(variant["runs"]) for variant in loads(read_contents(file))["variants"]]
    except (ValueError, KeyError, TypeError) as error:
        raise no_record(file) from error
    return [folder / name for members in names for name in members]


def keys_of_grid(runs: Sequence[Run]) -> list[tuple[str, ...]] | None:
    """Return the keys that the grid of a sweep sets in each of its runs, in the grid's order.

    None if the runs are not all from one sweep, or its record is damaged, which `runs_of` reports.
    """
    places = [run.path.resolve() for run in runs]
    file = places[0].parent / SWEEP
    if any(parent.parent != file.parent for parent in places) or not file.is_file():
        return None
    try:
        keys = {
            name: tuple(map(str, variant["keys"]))
            for variant in loads(read_contents(file))["variants"]
            for name in names_of(variant["runs"])
        }
        return [keys[parent.name] for parent in places]
    except (InputError, ValueError, KeyError, TypeError):
        return None


def no_record(file: Path) -> InputError:
    """Return the error for a file that should be the record of a sweep but is not."""
    return InputError(f"{file}: is not the record of a sweep; delete it, and the same sweep writes it again")


def names_of(runs: Any) -> list[str]:  # noqa: ANN401 - whatever the file says
    """Return the names of a variant's folders. Raises ValueError if these are not folder names."""
    if not isinstance(runs, list) or not all(isinstance(name, str) for name in runs):
        raise ValueError("runs: not a list of names")
    wrong = [name for name in runs if name in {"", ".", ".."} or "\0" in name or set(name) & {"/", "\\"}]
    if wrong:
        raise ValueError(f"runs: {wrong[0]!r} is not the name of a folder beside the record")
    return runs


def expand_folders(folders: Iterable[Path]) -> tuple[list[Path], list[Path]]:
    """Return the folders, with each sweep replaced by its runs, and the missing runs of sweeps.

    Raises InputError if the record of a sweep cannot be read.
    """
    paths: list[Path] = []
    missing: list[Path] = []
    for folder in folders:
        runs = runs_of(folder)
        for run in [folder] if runs is None else runs:
            (paths if runs is None or run.exists() else missing).append(run)
    return paths, missing


def missing_words(missing: list[Path]) -> str:
    """Describe the missing runs of sweeps."""
    named = ", ".join(map(str, missing[:3]))
    more = f" and {len(missing) - 3} more" if len(missing) > 3 else ""
    return f"{named}{more}: missing; the same sweep runs {'it' if len(missing) == 1 else 'them'}"


def exclude_missing(folders: Iterable[Path]) -> list[LeftOut]:
    """Return the missing runs of sweeps as excluded runs."""
    return [LeftOut(folder, "missing", "missing; the same sweep runs it") for folder in folders]


def exclude_unreadable(folder: Path, error: InputError) -> LeftOut:
    """Return an unreadable run as an excluded run."""
    return LeftOut(folder, "unreadable", str(error).removeprefix(f"{folder}: "))


def variant_of(folder: Path) -> tuple[str, list[Path]] | None:
    """Return the label of the sweep variant that a run belongs to, and the folders of its runs.

    None if no sweep names it, or the record cannot be read.
    """
    file = folder.parent / SWEEP
    try:
        if not file.is_file():
            return None
        for variant in loads(read_contents(file))["variants"]:
            names = names_of(variant["runs"])
            if folder.name in names:
                return str(variant["label"]), [file.parent / name for name in names]
    except (InputError, ValueError, KeyError, TypeError):
        pass
    return None


def runs_of_all(
    runs: Iterable[Run | str | os.PathLike[str]] | str | os.PathLike[str],
) -> tuple[list[Run], list[LeftOut]]:
    """Return runs, given as objects, their folders, or folders of sweeps; and excluded runs.

    Missing and unreadable runs of a sweep are excluded. A warning names them, and files that are not a
    sweep's. Raises InputError if a folder is neither a run nor a sweep, or the record of a sweep cannot be
    read.
    """
    if isinstance(runs, str | os.PathLike):
        if runs_of(path_of("runs", runs, "a folder")) is None:
            require_list("runs", runs, "run folders")  # raises an error, since a single run is not a list
        runs = [runs]
    require_list("runs", runs, "run folders")
    paths = [run if isinstance(run, Run) else path_of("runs", run, "a run folder") for run in runs]
    files = [source for source in paths if isinstance(source, Path) and source.is_file()]
    opened: list[Run] = []
    missing: list[Path] = []
    unreadable: list[LeftOut] = []
    for source in paths:
        if isinstance(source, Run):
            opened.append(source)
        elif source not in files:
            _open(source, opened, missing, unreadable)
    if files and not opened:
        raise InputError(f"{files[0]}: is not a folder; specify a run folder such as runs/minisim-1")
    if missing and not opened:
        raise InputError(missing_words(missing))
    if unreadable and not opened:
        raise InputError(f"{unreadable[0].path}: {unreadable[0].reason}")
    for words in (
        *(f"{path}: is a file, not a run folder" for path in files if not is_of_sweep(path)),
        *([missing_words(missing)] if missing else []),
        *(f"{left_out_run.path}: {left_out_run.reason}" for left_out_run in unreadable),
    ):
        logging.getLogger("swarmwright").warning("left out: %s", words)
    return opened, [*exclude_missing(missing), *unreadable]


def _open(folder: Path, runs: list[Run], missing: list[Path], unreadable: list[LeftOut]) -> None:
    """Open a run, or the runs of a sweep, and collect those that cannot be opened."""
    answered = runs_of(folder)
    for run in [folder] if answered is None else answered:
        if answered is not None and not run.exists():
            missing.append(run)
            continue
        try:
            runs.append(Run.open(run))
        except InputError as error:
            if answered is None:
                raise
            unreadable.append(exclude_unreadable(run, error))


def is_of_sweep(path: Path) -> bool:
    """Return whether a file is one that a sweep writes into its folder."""
    return path.name in WRITTEN and (path.parent / SWEEP).is_file()
