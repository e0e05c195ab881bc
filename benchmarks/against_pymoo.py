"""Hypervolume of `nsga2` and `nsga3` against pymoo, with equal evaluations and operators.

`python -m benchmarks.against_pymoo` prints the table of docs/explanation/method-benchmarks.md.
"""

import statistics
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmwright.controllers import REPRESENTATIONS
from swarmwright.methods import METHODS

Points = NDArray[np.float64]
SEEDS = range(1, 12)


@dataclass(frozen=True)
class Case:
    """A problem of pymoo, and how much is evaluated."""

    kind: str
    problem: str
    objectives: int = 2
    population: int = 100
    generations: int = 200
    partitions: int = 0
    """Of the reference directions of NSGA-III."""

    @property
    def _problem(self) -> Any:
        from pymoo.problems import get_problem

        if self.problem.startswith("dtlz"):
            genes = self.objectives + (4 if self.problem == "dtlz1" else 9)
            return get_problem(self.problem, n_var=genes, n_obj=self.objectives)
        return get_problem(self.problem)

    def _volume(self, costs: Points) -> float:
        """Return the hypervolume up to 1.1 times the ends of the front, as a share of the front's."""
        from pymoo.indicators.hv import Hypervolume

        front = (
            self._problem.pareto_front(self._directions) if self.partitions else self._problem.pareto_front()
        )
        volume = Hypervolume(ref_point=front.min(axis=0) + 1.1 * (front.max(axis=0) - front.min(axis=0)))
        return float(volume(costs)) / float(volume(front))

    @property
    def _directions(self) -> Any:
        from pymoo.util.ref_dirs import get_reference_directions

        return get_reference_directions("das-dennis", self.objectives, n_partitions=self.partitions)

    def ours(self, seed: int) -> float:
        """Return the hypervolume of the last members."""
        problem = self._problem
        names = [f"f{number}" for number in range(1, self.objectives)]
        parameters = {
            f"x{gene}": {"type": "real", "range": [float(low), float(high)]}
            for gene, (low, high) in enumerate(zip(problem.xl, problem.xu, strict=True))
        }
        kind = REPRESENTATIONS.get("parameter_set")
        representation = kind(
            kind.options_model.model_validate({"parameters": parameters}), sensors=0, actuators=0
        )
        component = METHODS.get(self.kind)
        options: dict[str, Any] = {
            "population": self.population,
            "generations": self.generations,
            "objectives": dict.fromkeys(names, "minimize"),
        }
        if self.partitions:
            options["partitions"] = self.partitions
        method: Any = component(component.options_model.model_validate(options), representation, seed=seed)
        while not method.done:
            genomes = method.ask().astype(np.float64)
            costs = problem.evaluate(problem.xl + genomes * (problem.xu - problem.xl))
            method.tell(-costs[:, 0], metrics=costs[:, 1:])
        return self._volume(-method._values)

    def theirs(self, seed: int) -> float:
        """Return that of pymoo."""
        from pymoo.algorithms.moo.nsga2 import NSGA2
        from pymoo.algorithms.moo.nsga3 import NSGA3
        from pymoo.optimize import minimize

        algorithm = (
            NSGA3(self._directions, pop_size=self.population)
            if self.partitions
            else NSGA2(pop_size=self.population)
        )
        found = minimize(self._problem, algorithm, ("n_gen", self.generations), seed=seed)
        return self._volume(found.pop.get("F"))


CASES = (
    *(Case("nsga2", f"zdt{number}") for number in (1, 2, 3, 4, 6)),
    Case("nsga2", "dtlz2"),
    *(Case("nsga3", f"dtlz{number}", 3, 92, 400, 12) for number in (1, 2, 4)),
    Case("nsga3", "dtlz2", 5, 212, 300, 6),
)


def rows(cases: tuple[Case, ...] = CASES) -> Iterator[str]:
    """Yield the lines of the table, in Markdown: means over the seeds and standard errors."""
    yield "| method, problem | Swarmwright | pymoo |"
    yield "|---|---|---|"
    for case in cases:
        figures = []
        for run in (case.ours, case.theirs):
            volumes = [run(seed) for seed in SEEDS]
            error = statistics.stdev(volumes) / len(volumes) ** 0.5
            figures.append(f"{statistics.mean(volumes):.4f} ± {error:.4f}")
        name = f"`{case.kind}`, {case.problem.upper()}, {case.objectives} objectives"
        yield f"| {name} | {' | '.join(figures)} |"


if __name__ == "__main__":
    for line in rows():
        print(line, flush=True)
