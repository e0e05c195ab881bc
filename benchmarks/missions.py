"""The same controllers on the same missions of the arena in every simulator that is installed.

`python -m benchmarks.missions FOLDER [--seeds N] [--missions A,B] [--simulators A,B]` designs three kinds of
controllers in the arena for each mission, evaluates them in every simulator with held-out seeds, prints the
tables of docs/studies/one-mission.md, draws FOLDER/missions.png and writes FOLDER/missions.json, of which
benchmarks/data/missions.json is a copy. FOLDER keeps the designs and what was measured: what is done is not
repeated.
`--draw FILE` prints and draws from such a file alone.

`SWARMWRIGHT_ARGOS` and `SWARMWRIGHT_STAGE` name the folders where these are installed, `make gazebo` builds
the server of Gazebo, in which 30 seeds take half an hour. What is missing is skipped, and said.
"""

import argparse
import json
import math
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from scipy import stats

from benchmarks.designs import DESIGNS
from benchmarks.kept import finished, read, write
from benchmarks.places import PLACES, PREFIX, Place, running
from benchmarks.processes import Broker, embedded
from swarmwright import Experiment, Run, post_evaluate
from swarmwright.analysis.significance import holm
from swarmwright.common.statistics import Estimate, estimate
from swarmwright.display.figures.style import COLORS, INK, new_figure, style_axes

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MISSIONS = ("emergency_exit", "aggregation", "homing", "area_coverage")
CONTROLLERS = ("EvoStick", "Chocolate", "Maple")
ROBOTS, SECONDS, TICKS_PER_SECOND = 20, 60, 10
BUDGET = 20_000
"""Episodes of a design."""
SEEDS = 30
FIRST_SEED = 1_000_000_000
"""Of the held-out seeds."""
LEVEL = 0.05
"""Of significance, after Holm's correction."""
ABOUT = (
    f"Fitness of three controllers on missions of the arena in several simulators: {ROBOTS} e-pucks, "
    f"{SECONDS} s, held-out seeds from {FIRST_SEED} on. python -m benchmarks.missions FOLDER"
)


@dataclass(frozen=True)
class Cell:
    """A controller on a mission in a simulator.

    fitness: of each episode. seconds, processor_seconds: by the clock, and of the process that simulates,
    for all of its episodes.
    """

    mission: str
    controller: str
    simulator: str
    fitness: tuple[float, ...]
    seconds: float
    processor_seconds: float

    @property
    def key(self) -> tuple[str, str, str]:
        """What it is of."""
        return self.mission, self.controller, self.simulator

    @property
    def mean(self) -> Estimate:
        """With Student's 95 % interval."""
        return estimate([one for one in self.fitness if math.isfinite(one)])

    @property
    def rate(self) -> float:
        """Robot-steps per second of the processor."""
        return ROBOTS * SECONDS * TICKS_PER_SECOND * len(self.fitness) / self.processor_seconds


def design(folder: Path, mission: str, kind: str, budget: int) -> Run:
    """Design a controller in the arena, or open what was designed before."""
    values = json.loads(json.dumps(DESIGNS[kind]))
    values["parameters"] |= {"mission": mission, "robots": ROBOTS, "duration": SECONDS}
    values["method"]["evaluations"] = budget // values["ranking"]["episodes"]
    more = {"simulation": "arena", "seed": 1, "servers": "in-process", "validate": False}
    path = folder / f"{mission}-{kind.lower()}-{budget}"
    return finished(Experiment.from_mapping(values | more), path)


def there(run: Run, place: Place) -> Experiment:
    """The run's experiment in a simulator."""
    if place.command is None:
        return run.experiment.replace(simulation=place.simulation, servers="in-process")
    return run.experiment.replace(simulation=place.simulation, servers="auto", prefix=PREFIX)


def measure(run: Run, place: Place, seeds: int, broker: Broker, clock: Callable[[], float]) -> Cell:
    """Evaluate the best controller of a run in a simulator."""
    address = None if place.command is None else broker.url
    asked = there(run, place)
    post_evaluate(run, episodes=1, seed=1, experiment=asked, broker=address)  # makes the world
    processor, start = clock(), time.monotonic()
    found = post_evaluate(run, episodes=seeds, seed=FIRST_SEED, experiment=asked, broker=address)
    processor, seconds = clock() - processor, time.monotonic() - start
    mission = str(run.experiment.parameters["mission"])
    kind = next(kind for kind in CONTROLLERS if f"-{kind.lower()}-" in run.path.name)
    fitness = tuple(float(f"{one:.6g}") for one in found.episodes.tolist())
    return Cell(mission, kind, place.name, fitness, round(seconds, 3), round(processor, 3))


