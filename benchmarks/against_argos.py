"""Fitness of fixed controllers in `arena` against ARGoS 3, in every mission.

`python -m benchmarks.against_argos [--seeds N] [--pictures FOLDER]` prints the tables of
docs/studies/arena-and-argos.md and draws its pictures.
benchmarks/data/argos.json has the scores of ARGoS.
"""

import argparse
import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from swarmwright import Experiment, _engine
from swarmwright.display.figures.style import COLORS, INK, new_figure, style_axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

DATA = Path(__file__).parent / "data" / "argos.json"
SEEDS = 60
LEVEL = 0.05
ROBOTS = {"networks": "e-puck-rm1.1", "machines": "e-puck-rm1.2"}
"""By kind of controller."""


@dataclass(frozen=True)
class Pair:
    """A controller's fitness in a mission: of episodes in ARGoS, and of episodes in the arena."""

    mission: str
    controller: str
    theirs: NDArray[np.float64]
    ours: NDArray[np.float64]

    @property
    def difference(self) -> float:
        """Mean of the arena minus mean of ARGoS."""
        return float(self.ours.mean() - self.theirs.mean())

    @cached_property
    def error(self) -> float:
        """Standard error of the difference."""
        return float(np.sqrt(sum(x.var(ddof=1) / len(x) for x in (self.ours, self.theirs))))

    @cached_property
    def half_width(self) -> float:
        """Of the difference's 95 % confidence interval (Welch)."""
        parts = [float(x.var(ddof=1) / len(x)) for x in (self.ours, self.theirs)]
        if sum(parts) == 0:
            return 0.0
        counts = [len(x) - 1 for x in (self.ours, self.theirs)]
        freedom = sum(parts) ** 2 / sum(part**2 / n for part, n in zip(parts, counts, strict=True))
        return float(stats.t.ppf(1 - LEVEL / 2, freedom)) * self.error

    @property
    def agrees(self) -> bool:
        """Whether the interval contains no difference."""
        return abs(self.difference) <= self.half_width + 1e-9 * abs(float(self.theirs.mean()))

    @cached_property
    def p(self) -> float:
        """Of the two-sided Mann-Whitney test, with ties; values that only rounding sets apart are equal."""
        samples = [np.array([float(f"{value:.6g}") for value in x]) for x in (self.ours, self.theirs)]
        if np.ptp(np.concatenate(samples)) == 0:
            return 1.0
        return float(stats.mannwhitneyu(*samples, method="asymptotic").pvalue)


def pairs(kind: str, data: dict[str, Any], seeds: int) -> list[Pair]:
    """Evaluate all controllers of a kind in all missions that ARGoS has scores of."""
    found = []
    for mission, scores in data["scores"].items():
        names = [name for name in data[kind] if name in scores]
        if not names:
            continue
        for name, fitness in zip(names, _fitness(kind, mission, data, names, seeds), strict=True):
            found.append(Pair(mission, name, np.array(scores[name], dtype=np.float64), fitness))
    return found


def _fitness(
    kind: str, mission: str, data: dict[str, Any], names: Sequence[str], seeds: int
) -> NDArray[np.float64]:
    """Return the fitness of controllers, (controllers, seeds)."""
    parameters = {"mission": mission, "robot": ROBOTS[kind]}
    if kind == "networks":
        representation = _representation(parameters, {"kind": "evostick"})
        weights = np.array([data[kind][name] for name in names], dtype=np.float32)
    else:
        machines = [
            _representation(parameters, {"kind": "modules", "machine": data[kind][name]}) for name in names
        ]
        representation = machines[0]
        weights = representation.weights(np.stack([machine.start for machine in machines]))
    architecture = dict(representation.architecture())
    fitness, _ = _engine.evaluate(
        "arena", parameters, architecture, weights, list(range(1, seeds + 1)), threads=0
    )
    return fitness


def _representation(parameters: dict[str, Any], controller: dict[str, Any]) -> Any:
    values = {"simulation": "arena", "parameters": parameters, "controller": controller}
    return Experiment.from_mapping(values).representation()


