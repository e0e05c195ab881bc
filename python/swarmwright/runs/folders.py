"""The default folder for results, and the files that Swarmwright writes into a run folder."""

import json
from contextlib import suppress
from pathlib import Path

from swarmwright.common.errors import InputError
from swarmwright.common.files import check_utf8
from swarmwright.experiment.experiment import Experiment
from swarmwright.runs.store import FILE, StoreReader
from swarmwright.runs.store.lock import is_locked
from swarmwright.simulations.user_code.copying import FOLDER, contains_only_copies, remove

RUNS = Path("runs")
"""Default folder of runs, in the working directory."""

_OURS = (
    "run.sqlite",
    "run.sqlite-wal",
    "run.sqlite-shm",
    "run.sqlite-journal",
    "run.sqlite.new",
    "run.lock",
    "experiment.yaml",
    "best.json",
    "notes.json",
    "best.json.new",
    "fitness.png",
    "plot.png",
    "controller.png",
    "servers.log",
    "servers.log.1",
)
"""Files that a run writes into its folder."""


def check_names(experiment: Experiment) -> None:
    """Raise InputError if a name in an experiment, or that of its file, cannot be written as UTF-8."""
    check_utf8("" if experiment.path is None else experiment.path.stem)
    check_utf8(json.dumps(experiment.to_mapping(), ensure_ascii=False, default=str))


def default_folder(experiment: Experiment) -> Path:
    """Create runs/<file stem or simulation>-<seed>, with a number appended if it exists, and return it.

    Creating it here gives each process and thread its own folder. Raises InputError when that fails.
    """
    name = experiment.path.stem if experiment.path is not None else experiment.label
    safe = (
        "".join(sign if sign.isalnum() or sign in "-_." else "_" for sign in name).lstrip(".")[:100] or "run"
    )
    base = RUNS / f"{safe}-{experiment.seed}"
    folder, number = base, 1
    try:
        RUNS.mkdir(exist_ok=True)
        while True:
            try:
                folder.mkdir()
            except FileExistsError:
                number += 1
                folder = base.with_name(f"{base.name}-{number}")
            else:
                return folder
    except OSError as error:
        raise InputError(f"{error.filename}: cannot be created: {error.strerror}") from error


def is_run(folder: Path) -> bool:
    """Return whether a run has begun in this folder."""
    return (folder / FILE).exists()


def is_replaceable(folder: Path) -> bool:
    """Return whether a folder holds only a run without a finished generation that no process works on."""
    # InputError: a store that is damaged, or of another version; OSError: an unusable path.
    with suppress(InputError, OSError):
        return (
            is_run(folder)
            and not is_locked(folder)
            and all(map(_is_removable, folder.iterdir()))
            and not StoreReader(folder).history()
        )
    return False


def _is_removable(entry: Path) -> bool:
    """Return whether `remove_run` would delete an entry of a run folder."""
    if entry.name == FOLDER:
        return contains_only_copies(entry.parent)
    return entry.name in _OURS and not entry.is_dir()


def remove_run(folder: Path) -> list[str]:
    """Delete the files of a run; return the names of other files in the folder, which are kept."""
    remove(folder)
    for name in _OURS:
        (folder / name).unlink(missing_ok=True)
    remaining = sorted(entry.name for entry in folder.iterdir())
    if not remaining:
        folder.rmdir()
    return remaining
