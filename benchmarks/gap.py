"""What ways of design lose in other simulators: the reality gap with simulators in the place of robots.

`python -m benchmarks.gap FOLDER [--missions A,B] [--repetitions N] [--budget N] [--seeds N]
[--simulators A,B]` designs controllers in the arena as `benchmarks.designs` does, which can share FOLDER,
evaluates the best of each design in every simulator with held-out seeds, prints the table of
docs/studies/designs.md, draws FOLDER/gap.png and writes FOLDER/gap.json, of which
benchmarks/data/gap.json is a copy. What is done is not repeated. `--draw FILE` prints and draws from such a
file alone.
"""

import argparse
import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from scipy import stats

from benchmarks.designs import DESIGNS, MISSIONS, designed
from benchmarks.kept import read, write
from benchmarks.missions import chosen
from benchmarks.places import PLACES, PREFIX, Place, running
from benchmarks.processes import Broker, embedded
from swarmwright import Run, transfer
from swarmwright.display.figures.style import COLORS, INK, new_figure, style_axes

if TYPE_CHECKING:
    from matplotlib.figure import Figure

ABOUT = (
    "Mean fitness of designs in the arena and in other simulators, in the same episodes: 20 e-pucks, 120 s, "
    "held-out seeds. python -m benchmarks.gap FOLDER"
)
ELSEWHERE = tuple(place for place in PLACES if place.simulation != "arena")


@dataclass(frozen=True)
class Loss:
    """A design in a simulator: mean fitness in the arena and there, in the same episodes."""

    mission: str
    design: str
    repetition: int
    simulator: str
    seeds: int
    arena: float
    there: float

    @property
    def key(self) -> tuple[str, str, int, str]:
        """What it is of."""
        return self.mission, self.design, self.repetition, self.simulator

    @property
    def lost(self) -> float:
        """What the design loses in the simulator; below 0: gains."""
        return self.arena - self.there


def target(folder: Path, place: Place, broker: Broker, run: Run) -> Path:
    """Write the file that names a simulator, with the parameters of a run, as the target of a transfer."""
    file = folder / f"{place.name.lower()}.yaml"
    servers = {"servers": "auto", "broker": broker.url, "prefix": PREFIX}
    keys = {
        "simulation": place.simulation,
        "parameters": dict(run.experiment.parameters),
        **(servers if place.command else {"servers": "in-process"}),
    }
    file.write_text(json.dumps(keys), encoding="utf-8")
    return file


def measure(run: Run, file: Path, place: Place, seeds: int) -> tuple[float, float]:
    """Mean fitness of the best of a run, in the arena and in a simulator."""
    (found,) = transfer([run], [str(file)], candidates=1, seeds=seeds).runs
    assert not found.failed, f"{run.path}: episodes failed in {place.name}"
    return found.source_fitness[0].mean, found.target_fitness[0].mean


def table(found: Sequence[Loss]) -> Iterator[str]:
    """Yield a table in Markdown: medians of fitness and, in parentheses, loss; p by Kruskal and Wallis."""
    simulators = list(dict.fromkeys(one.simulator for one in found))
    yield f"| mission | design | arena | {' | '.join(simulators)} |"
    yield "|---|---|---|" + "---|" * len(simulators)
    for mission in dict.fromkeys(one.mission for one in found):
        of = [one for one in found if one.mission == mission]
        names = list(dict.fromkeys(one.design for one in of))
        most = max(one.seeds for one in of)
        losses: dict[str, list[list[float]]] = {simulator: [] for simulator in simulators}
        for name in names:
            arena = float(np.median([one.arena for one in of if one.design == name and one.seeds == most]))
            row = []
            for simulator in simulators:
                there = [one for one in of if (one.design, one.simulator) == (name, simulator)]
                losses[simulator].append([one.lost for one in there])
                row.append(_medians(there))
            yield f"| `{mission}` | {name} | {_rounded(arena)} | {' | '.join(row)} |"
        tests = [_p(losses[simulator]) for simulator in simulators]
        yield f"| `{mission}` | p | | {' | '.join(tests)} |"


def _medians(of: Sequence[Loss]) -> str:
    if not of:
        return "-"
    there, lost = (
        float(np.median(values)) for values in zip(*((one.there, one.lost) for one in of), strict=True)
    )
    return f"{_rounded(there)} ({_rounded(lost)})"


def _p(losses: Sequence[Sequence[float]]) -> str:
    return f"{float(stats.kruskal(*losses).pvalue):.2g}" if all(losses) else "-"


def _rounded(value: float) -> str:
    return f"{value:,.0f}" if abs(value) >= 1000 else f"{value:.3g}"