def holm(values: Sequence[float]) -> list[float]:
    """Return p-values after Holm's correction."""
    adjusted, before = [0.0] * len(values), 0.0
    for rank, index in enumerate(np.argsort(values, kind="stable")):
        before = max(before, min(1.0, values[index] * (len(values) - rank)))
        adjusted[index] = before
    return adjusted


def table(found: Sequence[Pair]) -> Iterator[str]:
    """Yield a table in Markdown."""
    yield "| mission | controller | ARGoS | arena | difference, 95 % interval | p | p after Holm |"
    yield "|---|---|---|---|---|---|---|"
    for one, corrected in zip(found, holm([one.p for one in found]), strict=True):
        cells = [f"{x.mean():.4g} ({x.std(ddof=1):.3g})" for x in (one.theirs, one.ours)]
        interval = f"{one.difference:.3g} ± {one.half_width:.2g}"
        interval = interval if one.agrees else f"**{interval}**"
        yield (
            f"| `{one.mission}` | {one.controller} | {' | '.join(cells)} | {interval} | {one.p:.2g} | "
            f"{corrected:.2g} |"
        )


def summary(found: Sequence[Pair]) -> str:
    """Return how many agree."""
    agree = sum(one.agrees for one in found)
    worst = max(abs(one.difference) / one.error if one.error else 0.0 for one in found)
    significant = sum(p < LEVEL for p in holm([one.p for one in found]))
    return (
        f"{agree} of {len(found)} differences of means within their 95 % interval (largest: {worst:.1f} "
        f"standard errors); {significant} significant by Mann-Whitney after Holm's correction"
    )


def draw(found: Sequence[Pair]) -> "Figure":
    """Draw box plots of all episodes, a field for each mission."""
    missions = list(dict.fromkeys(one.mission for one in found))
    columns = 3
    rows = -(-len(missions) // columns)
    figure = new_figure(12, 2.4 * rows)
    fields = figure.subplots(rows, columns, squeeze=False).ravel()
    for field, mission in zip(fields, missions, strict=False):
        _boxes(field, [one for one in found if one.mission == mission])
        field.set_title(mission, fontsize=11, color=INK)
    for field in fields[len(missions) :]:
        field.axis("off")
    handles = [
        figure.axes[0].fill([], [], color=color, alpha=0.6, label=label)[0]
        for label, color in (("ARGoS 3, 30 seeds", COLORS[0]), ("arena", COLORS[1]))
    ]
    figure.supylabel("fitness of an episode (more is better)", fontsize=11, color=INK)
    figure.legend(handles=handles, loc="lower right", fontsize=11, frameon=False, ncols=2)
    return figure


def _boxes(field: "Axes", found: Sequence[Pair]) -> None:
    for shift, color, samples in (
        (-0.2, COLORS[0], [one.theirs for one in found]),
        (0.2, COLORS[1], [one.ours for one in found]),
    ):
        drawn = field.boxplot(
            samples,
            positions=[place + shift for place in range(len(found))],
            widths=0.34,
            patch_artist=True,
            flierprops={"marker": ".", "markersize": 3, "markeredgecolor": color},
            medianprops={"color": INK},
        )
        for box in drawn["boxes"]:
            box.set(facecolor=color, alpha=0.6, edgecolor=INK)
    style_axes(field)
    labels = [one.controller.replace("_", " ") for one in found]
    slanted: dict[str, Any] = (
        {"rotation": 30, "ha": "right", "rotation_mode": "anchor"} if len(found) > 6 else {}
    )
    field.set_xticks(range(len(found)), labels, fontsize=8, **slanted)


def main() -> None:
    """Print the tables, and draw the pictures if asked."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.against_argos", description=__doc__)
    parser.add_argument("--seeds", type=int, default=SEEDS, metavar="N", help="default: %(default)s")
    parser.add_argument("--pictures", type=Path, metavar="FOLDER", help="where box plots go")
    arguments = parser.parse_args()
    data = json.loads(DATA.read_text(encoding="utf-8"))
    for kind in ROBOTS:
        found = pairs(kind, data, arguments.seeds)
        print(*table(found), "", f"{kind}: {summary(found)}", "", sep="\n", flush=True)
        if arguments.pictures:
            arguments.pictures.mkdir(parents=True, exist_ok=True)
            draw(found).savefig(arguments.pictures / f"argos-{kind}.png")


if __name__ == "__main__":
    main()
