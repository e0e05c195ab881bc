"""How many different successful behaviours do novelty search and evolution by fitness find?

`python -m benchmarks.novelty` prints the table of docs/explanation/method-benchmarks.md. The set-up follows
Gomes, Urbano and Christensen, "Evolution of swarm robotics systems with novelty search", Swarm Intelligence
7, 2013: the same genetic algorithm selects by fitness, by novelty, or by both, on aggregation.
"""

import math
import statistics
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.stats import mannwhitneyu, t

from swarmwright import Experiment
from swarmwright.methods.archive import Archive, Grid
from swarmwright.methods.novelty import NoveltyOptions
from swarmwright.servers.evaluation.base import Controllers
from swarmwright.servers.evaluation.opening import open_backend

SEEDS = range(1, 21)
SUCCESS = 0.2
"""Least mean share of the robots on the black spot of a successful behaviour."""
EXPERIMENT: dict[str, Any] = {
    "simulation": "arena",
    "parameters": {"mission": "aggregation", "robots": 7, "duration": 30},
    "fitness": "on_black / 2100",  # 7 robots in 300 ticks
    "controller": {"kind": "evostick"},
    "ranking": {"episodes": 2},
    "servers": "in-process",
}
METHOD: dict[str, Any] = {
    "kind": "novelty",
    "population": 50,
    "evaluations": 1200,
    "measures": {
        "distance_to_center": {"range": [0, 1], "bins": 10},
        "speed": {"range": [0, 0.15], "bins": 10},
    },
}
VARIANTS: dict[str, dict[str, Any]] = {
    "fitness": {"objective": "mixed", "weight": 1.0},
    "novelty": {},
    "both, weight 0.5": {"objective": "mixed"},
    "local competition": {"objective": "local_competition"},
    "novelty, criterion": {"criteria": {"fitness": {"at_least": SUCCESS}}},
    "species": {"species": {}},
    "`map_elites`": {"kind": "map_elites"},
}


@dataclass(frozen=True)
class Outcome:
    """What a run has found."""

    cells: int
    """Cells with a candidate."""
    behaviours: int
    """Cells with a successful candidate."""
    best: float
    """Highest fitness."""


def evolve(variant: str, seed: int) -> Outcome:
    """Return the outcome of one run."""
    method = {**METHOD, **VARIANTS[variant]}
    experiment = Experiment.from_mapping({**EXPERIMENT, "method": method, "seed": seed})
    ranking = experiment.new_ranking()
    names = list(METHOD["measures"])
    elites = Archive(Grid(NoveltyOptions.model_validate(METHOD).elites.axes))
    with open_backend(experiment, metrics=names) as backend:
        columns = [backend.metrics.index(name) for name in names]
        representation = experiment.representation(backend.sensors, backend.actuators)
        search = experiment.new_method(representation)
        seeds = ranking.seeds(experiment.first_seed)
        while not search.done:
            genomes = search.ask()
            if search.evaluations + len(genomes) > METHOD["evaluations"]:
                break
            results = backend.evaluate(Controllers.from_genomes(representation, genomes), seeds, _silent)
            fitness, metrics = ranking.score(results.fitness), results.metrics[:, :, columns].mean(axis=1)
            elites.add(range(len(genomes)), fitness, metrics)
            search.tell(fitness, metrics=metrics)
    return Outcome(len(elites), int((elites.fitness >= SUCCESS).sum()), float(elites.fitness.max()))


def _silent(*_: object) -> None:
    """Report nothing."""


def describe(values: Sequence[float], digits: int) -> str:
    """Return the mean and its 95 % confidence interval."""
    mean = statistics.mean(values)
    reach = float(t.ppf(0.975, len(values) - 1)) * statistics.stdev(values) / math.sqrt(len(values))
    return f"{mean:.{digits}f} ({mean - reach:.{digits}f} to {mean + reach:.{digits}f})"


def main(names: Sequence[str]) -> None:
    """Print a line for each variant."""
    print("| selection by | behaviours of 100 | successful | p | best fitness |")
    print("|---|---|---|---|---|")
    base: list[int] = []
    for variant in names or VARIANTS:
        outcomes = [evolve(variant, seed) for seed in SEEDS]
        counts = [outcome.behaviours for outcome in outcomes]
        base = base or counts
        p = "" if counts is base else f"{mannwhitneyu(counts, base).pvalue:.2g}"
        cells = describe([outcome.cells for outcome in outcomes], 1)
        best = describe([outcome.best for outcome in outcomes], 2)
        print(f"| {variant} | {cells} | {describe(counts, 1)} | {p} | {best} |", flush=True)


if __name__ == "__main__":
    np.seterr(all="raise", under="ignore")
    main(sys.argv[1:])