def draw(found: Sequence[Loss]) -> "Figure":
    """Draw box plots of fitness, a field for each mission."""
    missions = list(dict.fromkeys(one.mission for one in found))
    names = list(dict.fromkeys(one.design for one in found))
    simulators = list(dict.fromkeys(one.simulator for one in found))
    most = max(one.seeds for one in found)
    width = 0.8 / len(names)
    figure = new_figure(9.0, 3.0 * len(missions) + 0.4)
    for field, mission in zip(figure.subplots(len(missions), 1, squeeze=False)[:, 0], missions, strict=True):
        for index, (name, color) in enumerate(zip(names, COLORS, strict=False)):
            of = [one for one in found if (one.mission, one.design) == (mission, name)]
            arena = {one.repetition: one.arena for one in of if one.seeds == most}
            values = [list(arena.values())]
            values += [[one.there for one in of if one.simulator == simulator] for simulator in simulators]
            drawn = field.boxplot(
                values,
                positions=[place - 0.4 + (index + 0.5) * width for place in range(len(values))],
                widths=0.85 * width,
                patch_artist=True,
                medianprops={"color": INK},
                flierprops={"markersize": 3},
            )
            for box in drawn["boxes"]:
                box.set(facecolor=color, alpha=0.6, edgecolor=INK)
        style_axes(field)
        field.set_title(mission, fontsize=11, color=INK)
        field.set_xticks(range(len(simulators) + 1), ["arena", *simulators])
    handles = [
        figure.axes[0].fill([], [], color=color, alpha=0.6, label=name)[0]
        for name, color in zip(names, COLORS, strict=False)
    ]
    figure.supylabel("mean fitness of a design (more is better)", fontsize=11, color=INK)
    figure.legend(handles=handles, loc="outside lower center", fontsize=11, frameon=False, ncols=len(names))
    return figure


def measured(
    folder: Path, missions: Sequence[str], places: Sequence[Place], arguments: argparse.Namespace
) -> list[Loss]:
    """Measure what is not in the file yet; return all that it holds, ordered by simulator and design."""
    file = folder / "gap.json"
    found = {one.key: one for one in (read(file, Loss) if file.exists() else ())}
    runs = {
        (mission, design, repetition): designed(folder, mission, design, arguments.budget, repetition)
        for mission in missions
        for repetition in range(1, arguments.repetitions + 1)
        for design in DESIGNS
    }
    with embedded() as broker:
        for place in places:
            why = place.missing()
            if why is not None:
                print(f"{place.name} is skipped: {why}", flush=True)
                continue
            with running(place, broker):
                for one, run in runs.items():
                    key = (*one, place.name)
                    if key in found and found[key].seeds == arguments.seeds:
                        continue
                    goal = target(folder, place, broker, run)
                    arena, there = measure(run, goal, place, arguments.seeds)
                    found[key] = Loss(*key, arguments.seeds, float(f"{arena:.6g}"), float(f"{there:.6g}"))
                    write(found.values(), file, ABOUT)
                    print(found[key], flush=True)
    order = [place.name for place in ELSEWHERE]
    kinds = list(DESIGNS)
    every = sorted(
        found.values(),
        key=lambda one: (
            one.mission,
            order.index(one.simulator),
            kinds.index(one.design),
            one.repetition,
        ),
    )
    write(every, file, ABOUT)
    return every


def main() -> None:
    """Measure what the command line asks for."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.gap", description=__doc__)
    parser.add_argument("folder", type=Path, metavar="FOLDER")
    names = [place.name for place in ELSEWHERE]
    for option, default, of in (
        ("--repetitions", 10, "designs of each kind"),
        ("--budget", 20_000, "episodes of a design"),
        ("--seeds", 10, "episodes in which a design is evaluated"),
    ):
        parser.add_argument(option, type=int, default=default, metavar="N", help=f"{of}; default: {default}")
    parser.add_argument("--missions", default="aac,spc", metavar="A,B", help="default: %(default)s")
    parser.add_argument("--simulators", default=",".join(names), metavar="A,B", help="default: %(default)s")
    parser.add_argument("--draw", type=Path, metavar="FILE", help="measure nothing, show what is in a file")
    arguments = parser.parse_args()
    arguments.folder.mkdir(parents=True, exist_ok=True)
    if arguments.draw is not None:
        found = list(read(arguments.draw, Loss))
    else:
        missions = chosen(arguments.missions, MISSIONS, "mission")
        wanted = chosen(arguments.simulators, names, "simulator")
        found = measured(
            arguments.folder, missions, [place for place in ELSEWHERE if place.name in wanted], arguments
        )
    print(*table(found), sep="\n")
    draw(found).savefig(arguments.folder / "gap.png")


if __name__ == "__main__":
    main()
