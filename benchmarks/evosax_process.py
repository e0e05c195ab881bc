"""A process that evolves Minisim's controllers with evosax: `python -m benchmarks.evosax_process`.

Each line on standard input is an algorithm, a population and a number of generations; the answer is a line of
JSON: seconds of the fastest of three runs, after one that compiles it. With these three as arguments it does
one run and ends.

All generations are one compiled function, the fastest way to use evosax; nothing is kept but the best.
"""

import importlib
import json
import os
import sys
import time
from collections.abc import Callable
from typing import Any

from benchmarks.jax_process import network_of_products, simulation

GENES = 49
"""Of a 4-8-1 network."""


def evolution(jax: Any, name: str, population: int, generations: int) -> Callable[[int], Any]:
    """Seed -> best fitness, of a whole run."""
    jnp = jax.numpy
    algorithms = importlib.import_module("evosax.algorithms")
    algorithm = getattr(algorithms, name)(population_size=population, solution=jnp.zeros(GENES))
    parameters = algorithm.default_params
    costs = jax.vmap(lambda weights: -simulation(jax, network_of_products(jnp))(weights))

    def start(key: Any) -> Any:
        if name in {"SimpleGA", "DifferentialEvolution", "PSO"}:
            first = jax.random.uniform(key, (population, GENES), minval=-1.0)
            return algorithm.init(key, first, costs(first), parameters)
        return algorithm.init(key, jnp.zeros(GENES), parameters)

    def generation(carried: Any, key: Any) -> Any:
        state, best = carried
        one, other = jax.random.split(key)
        candidates, state = algorithm.ask(one, state, parameters)
        found = costs(candidates)
        state, _ = algorithm.tell(other, candidates, found, state, parameters)
        return (state, jnp.minimum(best, found.min())), None

    def run(key: Any) -> Any:
        first, rest = jax.random.split(key)
        carried = start(first), jnp.inf
        (_, best), _ = jax.lax.scan(generation, carried, jax.random.split(rest, generations))
        return -best

    compiled = jax.jit(run)
    return lambda seed: compiled(jax.random.key(seed)).block_until_ready()


def seconds(work: Callable[[int], Any], seed: int) -> float:
    """How long a run takes."""
    start = time.perf_counter()
    work(seed)
    return time.perf_counter() - start


def main() -> None:
    """Answer until standard input ends, or do what the arguments say."""
    os.environ["JAX_PLATFORMS"] = "cpu"
    jax: Any = importlib.import_module("jax")
    if len(sys.argv) > 1:
        name, population, generations = sys.argv[1:]
        print(float(evolution(jax, name, int(population), int(generations))(1)))
        return
    for line in sys.stdin:
        name, population, generations = line.split()
        work = evolution(jax, name, int(population), int(generations))
        work(1)  # compiles it
        print(json.dumps(min(seconds(work, seed) for seed in (2, 3, 4))), flush=True)


if __name__ == "__main__":
    main()
