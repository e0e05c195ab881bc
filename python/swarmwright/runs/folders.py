"""The default folder for results, and the files that Swarmwright writes into a run folder."""

from pathlib import Path

from swarmwright.core.errors import InputError
from swarmwright.experiment.experiment import Experiment
from swarmwright.store import FILE
from swarmwright.user_code.copying import remove

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
)
"""Files that a run writes into its folder."""


def default_folder(experiment: Experiment) -> Path:
    """Make runs/<file stem or simulation>-<seed>, with a number behind it when that exists, and return it.

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
        while not _made(folder):
            number += 1
            folder = base.with_name(f"{base.name}-{number}")
    except OSError as error:
        raise InputError(f"{error.filename}: cannot be created: {error.strerror}") from error
    return folder


def _made(folder: Path) -> bool:
    """Make a folder; return False when there is something of its name."""
    try:
        folder.mkdir()
    except FileExistsError:
        return False
    return True


def is_run(folder: Path) -> bool:
    """Whether a run has begun in this folder."""
    return (folder / FILE).exists()


def remove_run(folder: Path) -> list[str]:
    """Delete what a run wrote; return the names of what else is in the folder, which stays."""
    remove(folder)
    for name in _OURS:
        (folder / name).unlink(missing_ok=True)
    left = sorted(entry.name for entry in folder.iterdir())
    if not left:
        folder.rmdir()
    return left
