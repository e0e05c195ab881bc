"""Loss of messages in the arena: controllers evolved without loss, and with it.

`python -m benchmarks.radio FOLDER [--repetitions N] [--generations N] [--picture FILE]` evolves swarms that
have to come together, guided by range and bearing alone, with no loss of messages and with a loss of 0.8,
scores the best of each run on the same held-out seeds with losses of 0 to 0.9, prints a table and draws it.
FOLDER keeps the runs.
"""

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from benchmarks.kept import finished
from swarmwright import Experiment, post_evaluate
from swarmwright.display.figures.style import COLORS, new_figure, style_axes

if TYPE_CHECKING:
    from matplotlib.figure import Figure

EVOLVED = (0.0, 0.8)
LOSSES = (0.0, 0.3, 0.6, 0.8, 0.9)
EPISODES = 40
"""With held-out seeds, for each design and loss."""
MISSION: dict[str, Any] = {
    "title": "Meeting",
    "walls": {"sides": 12, "apothem": 1.226},
    "start": {"disc": {"radius": 1.1}},
    "robots": 15,
    "duration": 60,
    "fitness": "largest_group",
}
"""How many robots are in the largest group at the end, links below 0.35 m."""


def experiment(loss: float, generations: int, repetition: int) -> Experiment:
    """Return what evolves with a loss of messages."""
    return Experiment.from_mapping(
        {
            "simulation": "arena",
            "parameters": {
                "mission": MISSION,
                "robot": {"preset": "e-puck-rm1.1", "sensors": {"range_and_bearing": {"loss": loss}}},
                "seed": 1_000_000 * (repetition + 1),
            },
            "controller": {"kind": "evostick"},
            "method": {"kind": "evostick", "population": 40, "generations": generations},
            "ranking": {"episodes": 5, "seeds": "new"},
            "seed": repetition,
            "servers": "in-process",
        }
    )


def scores(folder: Path, loss: float, generations: int, repetition: int) -> list[float]:
    """Evolve, or open what was evolved before, and return the mean fitness with each loss."""
    path = folder / f"loss-{loss}-{generations}-{repetition}"
    run = finished(experiment(loss, generations, repetition), path)
    others = [experiment(one, generations, repetition) for one in LOSSES]
    return [post_evaluate(run, episodes=EPISODES, seed=7, experiment=one).fitness.mean for one in others]


def interval(values: NDArray[np.float64]) -> tuple[float, float]:
    """Return the mean over repetitions and half the width of its 95 % interval (Student)."""
    half = stats.t.ppf(0.975, len(values) - 1) * values.std(ddof=1) / np.sqrt(len(values))
    return float(values.mean()), float(half)


def table(found: NDArray[np.float64]) -> Iterator[str]:
    """Yield a table in Markdown of (evolved with, repetition, loss)."""
    yield "| loss | evolved without loss | evolved with a loss of 0.8 | difference (95 % interval) |"
    yield "|---|---|---|---|"
    for index, loss in enumerate(LOSSES):
        cells = ["{:.2f} ± {:.2f}".format(*interval(found[kind, :, index])) for kind in range(len(EVOLVED))]
        mean, half = interval(found[1, :, index] - found[0, :, index])
        yield f"| {loss} | {cells[0]} | {cells[1]} | {mean:+.2f} ({mean - half:+.2f} to {mean + half:+.2f}) |"


def draw(found: NDArray[np.float64]) -> "Figure":
    """Return fitness by loss, with 95 % intervals."""
    figure = new_figure(6.4, 4)
    axes = figure.subplots()
    for kind, loss in enumerate(EVOLVED):
        numbers = [interval(found[kind, :, index]) for index in range(len(LOSSES))]
        means, halves = np.array(numbers).T
        name = "evolved without loss" if loss == 0 else f"evolved with a loss of {loss:g}"
        at = np.array(LOSSES) + (kind - 0.5) * 0.01
        style: dict[str, Any] = {
            "marker": "os"[kind],
            "color": COLORS[kind],
            "capsize": 3,
            "linestyle": ("-", "--")[kind],
        }
        axes.errorbar(at, means, halves, label=name, **style)
    style_axes(axes, x="probability that a message is lost", y="robots in the largest group")
    axes.set_ylim(0, float(MISSION["robots"]))
    axes.legend(frameon=False)
    return figure


def main() -> None:
    """Evolve, print and draw."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.radio", description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--repetitions", type=int, default=5, metavar="N", help="default: %(default)s")
    parser.add_argument("--generations", type=int, default=30, metavar="N", help="default: %(default)s")
    parser.add_argument("--picture", type=Path, metavar="FILE")
    asked = parser.parse_args()
    found = np.array(
        [
            [scores(asked.folder, loss, asked.generations, one) for one in range(asked.repetitions)]
            for loss in EVOLVED
        ]
    )
    print("\n".join(table(found)))
    if asked.picture:
        draw(found).savefig(asked.picture)


if __name__ == "__main__":
    main()
