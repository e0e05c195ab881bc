"""A process that runs Minisim in JAX and here, one after the other: `python -m benchmarks.jax_process CORES`.

It is limited to as many cores before JAX starts its threads. Each line on standard input is a number of
candidates; the answer is a line of JSON: seconds by the clock and by processor time, and for which share of
the candidates the fitness differs.
"""

import functools
import importlib
import json
import os
import sys
import time
from collections.abc import Callable
from typing import Any

STEPS, WIDTH, HEIGHT, SPEED_AGENT, SPEED_DEFENDER = 15, 13.0, 7.0, 1.0, 0.33
"""The published example, as in D6.1; see engine/worlds/worlds/src/minisim for the order of operations."""


def network_of_sums(jnp: Any) -> Callable[..., Any]:
    """4-8-1 written out as sums of products of scalars."""

    def network(weights: Any, sensors: Any) -> Any:
        hidden = []
        for node in range(8):
            row = weights[5 * node : 5 * node + 5]
            hidden.append(jnp.tanh(row[0] + sum(row[1 + j] * sensors[j] for j in range(4))))
        row = weights[40:49]
        return jnp.tanh(row[0] + sum(row[1 + j] * hidden[j] for j in range(8)))

    return network


def network_of_products(jnp: Any) -> Callable[..., Any]:
    """4-8-1 as two products of a matrix and a vector."""

    def network(weights: Any, sensors: Any) -> Any:
        rows = weights[:40].reshape(8, 5)
        hidden = jnp.tanh(rows[:, 0] + rows[:, 1:] @ jnp.stack(sensors))
        return jnp.tanh(weights[40] + weights[41:] @ hidden)

    return network


def simulation(jax: Any, network: Callable[..., Any]) -> Callable[[Any], Any]:
    """Fitness of one genome: one agent, one defender."""
    jnp = jax.numpy
    goal_x, goal_y = WIDTH - 0.5, HEIGHT / 2

    def step(weights: Any, state: Any) -> Any:
        x, y, free, arrived, defender_x, defender_y = state
        sensors = (
            (goal_x - x) / WIDTH,
            (goal_y - y) / HEIGHT,
            (defender_x - x) / WIDTH,
            (defender_y - y) / HEIGHT,
        )
        angle = jnp.pi * network(weights, sensors)
        moved_x = jnp.clip(x + SPEED_AGENT * jnp.cos(angle), 0.0, WIDTH)
        moved_y = jnp.clip(y + SPEED_AGENT * jnp.sin(angle), 0.0, HEIGHT)
        x, y = jnp.where(free, moved_x, x), jnp.where(free, moved_y, y)
        dx, dy = x - defender_x, y - defender_y
        distance = jnp.sqrt(dx * dx + dy * dy)
        factor = SPEED_DEFENDER / jnp.where(distance > 0, distance, 1.0)
        near = distance <= SPEED_DEFENDER
        next_x = jnp.where(near, x, defender_x + dx * factor)
        next_y = jnp.where(near, y, defender_y + dy * factor)
        defender_x = jnp.where(free, next_x, defender_x)
        defender_y = jnp.where(free, next_y, defender_y)
        to_goal = jnp.sqrt((goal_x - x) ** 2 + (goal_y - y) ** 2)
        arrives = free & (to_goal <= 0.5)
        caught = jnp.sqrt((defender_x - x) ** 2 + (defender_y - y) ** 2) <= 0.5
        return x, y, free & ~arrives & ~caught, arrived | arrives, defender_x, defender_y

    def fitness(weights: Any) -> Any:
        number = jnp.float32
        start = (number(0.5), number(3.5), jnp.bool_(True), jnp.bool_(False), number(8.0), number(3.5))
        end, _ = jax.lax.scan(lambda state, _: (step(weights, state), None), start, None, length=STEPS)
        x, y, _, arrived, _, _ = end
        return jnp.where(arrived, 0.0, -jnp.sqrt((goal_x - x) ** 2 + (goal_y - y) ** 2))

    return fitness


def complete(function: Callable[[Any], Any], genomes: Any) -> Any:
    """What JAX computes, once it is there."""
    return function(genomes).block_until_ready()


def timed(work: Callable[[], Any], at_least: float) -> tuple[Any, float, float]:
    """What `work` gives; seconds of a call by clock and processors, over calls of `at_least` in all."""
    result, calls = work(), 0
    clock, processor = time.perf_counter(), time.process_time()
    while calls == 0 or time.perf_counter() - clock < at_least:
        result = work()
        calls += 1
    return result, (time.perf_counter() - clock) / calls, (time.process_time() - processor) / calls


def main() -> None:
    """Answer until standard input ends."""
    cores = int(sys.argv[1])
    os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:cores])
    os.environ["JAX_PLATFORMS"] = "cpu"
    import numpy as np

    from benchmarks.rollout import minisim

    jax: Any = importlib.import_module("jax")
    jnp = jax.numpy
    # First as one writes it; then scalars instead of matrices, and weights side by side as vectors like them.
    variants = []
    for network in (network_of_products(jnp), network_of_sums(jnp)):
        one = simulation(jax, network)
        variants += [(jax.jit(jax.vmap(one)), False), (jax.jit(jax.vmap(one, in_axes=1)), True)]
    for line in sys.stdin:
        block = minisim(int(line))
        expected = block.run(threads=cores)
        answer: dict[str, float] = {"best": np.inf, "apart": 0.0}
        for function, by_weight in variants:
            genomes = jnp.asarray(block.genomes.T.copy() if by_weight else block.genomes)
            found, clock, processor = timed(functools.partial(complete, function, genomes), 0.1)
            # A distance that is a rounding away from a radius ends an episode a step later or earlier.
            agree = np.abs(np.asarray(found) - expected) <= 1e-3
            answer["apart"] = max(answer["apart"], 1 - float(agree.mean()))
            if function is variants[0][0]:
                answer |= {"plain": clock, "plain_processor": processor}
            if clock < answer["best"]:
                answer |= {"best": clock, "best_processor": processor}
        # As JAX's are compiled before, ours is prepared before.
        _, clock, processor = timed(block.kept(cores), 0.1)
        print(json.dumps({**answer, "ours": clock, "ours_processor": processor}), flush=True)


if __name__ == "__main__":
    main()
