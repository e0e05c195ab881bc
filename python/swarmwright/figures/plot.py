"""The fitness plot of a run."""

import io
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from swarmwright.core.errors import InputError
from swarmwright.figures.chart import Chart, Curve, prepare

if TYPE_CHECKING:
    from PIL.Image import Image

    from swarmwright.runs.run import Run

__all__ = ["draw", "png", "prepare"]

_BEST, _MEAN = "#0b6e4f", "#c8553d"


def draw(run: "Run", path: Path) -> None:
    """Draw best, mean and the middle half of the population over the generations; write a PNG.

    Raises InputError when the run has no generation or the file cannot be written.
    """
    try:
        _picture(run).save(path, format="png", compress_level=3)
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror}") from error


def png(run: "Run") -> bytes:
    """Return what `draw` writes. Raises InputError when the run has no generation."""
    buffer = io.BytesIO()
    _picture(run).save(buffer, format="png")
    return buffer.getvalue()


def _picture(run: "Run") -> "Image":
    history = run.history
    if not history:
        raise InputError(f"{run.path}: holds no finished generation to draw")
    experiment, best = run.experiment, run.best
    method: str = experiment.method.kind  # type: ignore[attr-defined] # every kind's options have it
    quartiles = [
        np.array([one.lower_quartile for one in history]),
        np.array([one.upper_quartile for one in history]),
    ]
    chart = Chart(
        title=f"{experiment.label}: {method} evolves a {experiment.controller.kind} controller",
        subtitle=(
            f"{run.evaluations:,} evaluations in {run.generations:,} generations, seed {experiment.seed}"
        ),
        x_name="generation (from 0)",
        y_name="fitness (more is better)",
        x=np.array([one.generation for one in history], dtype=np.float64),
        curves=[
            Curve(name="middle half of the population", color=_MEAN, y=quartiles[0], until=quartiles[1]),
            Curve(name="mean", color=_MEAN, y=np.array([one.mean for one in history])),
            Curve(
                name="best so far",
                color=_BEST,
                y=np.array([one.best_so_far for one in history]),
                width=5,
                step=True,
            ),
        ],
        mark=(best.generation, best.fitness, f"{best.fitness:.4g}".replace("-", "−"), _BEST),
    )
    return chart.draw()