def measured(
    runs: Mapping[tuple[str, str], Run], places: Sequence[Place], seeds: int, before: Sequence[Cell]
) -> Iterator[Cell]:
    """Yield all cells, one simulator after the other; those of before that have as many seeds as they are."""
    with embedded() as broker:
        for place in places:
            kept = {
                (cell.mission, cell.controller): cell
                for cell in before
                if cell.simulator == place.name and len(cell.fitness) == seeds
            }
            if runs.keys() <= kept.keys():
                yield from (kept[key] for key in runs)
                continue
            why = place.missing()
            if why is not None:
                print(f"{place.name} is skipped: {why}", file=sys.stderr, flush=True)
                continue
            with running(place, broker) as clock:
                for key, run in runs.items():
                    yield kept.get(key) or measure(run, place, seeds, broker, clock)


def speeds(cells: Sequence[Cell]) -> Iterator[str]:
    """Yield a table in Markdown: the largest rate of each simulator, over missions and controllers."""
    yield "| simulator | seeds | robot-steps/s | relative to arena |"
    yield "|---|---|---|---|"
    best: dict[str, float] = {}
    for cell in cells:
        best[cell.simulator] = max(best.get(cell.simulator, 0.0), cell.rate)
    arena = best.get("arena")
    for name, rate in best.items():
        count = next(len(cell.fitness) for cell in cells if cell.simulator == name)
        part = "" if arena is None else f"{rate / arena:.2g}"
        yield f"| {name} | {count} | {float(f'{rate:.2g}'):,.0f} | {part} |"


@dataclass(frozen=True)
class Paired:
    """Differences of a simulator from the arena, of the same controller in episodes with the same seeds."""

    cell: Cell
    mean: float
    half: float
    """Of Student's 95 % interval of the mean difference."""
    p: float
    """Two-sided, of the paired t-test; 1 where all differences are zero."""


def paired(cells: Sequence[Cell]) -> list[Paired]:
    """Compare every cell with that of the arena, seed by seed; episodes that failed are left out in both."""
    arena = {(cell.mission, cell.controller): cell for cell in cells if cell.simulator == "arena"}
    found = []
    for cell in cells:
        here = arena.get((cell.mission, cell.controller))
        if here is None or cell.simulator == "arena":
            continue
        both = zip(cell.fitness, here.fitness, strict=False)  # a slow simulator has fewer episodes
        differences = np.array([there - one for there, one in both if math.isfinite(there - one)])
        of = estimate(differences.tolist())
        half = math.nan if of.low is None or of.high is None else (of.high - of.low) / 2
        p = float(stats.ttest_1samp(differences, 0.0).pvalue) if np.any(differences) else 1.0
        found.append(Paired(cell, of.mean, half, p))
    return found


def table(cells: Sequence[Cell]) -> Iterator[str]:
    """Yield a table in Markdown: the arena's mean fitness, and differences from it; bold: significant.

    Each is followed by half of its 95 % interval. p-values are corrected after Holm for all differences.
    """
    compared = paired(cells)
    corrected = holm([one.p for one in compared])
    entries = {one.cell.key: _difference(one, p < LEVEL) for one, p in zip(compared, corrected, strict=True)}
    names = list(dict.fromkeys(cell.simulator for cell in cells))
    yield f"| mission | controller | {' | '.join(names)} |"
    yield "|---|---|" + "---|" * len(names)
    by_key = {cell.key: cell for cell in cells}
    for mission, controller in dict.fromkeys((cell.mission, cell.controller) for cell in cells):
        keys = [(mission, controller, name) for name in names]
        shown = " | ".join(entries.get(key) or _entry(by_key[key].mean) for key in keys)
        yield f"| `{mission}` | {controller} | {shown} |"


def _difference(one: Paired, significant: bool) -> str:
    if not one.half > 0:  # a single episode has no interval, and equal episodes have nothing to round
        return f"{one.mean:+.3g}"
    digits = max(0, 1 - math.floor(math.log10(one.half)))
    text = f"{one.mean:+.{digits}f} ± {_two_digits(one.half)}"
    return f"**{text}**" if significant else text


