"""Evaluations until a target: evolution strategies against those of evosax, from the same starts.

`python -m benchmarks.against_strategies` prints the table of docs/explanation/method-benchmarks.md.
"""

import importlib
import statistics
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.against_cma import REACH, SEEDS, Points, ellipsoid, rastrigin, rosenbrock, sphere
from swarmwright.controllers import REPRESENTATIONS
from swarmwright.methods import METHODS

LIMIT = 200_000
"""Evaluations, after which the target is missed."""
POPULATION = {"openai_es": 20, "pgpe": 20, "snes": 20, "xnes": 20}
NOISE, STEP = 0.1, 0.03
"""Initial standard deviation and step size of Adam, of a gene."""
INITIAL = 1.5
"""Initial standard deviation of snes and xnes."""


@dataclass(frozen=True)
class Case:
    """What is minimized by which method."""

    kind: str
    function: Callable[[Points], Points]
    genes: int
    target: float

    def start(self, seed: int) -> Points:
        """Return where both begin, (genes,)."""
        drawn = np.random.default_rng(seed).uniform(-REACH, REACH, self.genes)
        return drawn.astype(np.float32).astype(np.float64)  # a genome that both can have

    @property
    def _own_options(self) -> dict[str, Any]:
        if self.kind in {"snes", "xnes"}:
            return {"step": INITIAL / REACH, "restart": "none"}
        options = {"noise": NOISE / REACH, "step": STEP / REACH}
        return {**options, "decay": 0.0} if self.kind == "openai_es" else options

    def ours(self) -> list[float]:
        """Return the evaluations of the method for each seed; infinite beyond the limit."""
        return [self._ours(seed) for seed in SEEDS]

    def _ours(self, seed: int) -> float:
        layered = REPRESENTATIONS.get("layered")
        network = layered.options_model.model_validate(
            {"hidden": [], "weight_range": REACH, "bias_range": REACH}
        )
        component = METHODS.get(self.kind)
        population = POPULATION[self.kind]
        options = {"population": population, "evaluations": LIMIT, **self._own_options}
        method = component(
            component.options_model.model_validate(options),
            layered(network, sensors=self.genes - 1, actuators=1),
            seed=seed,
        )
        method.start_from(self.start(seed)[np.newaxis].astype(np.float32))
        evaluations = 0
        while evaluations + population <= LIMIT:
            values = self.function(method.ask().astype(np.float64))
            reached = np.flatnonzero(values <= self.target)
            if len(reached):
                return evaluations + int(reached[0]) + 1
            method.tell(-values)
            evaluations += population
        return np.inf

    def theirs(self) -> list[float]:
        """Return the evaluations of evosax in binary64; infinite beyond the limit."""
        jax: Any = importlib.import_module("jax")
        jax.config.update("jax_enable_x64", True)
        algorithms: Any = importlib.import_module("evosax.algorithms")
        population, jnp = POPULATION[self.kind], jax.numpy
        middle = jnp.zeros(self.genes)
        if self.kind in {"snes", "xnes"}:
            name = {"snes": "SNES", "xnes": "xNES"}[self.kind]
            search = getattr(algorithms, name)(population_size=population, solution=middle)
            parameters = search.default_params.replace(std_init=INITIAL)
        else:
            optax: Any = importlib.import_module("optax")
            adam, constant = optax.adam(STEP), optax.constant_schedule(NOISE)
            if self.kind == "pgpe":
                search = algorithms.PGPE(population_size=population, solution=middle, optimizer=adam)
                parameters = search.default_params.replace(std_init=NOISE)
            else:
                search = algorithms.Open_ES(
                    population_size=population, solution=middle, optimizer=adam, std_schedule=constant
                )
                parameters = search.default_params
        function = _of_jax(jnp, self.function.__name__)

        def run(key: Any, start: Any) -> Any:
            def generation(carried: Any) -> Any:
                state, key, done, found = carried
                key, one, other = jax.random.split(key, 3)
                points, state = search.ask(one, state, parameters)
                values = jax.vmap(function)(points)
                reached = values <= self.target
                found = jnp.where(reached.any(), done + jnp.argmax(reached) + 1.0, found)
                state, _ = search.tell(other, points, values, state, parameters)
                return state, key, done + population, found

            def goes_on(carried: Any) -> Any:
                return jnp.isinf(carried[3]) & (carried[2] + population <= LIMIT)

            state = search.init(key, start, parameters)
            return jax.lax.while_loop(goes_on, generation, (state, key, 0.0, jnp.inf))[3]

        compiled = jax.jit(run)
        return [float(compiled(jax.random.key(seed), jnp.array(self.start(seed)))) for seed in SEEDS]


def _of_jax(jnp: Any, name: str) -> Callable[[Any], Any]:
    """Return a function of one point, for jax."""

    def function(x: Any) -> Any:
        genes = len(x)
        if name == "sphere":
            return (x**2).sum()
        if name == "ellipsoid":
            return (10.0 ** (6 * jnp.arange(genes) / (genes - 1)) * x**2).sum()
        if name == "rosenbrock":
            return (100 * (x[1:] - x[:-1] ** 2) ** 2 + (1 - x[:-1]) ** 2).sum()
        return (x**2 - 10 * jnp.cos(2 * jnp.pi * x) + 10).sum()

    return function


def cases() -> list[Case]:
    """Return those of the table. Targets are such that strategies of a fixed step reach them."""
    found = []
    for kind in POPULATION:
        adapts = kind in {"snes", "xnes"}
        for genes in (5, 10, 20):
            found += [
                Case(kind, ellipsoid, genes, 1e-6 if adapts else 100.0 * genes),
                Case(kind, rastrigin, genes, 5.0 * genes),
                Case(kind, rosenbrock, genes, float(genes)),
                Case(kind, sphere, genes, 1e-6 if adapts else 0.02 * genes),
            ]
    return sorted(found, key=lambda case: (case.kind, case.function.__name__))


def shown(found: list[float]) -> str:
    """Return the median, least and most of evaluations."""
    first, middle, last = (
        "never" if np.isinf(one) else f"{one:.0f}"
        for one in (min(found), statistics.median(found), max(found))
    )
    return f"{middle} ({first} to {last})"


def row(case: Case) -> str:
    """Return a line of the table, in Markdown."""
    what = f"{case.function.__name__.capitalize()}, {case.genes} genes, {case.target:g}"
    return f"| `{case.kind}` | {what} | {shown(case.ours())} | {shown(case.theirs())} |"


if __name__ == "__main__":
    print("| method | function, genes, target | Swarmwright | evosax |\n|---|---|---|---|")
    for each in cases():
        print(row(each), flush=True)
