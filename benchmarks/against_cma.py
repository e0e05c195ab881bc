"""Evaluations until a target: `cma_es` and `sep_cma_es` against the library cma, from the same starts.

`python -m benchmarks.against_cma` prints the table of docs/explanation/method-benchmarks.md.
"""

import statistics
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmwright.controllers import REPRESENTATIONS
from swarmwright.methods import METHODS

Points = NDArray[np.float64]
SEEDS = range(1, 12)
REACH, STEP = 3.0, 0.5
LIMIT = 100_000
"""Evaluations, after which the target is missed."""


def sphere(points: Points) -> Points:
    """Least at 0."""
    return np.asarray((points**2).sum(axis=1))


def ellipsoid(points: Points) -> Points:
    """Axes of lengths 1 to 1000; least at 0."""
    genes = points.shape[1]
    return np.asarray((10.0 ** (6 * np.arange(genes) / (genes - 1)) * points**2).sum(axis=1))


def rosenbrock(points: Points) -> Points:
    """A bent valley; least at 1, 1, ..."""
    here, after = points[:, :-1], points[:, 1:]
    return np.asarray((100 * (after - here**2) ** 2 + (1 - here) ** 2).sum(axis=1))


def rastrigin(points: Points) -> Points:
    """Many dents; least at 0."""
    return np.asarray((points**2 - 10 * np.cos(2 * np.pi * points) + 10).sum(axis=1))


@dataclass(frozen=True)
class Case:
    """What is minimized by which method."""

    kind: str
    function: Callable[[Points], Points]
    genes: int
    target: float
    population: int

    def start(self, seed: int) -> Points:
        """Return where both begin, (genes,)."""
        drawn = np.random.default_rng(seed).uniform(-REACH, REACH, self.genes)
        return drawn.astype(np.float32).astype(np.float64)  # a genome that both can have

    def ours(self, seed: int) -> float:
        """Return the evaluations of the method; infinite beyond the limit."""
        layered = REPRESENTATIONS.get("layered")
        network = layered.options_model.model_validate(
            {"hidden": [], "weight_range": REACH, "bias_range": REACH}
        )
        component = METHODS.get(self.kind)
        options = {"population": self.population, "step": STEP, "restart": "none", "evaluations": LIMIT}
        method = component(
            component.options_model.model_validate(options),
            layered(network, sensors=self.genes - 1, actuators=1),
            seed=seed,
        )
        method.start_from(self.start(seed)[np.newaxis].astype(np.float32))
        return self._evaluations(lambda: method.ask().astype(np.float64), method.tell)

    def theirs(self, seed: int) -> float:
        """Return the evaluations of the library in binary64; infinite beyond the limit."""
        import cma

        before = np.random.get_state()  # noqa: NPY002 - the library uses it
        settings = {
            "seed": seed,
            "popsize": self.population,
            "CMA_diagonal": self.kind == "sep_cma_es",
            "verbose": -9,
            "verb_log": 0,
        }
        search: Any = cma.CMAEvolutionStrategy(self.start(seed), STEP * REACH, settings)
        points: list[Points] = []

        def ask() -> Points:
            points[:] = search.ask()
            return np.stack(points)

        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            try:
                return self._evaluations(ask, lambda fitness: search.tell(points, (-fitness).tolist()))
            finally:
                np.random.set_state(before)  # noqa: NPY002

    def _evaluations(self, ask: Callable[[], Points], tell: Callable[[Points], Any]) -> float:
        evaluations = 0
        while evaluations + self.population <= LIMIT:
            values = self.function(ask())
            reached = np.flatnonzero(values <= self.target)
            if len(reached):
                return evaluations + int(reached[0]) + 1
            tell(-values)
            evaluations += self.population
        return np.inf


def cases() -> list[Case]:
    """Return those of the table. Rastrigin: with populations with which most searches find a good dent."""
    found = []
    for kind in ("cma_es", "sep_cma_es"):
        for genes in (5, 10, 20):
            usual = 4 + int(3 * np.log(genes))
            case = partial(Case, kind, genes=genes)
            found += [
                case(sphere, target=1e-6, population=usual),
                case(ellipsoid, target=1e-6, population=usual),
                case(rastrigin, target=float(genes), population=8 * genes),
                # Without directions, the bent valley takes far longer than the way to it.
                case(rosenbrock, target=1e-3 if kind == "cma_es" else float(genes), population=usual),
            ]
    return sorted(found, key=lambda case: (case.kind, case.function.__name__))


def row(case: Case) -> str:
    """Return a line of the table, in Markdown."""
    figures = []
    for evaluations in (case.ours, case.theirs):
        found = [evaluations(seed) for seed in SEEDS]
        most = "never" if np.isinf(max(found)) else f"{max(found):.0f}"
        figures.append(f"{statistics.median(found):.0f} ({min(found):.0f} to {most})")
    name, target = case.function.__name__.capitalize(), f"{case.target:g}"
    return f"| `{case.kind}` | {name}, {case.genes} genes, {target} | {figures[0]} | {figures[1]} |"


if __name__ == "__main__":
    print("| method | function, genes, target | Swarmwright | the library cma |\n|---|---|---|---|")
    for each in cases():
        print(row(each), flush=True)
