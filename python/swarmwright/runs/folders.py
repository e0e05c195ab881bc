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
"""The folder of runs, in the current one."""

_OURS = (
    "run.sqlite",
    "run.sqlite-wal",
    "run.sqlite-shm",
    "run.sqlite-journal",
    "run.sqlite.new",
    "run.lock",
    "experiment.yaml",
    "best.json",
    "best.json.new",
    "fitness.png",
    "plot.png",
    "controller.png",
    "servers.log",
    "servers.log.1",
)
"""Files that a run writes into its folder."""


def check_names(experiment: Experiment) -> None:
    """Raise InputError where a name in an experiment, or that of its file, cannot be written as UTF-8."""
    check_utf8("" if experiment.path is None else experiment.path.stem)
    check_utf8(json.dumps(experiment.to_mapping(), ensure_ascii=False, default=str))


def default_folder(experiment: Experiment) -> Path:
    """Make runs/<file stem or simulation>-<seed>, with a number appended if that exists, and return it.

    That it is made here gives every process and thread its own. Raises InputError when it cannot be made.
    """
    name = experiment.path.stem if experiment.path is not None else experiment.label
    safe = (
        "".join(sign if sign.isalnum() or sign in "-_." else "_" for sign in name).lstrip(".")[:100] or "run"
    )
    base = RUNS / f"{safe}-{experiment.seed}"
    folder, number = base, 1
    try:
        RUNS.mkdir(exist_ok=True)
        while not _make_folder(folder):
            number += 1
            folder = base.with_name(f"{base.name}-{number}")
    except OSError as error:
        raise InputError(f"{error.filename}: cannot be created: {error.strerror}") from error
    return folder


def _make_folder(folder: Path) -> bool:
    """Make a folder; return False when there is something of its name."""
    try:
        folder.mkdir()
    except FileExistsError:
        return False
    return True


def is_run(folder: Path) -> bool:
    """Whether a run has begun in this folder."""
    return (folder / FILE).exists()


def is_replaceable(folder: Path) -> bool:
    """Whether a folder holds nothing but a run without a finished generation, on which no process works."""
    # InputError: of a store that is damaged, or of another version; OSError: of a path that cannot be used.
    with suppress(InputError, OSError):
        return (
            is_run(folder)
            and not is_locked(folder)
            and all(map(_is_of_a_run, folder.iterdir()))
            and not StoreReader(folder).history()
        )
    return False


def _is_of_a_run(entry: Path) -> bool:
    """Whether `remove_run` would delete what is in a run folder."""
    if entry.name == FOLDER:
        return contains_only_copies(entry.parent)
    return entry.name in _OURS and not entry.is_dir()


def remove_run(folder: Path) -> list[str]:
    """Delete what a run wrote; return the names of what else is in the folder, which stays."""
    remove(folder)
    for name in _OURS:
        (folder / name).unlink(missing_ok=True)
    left = sorted(entry.name for entry in folder.iterdir())
    if not left:
        folder.rmdir()
    return left
