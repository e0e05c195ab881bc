"""Hypervolume of `nsga2` and `nsga3`, and fitness of `de`, against pymoo, with equal evaluations.

`python -m benchmarks.against_pymoo` prints the tables of docs/explanation/method-benchmarks.md. With
`constraints` as its argument, it prints those of constrained problems alone.
"""

import statistics
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmwright.controllers import REPRESENTATIONS, Representation
from swarmwright.methods import METHODS
from swarmwright.methods.constraints import is_infeasible

Points = NDArray[np.float64]
SEEDS = range(1, 12)


def _represent(problem: Any) -> Representation:
    """Return the representation of a problem's variables, with genes from 0 to 1."""
    parameters = {
        f"x{gene}": {"type": "real", "range": [float(low), float(high)]}
        for gene, (low, high) in enumerate(zip(problem.xl, problem.xu, strict=True))
    }
    kind = REPRESENTATIONS.get("parameter_set")
    return kind(kind.options_model.model_validate({"parameters": parameters}), sensors=0, actuators=0)


def _sum_violations(problem: Any, points: Points) -> Points:
    """Return the violation of each point as pymoo sums it, (n,)."""
    violations = np.maximum(problem.evaluate(points, return_values_of=["G"]), 0.0)
    return np.asarray(violations.sum(axis=1))


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

        if "dtlz" in self.problem:
            genes = self.objectives + (4 if self.problem.endswith("dtlz1") else 9)
            return get_problem(self.problem, n_var=genes, n_obj=self.objectives)
        return get_problem(self.problem)

    @property
    def label(self) -> str:
        """The method and the problem."""
        return f"`{self.kind}`, {self.problem.upper()}, {self.objectives} objectives"

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
        component = METHODS.get(self.kind)
        options: dict[str, Any] = {
            "population": self.population,
            "generations": self.generations,
            "objectives": dict.fromkeys(names, "minimize"),
        }
        if self.partitions:
            options["partitions"] = self.partitions
        method: Any = component(
            component.options_model.model_validate(options), _represent(problem), seed=seed
        )
        while not method.done:
            genomes = method.ask().astype(np.float64)
            points = problem.xl + genomes * (problem.xu - problem.xl)
            costs = problem.evaluate(points, return_values_of=["F"])
            more = {"violations": _sum_violations(problem, points)} if problem.n_ieq_constr else {}
            method.tell(-costs[:, 0], metrics=costs[:, 1:], **more)
        values = method._values
        return self._volume(-values[~is_infeasible(values[:, 0])])

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
        result = minimize(self._problem, algorithm, ("n_gen", self.generations), seed=seed)
        return self._volume(result.pop.get("F")[result.pop.get("CV")[:, 0] <= 0])


@dataclass(frozen=True)
class Constrained:
    """A problem of pymoo with constraints and one objective."""

    problem: str
    population: int = 100
    generations: int = 300

    @property
    def label(self) -> str:
        """The method and the problem."""
        return f"`de`, {self.problem.upper()}"

    @property
    def _problem(self) -> Any:
        from pymoo.problems import get_problem

        return get_problem(self.problem)

    def ours(self, seed: int) -> float:
        """Return the least cost of a feasible candidate, above the optimum."""
        problem = self._problem
        kind = METHODS.get("de")
        options = kind.options_model.model_validate(
            {"population": self.population, "generations": self.generations}
        )
        method: Any = kind(options, _represent(problem), seed=seed)
        best = np.inf
        while not method.done:
            points = problem.xl + method.ask().astype(np.float64) * (problem.xu - problem.xl)
            costs = problem.evaluate(points, return_values_of=["F"])[:, 0]
            violations = _sum_violations(problem, points)
            best = min(best, costs[violations == 0].min(initial=np.inf))
            method.tell(-costs, violations=violations)
        return float(best - problem.pareto_front()[0, 0])

    def theirs(self, seed: int) -> float:
        """Return that of pymoo."""
        from pymoo.algorithms.soo.nonconvex.de import DE
        from pymoo.optimize import minimize

        # The defaults are those of `de`.
        result = minimize(self._problem, DE(pop_size=self.population), ("n_gen", self.generations), seed=seed)
        return np.inf if result.F is None else float(result.F[0] - self._problem.pareto_front()[0, 0])


CASES = (
    *(Case("nsga2", f"zdt{number}") for number in (1, 2, 3, 4, 6)),
    Case("nsga2", "dtlz2"),
    *(Case("nsga3", f"dtlz{number}", 3, 92, 400, 12) for number in (1, 2, 4)),
    Case("nsga3", "dtlz2", 5, 212, 300, 6),
)
CONSTRAINED: tuple[Case | Constrained, ...] = (
    Case("nsga2", "bnh", generations=100),
    Case("nsga3", "c1dtlz1", 3, 92, 500, 12),
    Case("nsga3", "c2dtlz2", 3, 92, 250, 12),
    *(Constrained(problem) for problem in ("g1", "g4", "g6")),
)


def rows(cases: tuple[Case | Constrained, ...] = CASES) -> Iterator[str]:
    """Yield the lines of the table, in Markdown: means over the seeds and standard errors."""
    yield "| method, problem | Swarmwright | pymoo |"
    yield "|---|---|---|"
    for case in cases:
        figures = []
        for run in (case.ours, case.theirs):
            volumes = [run(seed) for seed in SEEDS]
            error = statistics.stdev(volumes) / len(volumes) ** 0.5
            form = ".3g" if isinstance(case, Constrained) else ".4f"
            figures.append(f"{statistics.mean(volumes):{form}} ± {error:{form}}")
        yield f"| {case.label} | {' | '.join(figures)} |"


if __name__ == "__main__":
    for line in rows(CONSTRAINED if sys.argv[1:] == ["constraints"] else (*CASES, *CONSTRAINED)):
        print(line, flush=True)
