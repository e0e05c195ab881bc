"""Where results go when nothing is said."""

from pathlib import Path

from swarmwright._experiment import Experiment

RUNS = Path("runs")
"""The folder of runs, in the current one."""


def default_folder(experiment: Experiment) -> Path:
    """Return runs/<file stem or simulation>-<seed>, with a number behind it when that exists."""
    name = experiment.path.stem if experiment.path is not None else experiment.label
    safe = (
        "".join(sign if sign.isalnum() or sign in "-_." else "_" for sign in name).lstrip(".")[:100] or "run"
    )
    base = RUNS / f"{safe}-{experiment.seed}"
    folder, number = base, 1
    while folder.exists():
        number += 1
        folder = base.with_name(f"{base.name}-{number}")
    return folder
