"""Checks of run folders: whether a run can be created there, and why a folder is not a run."""

import os
import shlex
from pathlib import Path

from swarmwright.common.errors import InputError
from swarmwright.common.files import check_utf8
from swarmwright.runs.store.database import FILE, NEW
from swarmwright.runs.store.lock import LOCK, describe_owner, is_locked
from swarmwright.simulations.user_code.copying import FOLDER as CODE

EXPERIMENT = "experiment.yaml"
SWEEP = "sweep.json"
"""Name of the file that marks the folder of a sweep."""
_LONGEST_PATH_BYTES = 504
"""SQLite's limit of 512 bytes, less `-journal`."""


def check_folder(folder: Path) -> None:
    """Raise InputError unless `folder` is new or empty, since results are never overwritten.

    A folder whose process was killed before it had a store counts as empty.
    """
    check_utf8(str(folder))
    length = len(os.fsencode(folder.resolve() / NEW))
    if length > _LONGEST_PATH_BYTES:
        raise InputError(
            f"{folder}: the path is too long: the path of its store would have {length} bytes, but SQLite "
            f"supports at most {_LONGEST_PATH_BYTES}; choose a folder with a shorter path"
        )
    try:
        if folder.exists() and not folder.is_dir():
            raise InputError(f"{folder}: is a file; choose a folder for the results")
        if (folder / FILE).exists():
            raise InputError(
                f"{folder}: already holds a run, and results are never overwritten; choose another folder, "
                f"or resume that run: swarmwright resume {shlex.quote(str(folder))}"
            )
        if folder.is_dir() and not _is_aborted_start(folder) and any(folder.iterdir()):
            raise InputError(
                f"{folder}: is not empty, and results are never overwritten; choose another folder"
            )
        parent = next(above for above in (folder, *folder.absolute().parents) if above.exists())
    except OSError as error:
        raise InputError(f"{folder}: cannot be used for results: {error.strerror}") from error
    if not parent.is_dir():
        raise InputError(f"{folder}: cannot be created: {parent} is a file")
    if not os.access(parent, os.W_OK | os.X_OK):
        raise InputError(
            f"{folder}: cannot be created: {parent} is not writable by this user, or is on a read-only file "
            "system"
        )


def check_sweep_folder(folder: Path, where: str) -> None:
    """Raise InputError if a folder cannot hold the runs of a sweep: it is a file, or a run itself.

    where: precedes the folder in the message.
    """
    if (folder / FILE).is_file():
        raise InputError(f"{where}{folder}: is a run folder; choose another folder for the runs of the sweep")
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{where}{folder}: is a file; choose a folder for the runs of the sweep")


def _is_aborted_start(folder: Path) -> bool:
    """Return whether a process began to create a run folder and was killed before it had a store.

    Raises InputError when that process is still running.
    """
    names = {entry.name for entry in folder.iterdir()}
    if NEW not in names or not names <= {NEW, LOCK, EXPERIMENT, CODE}:
        return False
    if is_locked(folder):
        raise build_missing_store_error(folder)
    return True


def find_store(folder: Path) -> Path:
    """Return a run folder that holds a store. Raises InputError with the problem of any other folder."""
    if not folder.is_dir():
        problem = "is not a folder" if folder.exists() else "does not exist"
        raise InputError(f"{folder}: {problem}; specify a run folder such as runs/minisim-1")
    if not (folder / FILE).is_file():
        raise build_missing_store_error(folder)
    return folder


def build_missing_store_error(folder: Path) -> InputError:
    """Create the error for a folder without a store."""
    if (folder / NEW).exists():
        if is_locked(folder):
            return InputError(
                f"{folder}: {describe_owner(folder)} is just starting a run in this folder; choose another "
                "folder for a new run, or wait a moment to read this one"
            )
        return InputError(
            f"{folder}: is not a run folder: its process ended within the first second, before anything was "
            f"stored; start again: swarmwright optimize FILE --out {folder}"
        )
    if (folder / SWEEP).is_file():
        return InputError(
            f"{folder}: is the folder of a sweep, not of a run; specify one of the run folders in it"
        )
    older = (folder / "record.csv").exists() and (folder / "generations.csv").exists()
    hint = "; it was written by Swarmwright 0.0, which this version does not read" if older else ""
    return InputError(f"{folder}: is not a run folder: {FILE} is missing{hint}")
