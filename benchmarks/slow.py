"""Rankings with a slow simulation, against evolution on one of the two alone.

`python -m benchmarks.slow [--repetitions N] [--first-seed S] [--method KIND]` evolves controllers of Minisim.
The fast simulation has fixed places of agents and defenders, the slow one random places and faster
defenders; both take the same time here, only the number of slow evaluations counts. What comes out is scored
in EPISODES other episodes of the slow simulation. Prints medians, quartiles and Wilcoxon's signed-rank tests.
"""

import argparse
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from swarmwright import Experiment, Run, evaluate, optimize
from swarmwright.common.arrays import Genomes

FAST: dict[str, Any] = {"placement": "fixed", "numAgents": 2, "numDefenders": 2, "speedDefenders": 0.6}
SLOW: dict[str, Any] = {"placement": "random", "speedDefenders": 0.7}
RANKING: dict[str, Any] = {"episodes": 5, "seeds": "new"}
POPULATION, GENERATIONS = 30, 100
EPISODES = 400
"""Of the slow simulation, by which designs are compared, from seed FIRST on."""
FIRST, SELECTION = 10_000_000, 5_000_000
"""Seeds that evolution does not have; the second ones are those by which controllers are selected."""


def experiment(**changes: Any) -> Experiment:
    """Return the experiment on the fast simulation alone, changed."""
    values: dict[str, Any] = {
        "simulation": "minisim",
        "parameters": FAST,
        "ranking": RANKING,
        "servers": "local",
        "validate": False,
    }
    return Experiment.from_mapping({**values, **changes})


def slow_fitness(genomes: Genomes, first: int, episodes: int) -> NDArray[np.float64]:
    """Return the mean fitness of genomes in the slow simulation, (candidates,)."""
    parameters = {**FAST, **SLOW, "seed": first}
    return evaluate(experiment(parameters=parameters, ranking={"episodes": episodes}), genomes)


def selected(run: Run, count: int) -> Genomes:
    """Return the genome, of the best ones of a run, that is best in the slow simulation; (1, genome_size)."""
    leading = [one.genome for one in run._store.leading(count)]
    genomes: Genomes = np.stack(leading)
    best = int(np.argmax(slow_fitness(genomes, SELECTION, RANKING["episodes"])))
    return genomes[best : best + 1]


def designs(seed: int, method: dict[str, Any], folder: Path) -> Iterator[tuple[str, int, Genomes]]:
    """Yield what came out: its name, the slow evaluations that it took, its genome, (1, genome_size)."""

    def run_of(name: str, **changes: Any) -> Run:
        return optimize(experiment(seed=seed, **{"method": method, **changes}), out=folder / name)

    both = {**RANKING, "slow": {"name": "slow", "parameters": SLOW}}
    allowed = 0
    for kind, options in RANKINGS.items():
        run = run_of(kind, ranking={"kind": kind, **both, **options})
        allowed = max(allowed, run.slow_evaluations)
        yield kind, run.slow_evaluations, run.evaluation().genome[np.newaxis]
    fast = run_of("fast")
    yield "fast alone", 0, fast.evaluation().genome[np.newaxis]
    yield "fast, its best selected on slow", allowed, selected(fast, allowed)
    few = {**method, "generations": 1_000_000, "evaluations": allowed}
    slow = run_of("slow", method=few, parameters={**FAST, **SLOW})
    yield "slow alone", slow.evaluations, slow.evaluation().genome[np.newaxis]
    slow = run_of("all", parameters={**FAST, **SLOW})
    yield "slow alone, every evaluation", slow.evaluations, slow.evaluation().genome[np.newaxis]


RANKINGS: dict[str, dict[str, Any]] = {
    "multi_fidelity": {"share": 0.1},
    "transferability": {"transfers": 2, "threshold": 0.5},
}


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repetitions", type=int, default=40)
    parser.add_argument("--first-seed", type=int, default=101)
    parser.add_argument("--method", default="nnga")
    arguments = parser.parse_args()
    os.environ.setdefault("SWARMWRIGHT_PLOT", "0")
    method = {"kind": arguments.method, "population": POPULATION, "generations": GENERATIONS}
    found: dict[str, list[float]] = {}
    used: dict[str, list[int]] = {}
    for seed in range(arguments.first_seed, arguments.first_seed + arguments.repetitions):
        with tempfile.TemporaryDirectory() as folder:
            for name, evaluations, genome in designs(seed, method, Path(folder)):
                found.setdefault(name, []).append(float(slow_fitness(genome, FIRST, EPISODES)[0]))
                used.setdefault(name, []).append(evaluations)
    for name, values in found.items():
        low, middle, high = np.quantile(values, [0.25, 0.5, 0.75])
        text = f"{name}: median {middle:.2f} (quartiles {low:.2f} to {high:.2f})"
        text += f", {int(np.median(used[name]))} slow evaluations"
        for kind in RANKINGS:
            if kind != name:
                better = sum(a > b for a, b in zip(found[kind], values, strict=True))
                p = stats.wilcoxon(found[kind], values).pvalue
                text += f"; {kind} is better {better} of {len(values)} times, p {p:.2g}"
        print(text)


if __name__ == "__main__":
    main()
