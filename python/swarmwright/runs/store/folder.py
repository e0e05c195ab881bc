"""Run folders without a store: whether a run may be created there, and why a folder is not a run."""

import os
import shlex
from pathlib import Path

from swarmwright.common.errors import InputError
from swarmwright.common.files import check_utf8
from swarmwright.runs.store.database import FILE, NEW
from swarmwright.runs.store.lock import LOCK, is_locked, who_else
from swarmwright.simulations.user_code.copying import FOLDER as CODE

EXPERIMENT = "experiment.yaml"
SWEEP = "sweep.json"
"""What a sweep writes into the folder of its runs."""
_LONGEST_PATH = 504
"""Bytes: SQLite's 512, less those of `-journal`."""


def check_folder(folder: Path) -> None:
    """Raise InputError unless `folder` is new or empty: results are never written over.

    A folder whose process ended before there was a store counts as empty.
    """
    check_utf8(str(folder))
    length = len(os.fsencode(folder.resolve() / NEW))
    if length > _LONGEST_PATH:
        raise InputError(
            f"{folder}: its path is too long: SQLite opens files with at most {_LONGEST_PATH} bytes of path, "
            f"and the store in it would have {length}; name a folder with a shorter path"
        )
    try:
        if folder.exists() and not folder.is_dir():
            raise InputError(f"{folder}: is a file; name a folder for the results")
        if (folder / FILE).exists():
            raise InputError(
                f"{folder}: holds a run already, and results are never written over; name another folder, "
                f"or resume that run: swarmwright resume {shlex.quote(str(folder))}"
            )
        if folder.is_dir() and not _broken_off(folder) and any(folder.iterdir()):
            raise InputError(
                f"{folder}: is not empty, and results are never written over; name another folder"
            )
        parent = next(above for above in (folder, *folder.absolute().parents) if above.exists())
    except OSError as error:
        raise InputError(f"{folder}: cannot be used for results: {error.strerror}") from error
    if not parent.is_dir():
        raise InputError(f"{folder}: cannot be created: {parent} is a file")
    if not os.access(parent, os.W_OK | os.X_OK):
        raise InputError(
            f"{folder}: cannot be created: {parent} may not be written by this user, or is on a read-only "
            "file system"
        )


def check_sweep_folder(folder: Path, where: str) -> None:
    """Raise InputError where the runs of a sweep cannot be in a folder: it is a file, or a run itself.

    where: what precedes the folder in the message.
    """
    if (folder / FILE).is_file():
        raise InputError(
            f"{where}{folder}: is the folder of a run; name another one for the runs of the sweep"
        )
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{where}{folder}: is a file; name a folder for the runs of the sweep")


def _broken_off(folder: Path) -> bool:
    """Whether a process began to make a run folder and ended before there was a store.

    Raises InputError when that process is still running.
    """
    names = {entry.name for entry in folder.iterdir()}
    if NEW not in names or not names <= {NEW, LOCK, EXPERIMENT, CODE}:
        return False
    if is_locked(folder):
        raise without_store(folder)
    return True


def find_store(folder: Path) -> Path:
    """Return a run folder that holds a store. Raises InputError for all others, with what is wrong."""
    if not folder.is_dir():
        what = "is not a folder" if folder.exists() else "there is no such folder"
        raise InputError(f"{folder}: {what}; name a run folder such as runs/minisim-1")
    if not (folder / FILE).is_file():
        raise without_store(folder)
    return folder


def without_store(folder: Path) -> InputError:
    """Return what is said of a folder in which there is no store."""
    if (folder / NEW).exists():
        if is_locked(folder):
            return InputError(
                f"{folder}: {who_else(folder)} is just beginning a run here; name another folder for another "
                "run, or wait a moment to look at this one"
            )
        return InputError(
            f"{folder}: is not a run folder: the process that began it ended in its first second, before "
            f"anything was kept; begin again: swarmwright optimize FILE --out {folder}"
        )
    if (folder / SWEEP).is_file():
        return InputError(
            f"{folder}: is the folder of a sweep, not of a run; name one of its runs, which are folders in it"
        )
    older = (folder / "record.csv").exists() and (folder / "generations.csv").exists()
    hint = "; it was written by Swarmwright 0.0, which this version does not read" if older else ""
    return InputError(f"{folder}: is not a run folder: {FILE} is missing{hint}")