def _entry(mean: Estimate) -> str:
    if mean.low is None or mean.high is None:
        return f"{mean.mean:.4g}"
    return f"{mean.mean:.4g} ± {_two_digits((mean.high - mean.low) / 2)}"


def _two_digits(value: float) -> str:
    return f"{float(f'{value:.2g}'):g}"


def draw(cells: Sequence[Cell]) -> "Figure":
    """Draw means with their intervals, a field for each mission."""
    missions = list(dict.fromkeys(cell.mission for cell in cells))
    names = list(dict.fromkeys(cell.simulator for cell in cells))
    columns = min(2, len(missions))
    figure = new_figure(4.8 * columns, 2.6 * -(-len(missions) // columns) + 0.4)
    fields = figure.subplots(-(-len(missions) // columns), columns, squeeze=False).ravel()
    for field, mission in zip(fields, missions, strict=False):
        for shift, kind, color in zip((-0.22, 0.0, 0.22), CONTROLLERS, COLORS, strict=False):
            of = [cell for cell in cells if (cell.mission, cell.controller) == (mission, kind)]
            means = np.array([cell.mean.mean for cell in of])
            reach = [cell.mean.high - cell.mean.mean if cell.mean.high is not None else 0.0 for cell in of]
            places = [names.index(cell.simulator) + shift for cell in of]
            field.errorbar(places, means, reach, fmt="o", color=color, markersize=5, capsize=3, label=kind)
        style_axes(field)
        field.set_title(mission.replace("_", " "), fontsize=11, color=INK)
        field.set_xticks(range(len(names)), names)
    for field in fields[len(missions) :]:
        field.axis("off")
    handles, labels = fields[0].get_legend_handles_labels()
    figure.supylabel("mean fitness with 95 % interval (more is better)", fontsize=11, color=INK)
    figure.legend(handles, labels, loc="outside lower center", fontsize=11, frameon=False, ncols=3)
    return figure


def keep(cells: Sequence[Cell], path: Path) -> None:
    """Write cells, simulator by simulator."""
    names = [place.name for place in PLACES]
    in_order = sorted(cells, key=lambda cell: names.index(cell.simulator))
    write(in_order, path, ABOUT)


def chosen(text: str, known: Sequence[str], what: str) -> list[str]:
    """Return names of a list with commas; an unknown one ends the program."""
    names = text.split(",")
    for name in names:
        if name not in known:
            raise SystemExit(f"unknown {what} {name!r}; available: {', '.join(known)}")
    return names


def main() -> None:
    """Measure what the command line asks for."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.missions", description=__doc__)
    parser.add_argument("folder", type=Path, metavar="FOLDER")
    parser.add_argument("--seeds", type=int, default=SEEDS, metavar="N", help="default: %(default)s")
    parser.add_argument(
        "--budget", type=int, default=BUDGET, metavar="N", help="episodes of a design; default: %(default)s"
    )
    parser.add_argument("--missions", default=",".join(MISSIONS), metavar="A,B", help="default: %(default)s")
    names = [place.name for place in PLACES]
    parser.add_argument("--simulators", default=",".join(names), metavar="A,B", help="default: %(default)s")
    parser.add_argument("--draw", type=Path, metavar="FILE", help="measure nothing, show what is in a file")
    arguments = parser.parse_args()
    arguments.folder.mkdir(parents=True, exist_ok=True)
    if arguments.draw is not None:
        cells = list(read(arguments.draw, Cell))
    else:
        missions = chosen(arguments.missions, MISSIONS, "mission")
        wanted = chosen(arguments.simulators, names, "simulator")
        places = [place for place in PLACES if place.name in wanted]
        runs = {
            (mission, kind): design(arguments.folder, mission, kind, arguments.budget)
            for mission in missions
            for kind in CONTROLLERS
        }
        file = arguments.folder / "missions.json"
        before = list(read(file, Cell)) if file.exists() else []
        cells = []
        for cell in measured(runs, places, arguments.seeds, before):
            cells.append(cell)
            keep(cells + [one for one in before if one.key not in {cell.key for cell in cells}], file)
            mean = _entry(cell.mean)
            print(f"{cell.simulator}, {cell.mission}, {cell.controller}: {mean}", file=sys.stderr, flush=True)
    print(*speeds(cells), "", *table(cells), sep="\n")
    draw(cells).savefig(arguments.folder / "missions.png")


if __name__ == "__main__":
    main()
