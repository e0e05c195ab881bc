"""The fitness plot of a run."""

import importlib
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from swarmwright._errors import InputError

if TYPE_CHECKING:
    from swarmwright._run import Run

_BEST, _MEAN, _INK, _PAPER, _GRID = "#0b6e4f", "#c8553d", "#22303c", "#ffffff", "#e3e7eb"


def prepare() -> None:
    """Load what `draw` needs, so that it need not wait for it."""
    with suppress(ImportError):  # `draw` says so if it is wanted
        importlib.import_module("matplotlib.backends.backend_agg")
        importlib.import_module("matplotlib.figure")


def draw(run: "Run", path: Path) -> None:
    """Draw best, mean and the middle half of the population over the generations; write a PNG.

    Raises InputError when the run has no generation or the file cannot be written.
    """
    history = run.history
    if not history:
        raise InputError(f"{run.path}: holds no finished generation to draw")
    # The object interface with its own canvas: no global state, no display needed, safe in any thread.
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.ticker import MaxNLocator

    figure = Figure(figsize=(9, 5.2), dpi=150, facecolor=_PAPER, layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    generations = np.array([one.generation for one in history])
    # A run of one generation would draw nothing at all.
    marker = "o" if len(history) == 1 else None
    lower = np.array([one.lower_quartile for one in history])
    upper = np.array([one.upper_quartile for one in history])
    axes.fill_between(
        generations, lower, upper, color=_MEAN, alpha=0.16, linewidth=0, label="middle half of the population"
    )
    axes.plot(
        generations, [one.mean for one in history], color=_MEAN, linewidth=1.6, marker=marker, label="mean"
    )
    axes.step(
        generations,
        [one.best_so_far for one in history],
        where="post",
        color=_BEST,
        linewidth=2.4,
        marker=marker,
        label="best so far",
    )
    best = run.best
    axes.plot(
        [best.generation],
        [best.fitness],
        marker="o",
        markersize=8,
        color=_BEST,
        markeredgecolor=_PAPER,
        zorder=5,
    )
    axes.annotate(
        f"{best.fitness:.4g}",
        (best.generation, best.fitness),
        xytext=(0, 9),
        textcoords="offset points",
        ha="center",
        color=_BEST,
        fontsize=12,
        fontweight="bold",
    )
    experiment = run.experiment
    method: str = experiment.method.kind  # type: ignore[attr-defined] # every kind's options have it
    axes.set_title(
        f"{experiment.simulation}: {method} evolves a {experiment.controller.kind} controller",
        loc="left",
        fontsize=15,
        fontweight="bold",
        color=_INK,
        pad=24,
    )
    axes.text(
        0,
        1.025,
        f"{run.evaluations:,} evaluations in {run.generations:,} generations, seed {experiment.seed}",
        transform=axes.transAxes,
        fontsize=11,
        color=_INK,
        alpha=0.75,
    )
    axes.set_xlabel("generation", fontsize=12, color=_INK)
    axes.set_ylabel("fitness (more is better)", fontsize=12, color=_INK)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.tick_params(labelsize=11, colors=_INK)
    axes.grid(color=_GRID, linewidth=0.9)
    axes.set_axisbelow(True)
    axes.margins(x=0.02, y=0.12)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    for side in ("left", "bottom"):
        axes.spines[side].set_color("#9aa5b1")
    figure.legend(loc="outside lower center", ncols=3, fontsize=11, frameon=False, labelcolor=_INK)
    try:
        figure.savefig(path, format="png")
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror}") from error
