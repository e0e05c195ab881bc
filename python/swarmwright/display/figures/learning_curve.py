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
    clip_drawable,
    draw_title,
    new_figure,
    scale_points,
    set_integer_ticks,
    style_axes,
    use_style_fonts,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from swarmwright.runs.learning_curve import LearningCurve

_RECORDED, _HELD_OUT = COLORS[2], INK


@use_style_fonts()
def draw(curve: "LearningCurve") -> "Figure":
    """Return the figure: recorded and held-out fitness, with 95 % intervals, over evaluations."""
    xs = np.array([point.evaluations for point in curve.points], dtype=float)
    fitness = [point.best.fitness for point in curve.points]

    def column(values: list[float | None]) -> "np.typing.NDArray[np.float64]":
        array = np.array(values, dtype=np.float64)
        return clip_drawable(np.where(np.isfinite(array), array, np.nan))

    figure = new_figure(9, 5.2)
    axes = figure.subplots()
    axes.fill_between(
        xs, column([estimate.low for estimate in fitness]),
        column([estimate.high for estimate in fitness]),
        color=_HELD_OUT, alpha=0.15, linewidth=0, label="95 % confidence interval",
    )  # fmt: skip
    axes.plot(
        xs, column([point.best.recorded for point in curve.points]), color=_RECORDED,
        linewidth=scale_points(1.4), linestyle="--", marker="o", markersize=scale_points(4),
        label=f"recorded fitness of the {curve.run.best_words}",
    )  # fmt: skip
    axes.plot(
        xs, column([estimate.mean for estimate in fitness]), color=_HELD_OUT, linewidth=scale_points(2.2),
        marker="D", markersize=scale_points(4), label="its fitness on held-out seeds",
    )  # fmt: skip
    axes.margins(x=0.02, y=0.08)
    style_axes(axes, x=AXES["evaluations"], y="fitness (more is better)")
    set_integer_ticks(axes.xaxis, xs)
    experiment = curve.run.experiment
    draw_title(figure, title_of(experiment))
    axes.set_title(
        f"each point: {format_count(len(curve.seeds), 'episode')}, the same for all; seed {experiment.seed}",
        loc="left", fontsize=scale_points(10.5), color=SOFT,
    )  # fmt: skip
    figure.legend(
        loc="outside lower center", ncols=3, fontsize=scale_points(10.5), frameon=False, labelcolor=INK
    )
    return figure
