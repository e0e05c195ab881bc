"""EvoStick against Chocolate in the arena: designs of the same budget, scored on held-out seeds.

`python -m benchmarks.designs FOLDER [--budget N] [--repetitions N] [--missions A,B] [--designs A,B]` designs
with both, or others, several times for each mission, scores the designs on held-out seeds, with the robots of
the design and with sampled ones whose noise is another, prints a table and draws box plots. FOLDER keeps the
runs, and their scores in FOLDER/designs-BUDGET.json: what is done is not repeated. A design with 200,000
episodes takes several minutes. `--draw FILE` prints and draws from such a file alone.
"""

import argparse
import json
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy import stats

from benchmarks.kept import finished, read, write
from swarmwright import Experiment, Run, transfer
from swarmwright.display.figures.style import COLORS, INK, new_figure, style_axes

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MISSIONS = ("aac", "cfa", "lcn", "sca", "spc")
"""Those on which Chocolate was presented (Francesca et al. 2015)."""
EPISODES = 100
"""With held-out seeds, for each design."""
DESIGNS: dict[str, dict[str, Any]] = {
    "EvoStick": {
        "parameters": {"robot": "e-puck-rm1.1"},
        "controller": {"kind": "evostick"},
        "method": {"kind": "evostick", "population": 100},
        "ranking": {"episodes": 10, "seeds": "new"},
    },
    "Chocolate": {
        "parameters": {"robot": "e-puck-rm1.2"},
        "controller": {"kind": "modules"},
        "method": {"kind": "racing"},
        "ranking": {"episodes": 1},
    },
    "Maple": {
        "parameters": {"robot": "e-puck-rm1.2"},
        "controller": {"kind": "modules", "form": "tree"},
        "method": {"kind": "racing"},
        "ranking": {"episodes": 1},
    },
    "CMA-ES": {
        "parameters": {"robot": "e-puck-rm1.1"},
        "controller": {"kind": "evostick"},
        "method": {"kind": "cma_es"},
        "ranking": {"episodes": 10, "seeds": "new"},
    },
}
"""Maple: Chocolate's modules in a behaviour tree (Kuckling et al. 2018). CMA-ES: on EvoStick's network."""
COMPARED = ("EvoStick", "Chocolate")


@dataclass(frozen=True)
class Design:
    """What came out of one design process: the fitness during it, and means of EPISODES other episodes."""

    mission: str
    kind: str
    repetition: int
    recorded: float
    fitness: float
    transferred: float
    """The same with robots whose noise is sampled around the reference model's, anew in each episode."""
    seconds: float
    """Of the design process, with its record and the held-out episodes."""

    @property
    def key(self) -> tuple[str, str, int]:
        """What it is of."""
        return self.mission, self.kind, self.repetition

    @property
    def loss(self) -> float:
        """What the design loses with these robots."""
        return self.fitness - self.transferred


def experiment(mission: str, kind: str, budget: int, repetition: int) -> Experiment:
    """Return what designs with `budget` episodes."""
    values = json.loads(json.dumps(DESIGNS[kind]))
    episodes = values["ranking"]["episodes"]
    values["parameters"]["mission"] = mission
    values["parameters"]["seed"] = 1_000_000 * repetition
    values["method"]["evaluations"] = budget // episodes
    return Experiment.from_mapping(
        {
            **values,
            "simulation": "arena",
            "seed": repetition,
            "servers": "in-process",
            "validate": {"episodes": EPISODES, "candidates": 1},
        }
    )


def designed(folder: Path, mission: str, kind: str, budget: int, repetition: int) -> Run:
    """Design, or open what was designed before."""
    path = folder / f"{mission}-{kind.lower()}-{budget}-{repetition}"
    return finished(experiment(mission, kind, budget, repetition), path)


def design(folder: Path, mission: str, kind: str, budget: int, repetition: int) -> Design:
    """Score what was designed."""
    started = time.monotonic()
    run = designed(folder, mission, kind, budget, repetition)
    seconds = time.monotonic() - started
    assert run.validation is not None
    best = run.validation.best
    (found,) = transfer([run], pseudo_reality=True, candidates=1, seeds=EPISODES).runs
    scores = (best.recorded, best.fitness.mean, found.target_fitness[0].mean)
    recorded, fitness, transferred = (float(f"{one:.6g}") for one in scores)
    return Design(mission, kind, repetition, recorded, fitness, transferred, round(seconds, 1))


def kinds(found: Sequence[Design]) -> list[str]:
    """Return the kinds of designs that were made, in their order."""
    return list(dict.fromkeys(one.kind for one in found))


