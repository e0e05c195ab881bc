"""The figure of a learning curve."""

from typing import TYPE_CHECKING

import numpy as np

from swarmwright.common.formatting import format_count
from swarmwright.display.figures.run import title_of
from swarmwright.display.figures.style import (
    AXES,
    COLORS,
    INK,
    SOFT,
    drawable,
    dress,
    entitle,
    new_figure,
    points,
    styled,
    whole_ticks,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from swarmwright.runs.learning_curve import LearningCurve

_RECORDED, _HELD_OUT = COLORS[2], INK


@styled()
def draw(curve: "LearningCurve") -> "Figure":
    """Return the figure: recorded and held-out fitness, with 95 % intervals, over evaluations."""
    places = np.array([point.evaluations for point in curve.points], dtype=float)
    fitness = [point.best.fitness for point in curve.points]

    def column(values: list[float | None]) -> "np.typing.NDArray[np.float64]":
        found = np.array(values, dtype=np.float64)
        return drawable(np.where(np.isfinite(found), found, np.nan))

    figure = new_figure(9, 5.2)
    axes = figure.subplots()
    axes.fill_between(
        places, column([estimate.low for estimate in fitness]),
        column([estimate.high for estimate in fitness]),
        color=_HELD_OUT, alpha=0.15, linewidth=0, label="95 % confidence interval",
    )  # fmt: skip
    axes.plot(
        places, column([point.best.recorded for point in curve.points]), color=_RECORDED,
        linewidth=points(1.4), linestyle="--", marker="o", markersize=points(4),
        label=f"recorded fitness of the {curve.run.best_words}",
    )  # fmt: skip
    axes.plot(
        places, column([estimate.mean for estimate in fitness]), color=_HELD_OUT, linewidth=points(2.2),
        marker="D", markersize=points(4), label="its fitness on held-out seeds",
    )  # fmt: skip
    axes.margins(x=0.02, y=0.08)
    dress(axes, x=AXES["evaluations"], y="fitness (more is better)")
    whole_ticks(axes.xaxis, places)
    experiment = curve.run.experiment
    entitle(figure, title_of(experiment))
    axes.set_title(
        f"each point: {format_count(len(curve.seeds), 'episode')}, the same for all; seed {experiment.seed}",
        loc="left", fontsize=points(10.5), color=SOFT,
    )  # fmt: skip
    figure.legend(loc="outside lower center", ncols=3, fontsize=points(10.5), frameon=False, labelcolor=INK)
    return figure
