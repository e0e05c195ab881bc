"""The callback for TensorBoard, which writes event files for `tensorboard --logdir`."""

from os import PathLike
from typing import TYPE_CHECKING, Any

import numpy as np

from swarmwright.common.arguments import path_of
from swarmwright.common.errors import InputError
from swarmwright.common.yaml import dump
from swarmwright.runs.callbacks._base import Callback, figures, get_held_out_figures

if TYPE_CHECKING:
    from swarmwright.experiment.experiment import Experiment
    from swarmwright.runs.optimization.generation import Generation
    from swarmwright.runs.run import Run


def require_writer() -> Any:  # noqa: ANN401 - tensorboardX has no types
    """Return the class that writes event files. Raises InputError when tensorboardX is not installed."""
    try:
        from tensorboardX import SummaryWriter
    except ImportError:
        raise InputError(
            "TensorBoard: tensorboardX is not installed: pip install 'swarmwright[tensorboard]'"
        ) from None
    return SummaryWriter


class TensorBoard(Callback):
    """Writes the figures of each generation for TensorBoard, a point per generation.

    Args:
        folder: for the event file; created if it does not exist. Use a folder per run inside the one passed
            to `tensorboard --logdir` to see runs side by side.
        experiment: displayed as text.

    Raises:
        InputError: tensorboardX is not installed, or the folder cannot be written.
    """

    def __init__(self, folder: str | PathLike[str], experiment: "Experiment | None" = None) -> None:
        path = path_of("folder", folder, "a folder for event files")
        try:
            self._writer = require_writer()(str(path))
        except OSError as error:
            raise InputError(f"{path}: cannot be written: {error.strerror}") from error
        except ImportError as error:  # s3:// and gs:// need further packages
            raise InputError(f"{folder}: cannot be written: {error}") from error
        if experiment is not None:
            lines = dump(experiment.to_mapping()).splitlines()
            self._writer.add_text("experiment", "\n".join(f"    {line}" for line in lines))

    def __call__(self, generation: "Generation") -> None:
        """Add a point to each curve."""
        for name, value in figures(generation).items():
            self._writer.add_scalar(name, value, generation.generation)

    def conclude(self, run: "Run") -> None:
        """Add a histogram of the last generation's fitness, and the fitness on held-out seeds."""
        if run.generations:
            for name, value in get_held_out_figures(run).items():
                self._writer.add_scalar(name, value, run.generations - 1)
            last = run.record.fitness[run.record.generation == run.generations - 1]
            last = last[np.isfinite(last)]
            if len(last):
                self._writer.add_histogram("fitness/last_generation", last, run.generations - 1)

    def close(self) -> None:
        """Write the remaining figures."""
        self._writer.close()