def table(found: Sequence[Design]) -> Iterator[str]:
    """Yield a table in Markdown: medians of each kind, and the test of Mann and Whitney, or Kruskal's."""
    names = (
        "mission", "method", "during evolution", "held-out seeds (range)", "p (held-out)", "pseudo-reality",
        "p (pseudo-reality)", "loss", "p (loss)",
    )  # fmt: skip
    yield f"| {' | '.join(names)} |"
    yield "|---" * len(names) + "|"
    for mission in dict.fromkeys(one.mission for one in found):
        by_kind = {
            kind: [one for one in found if (one.mission, one.kind) == (mission, kind)]
            for kind in kinds(found)
        }
        # Whether any differs from the others, where there are more than two.
        test = stats.mannwhitneyu if len(by_kind) == 2 else stats.kruskal
        tests = [
            float(test(*([getattr(one, name) for one in of] for of in by_kind.values())).pvalue)
            for name in ("fitness", "transferred", "loss")
        ]
        for kind, of in by_kind.items():
            columns = np.array([(one.recorded, one.fitness, one.transferred, one.loss) for one in of])
            recorded, fitness, transferred, loss = np.median(columns, axis=0)
            low, high = columns[:, 1].min(), columns[:, 1].max()
            yield (
                f"| `{mission}` | {kind} | {_figure(recorded)} | {_figure(fitness)} ({_figure(low)} to "
                f"{_figure(high)}) | {tests[0]:.2g} | {_figure(transferred)} | {tests[1]:.2g} | "
                f"{_figure(loss, 3)} | {tests[2]:.2g} |"
            )


def _figure(value: float, digits: int = 4) -> str:
    """Write so many digits, without a power of ten."""
    rounded = float(f"{value:.{digits}g}")
    return f"{rounded:,.0f}" if abs(rounded) >= 1000 else f"{rounded:g}"


def draw(found: Sequence[Design]) -> "Figure":
    """Draw box plots of all designs, a field for each mission."""
    missions = list(dict.fromkeys(one.mission for one in found))
    figure = new_figure(2.5 * len(missions), 3.2)
    for field, mission in zip(figure.subplots(1, len(missions), squeeze=False)[0], missions, strict=True):
        for place, name in enumerate(("fitness", "transferred")):
            width = 0.8 / len(kinds(found))
            for index, (kind, color) in enumerate(zip(kinds(found), COLORS, strict=False)):
                values = [getattr(one, name) for one in found if (one.mission, one.kind) == (mission, kind)]
                drawn = field.boxplot(
                    [values],
                    positions=[place - 0.4 + (index + 0.5) * width],
                    widths=0.85 * width,
                    patch_artist=True,
                    medianprops={"color": INK},
                )
                drawn["boxes"][0].set(facecolor=color, alpha=0.6, edgecolor=INK)
        style_axes(field)
        field.set_title(mission, fontsize=11, color=INK)
        field.set_xticks([0, 1], ["as\ndesigned", "pseudo-\nreality"])
    handles = [
        figure.axes[0].fill([], [], color=color, alpha=0.6, label=kind)[0]
        for kind, color in zip(kinds(found), COLORS, strict=False)
    ]
    figure.supylabel("mean fitness (more is better)", fontsize=11, color=INK)
    figure.legend(handles=handles, loc="outside lower center", fontsize=11, frameon=False, ncols=len(handles))
    return figure


def made(
    folder: Path, missions: Sequence[str], compared: Sequence[str], budget: int, repetitions: int
) -> list[Design]:
    """Design and score what has no scores in the folder yet; return all that were asked for."""
    file = folder / f"designs-{budget}.json"
    about = (
        f"Designs with {budget} episodes in the arena: 20 e-pucks, 120 s; means of {EPISODES} held-out "
        "episodes, and of as many in the pseudo-reality. "
        f"python -m benchmarks.designs FOLDER --budget {budget}"
    )
    found = {one.key: one for one in (read(file, Design) if file.exists() else ())}
    for repetition in range(1, repetitions + 1):
        for mission in missions:
            for kind in compared:
                if (mission, kind, repetition) in found:
                    continue
                one = design(folder, mission, kind, budget, repetition)
                found[one.key] = one
                write(found.values(), file, about)
                print(one, flush=True)
    return [
        found[mission, kind, repetition]
        for repetition in range(1, repetitions + 1)
        for mission in missions
        for kind in compared
    ]


def main() -> None:
    """Design what the command line asks for."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.designs", description=__doc__)
    parser.add_argument("folder", type=Path, metavar="FOLDER")
    parser.add_argument(
        "--budget", type=int, default=20_000, metavar="N", help="episodes of a design; default: %(default)s"
    )
    parser.add_argument("--repetitions", type=int, default=10, metavar="N", help="default: %(default)s")
    parser.add_argument("--missions", default=",".join(MISSIONS), metavar="A,B", help="default: %(default)s")
    parser.add_argument(
        "--designs",
        default=",".join(COMPARED),
        metavar="A,B",
        help=f"of {', '.join(DESIGNS)}; default: %(default)s",
    )
    parser.add_argument("--draw", type=Path, metavar="FILE", help="design nothing, show what is in a file")
    arguments = parser.parse_args()
    compared = arguments.designs.split(",")
    if len(compared) < 2 or not set(compared) <= set(DESIGNS):
        parser.error(f"--designs: expected two or more of {', '.join(DESIGNS)}")
    arguments.folder.mkdir(parents=True, exist_ok=True)
    if arguments.draw is not None:
        found, name = list(read(arguments.draw, Design)), arguments.draw.stem
    else:
        missions = arguments.missions.split(",")
        found = made(arguments.folder, missions, compared, arguments.budget, arguments.repetitions)
        name = f"designs-{arguments.budget}"
    print(*table(found), sep="\n")
    draw(found).savefig(arguments.folder / f"{name}.png")


if __name__ == "__main__":
    main()
