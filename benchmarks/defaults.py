"""Do the methods solve problems with their defaults, and sooner than random search?

`python -m benchmarks.defaults` prints the table of docs/explanation/method-benchmarks.md; names of methods
and problems restrict it, and `pso.population=25` sets an option.
"""

import json
import math
import statistics
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from swarmwright import Experiment, templates
from swarmwright.common.yaml import parse
from swarmwright.methods import METHODS
from swarmwright.servers.evaluation.base import Controllers
from swarmwright.servers.evaluation.opening import open_backend

SEEDS = range(1, 41)

_OTHERS = {"neat", "map_elites", "novelty", "nsga2", "nsga3", "tpe"}
KINDS = [kind for kind in METHODS.built_in if kind not in _OTHERS]
"""Without neat, which needs its own networks (`against_neat`), those that look for several candidates, and
tpe, which is for fewer evaluations than these problems need."""


@dataclass(frozen=True)
class Problem:
    """What is evolved, and when it is solved.

    experiment: keys of an experiment file, without method. target: fitness with which it is solved. budget:
    evaluations within which it has to be.
    """

    name: str
    experiment: Mapping[str, Any]
    target: float
    budget: int

    def evaluations(self, kind: str, seed: int, options: Mapping[str, Any] | None = None) -> float:
        """Return the number of the first evaluation that reaches the target; infinite beyond the budget."""
        # Restarts depend on what is left of the budget, so it is given as users give it.
        method = {"kind": kind, "evaluations": self.budget, **(options or {})}
        experiment = Experiment.from_mapping({**self.experiment, "method": method, "seed": seed})
        ranking = experiment.new_ranking()
        seeds = ranking.seeds(experiment.first_seed)
        with open_backend(experiment, servers="in-process") as backend:
            representation = experiment.representation(backend.sensors, backend.actuators)
            search = experiment.new_method(representation)
            while not search.done:
                genomes = search.ask()
                results = backend.evaluate(Controllers.from_genomes(representation, genomes), seeds, _silent)
                fitness = ranking.score(results.fitness)
                reached = np.flatnonzero(fitness >= self.target)
                if len(reached):
                    spent = search.evaluations + int(reached[0]) + 1
                    return spent if spent <= self.budget else math.inf
                if search.evaluations + len(genomes) >= self.budget:
                    break
                search.tell(fitness)
        return math.inf


def _silent(*_: object) -> None:
    """Report nothing."""


def _template(name: str) -> dict[str, Any]:
    keys = parse(templates.text(name), name).values
    return {key: keys[key] for key in ("simulation", "parameters", "controller", "ranking")}


PROBLEMS = {
    problem.name: problem
    for problem in (
        Problem("Minisim", _template("minisim"), target=-0.1, budget=2_000),
        Problem(
            "XOR",
            {
                "simulation": "benchmarks.problems:Xor",
                "controller": {"kind": "fully_meshed"},
                "ranking": {"episodes": 4, "aggregate": "sum"},
            },
            target=-0.04,
            budget=10_000,
        ),
        Problem(
            "cart-pole",
            {"simulation": "benchmarks.problems:CartPole", "ranking": {"episodes": 3, "aggregate": "worst"}},
            target=500,
            budget=2_000,
        ),
        Problem("Emergency Exit", _template("emergency_exit"), target=-60, budget=10_000),
    )
}


@dataclass
class Row:
    """What one method needed on one problem, seed by seed."""

    found: list[float] = field(default_factory=list)

    @property
    def median(self) -> float:
        """Median of the evaluations, infinite where most seeds miss the target."""
        return statistics.median(self.found)

    def __str__(self) -> str:
        solved = sum(map(math.isfinite, self.found))
        return f"{solved}, {self.median:.0f}" if math.isfinite(self.median) else f"{solved}, -"


def main(words: Sequence[str]) -> None:
    """Print a line for each method."""
    options: dict[str, dict[str, Any]] = {}
    for word in words:
        if "=" in word:
            key, value = word.split("=")
            kind, option = key.split(".")
            options.setdefault(kind, {})[option] = json.loads(value)
    kinds = [kind for kind in METHODS.built_in if kind in words] or KINDS
    problems = [one for one in PROBLEMS.values() if one.name in words] or list(PROBLEMS.values())
    print("| method |" + "".join(f" {one.name} |" for one in problems))
    print("|---" * (len(problems) + 1) + "|")
    for kind in kinds:
        rows = [Row([one.evaluations(kind, seed, options.get(kind)) for seed in SEEDS]) for one in problems]
        print(f"| `{kind}` |" + "".join(f" {row} |" for row in rows), flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
