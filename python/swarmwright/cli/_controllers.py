"""Controllers named on the command line."""

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from swarmwright import Controller


def load_controller(path: Path) -> "Controller":
    """A controller from its file, or the best one of a run folder."""
    from swarmwright import Controller, Run

    return Run.open(path).best.controller if path.is_dir() else Controller.load(path)
