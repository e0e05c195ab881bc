"""NEAT on the problems of its paper, and neat-python on XOR: `python -m benchmarks.against_neat [RUNS]`.

Prints the table of docs/explanation/method-benchmarks.md. The problems, with the paper's settings, are an
example of the engine: engine/numeric/evolution/examples/neat. neat-python has the settings of its own example
of XOR, and the same fitness and end.
"""

import importlib
import json
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

ENGINE = Path(__file__).parents[1] / "engine"
PROBLEMS = {
    "XOR": ("xor", 4755),
    "two poles, with velocities": ("velocities", 3600),
    "two poles, without velocities": ("positions", 33184),
}
"""Argument of the example, and the mean number of evaluations in the paper."""
CASES = (((0.0, 0.0), 0.0), ((0.0, 1.0), 1.0), ((1.0, 0.0), 1.0), ((1.0, 1.0), 0.0))
GENERATIONS = 200
CONFIGURATION = """[NEAT]
fitness_criterion = max
fitness_threshold = 99
pop_size = 150
reset_on_extinction = True
no_fitness_termination = True
[DefaultGenome]
activation_default = sigmoid
activation_mutate_rate = 0.0
activation_options = sigmoid
aggregation_default = sum
aggregation_mutate_rate = 0.0
aggregation_options = sum
bias_init_mean = 0.0
bias_init_stdev = 1.0
bias_max_value = 30.0
bias_min_value = -30.0
bias_mutate_power = 0.5
bias_mutate_rate = 0.7
bias_replace_rate = 0.1
compatibility_disjoint_coefficient = 1.0
compatibility_weight_coefficient = 0.5
conn_add_prob = 0.5
conn_delete_prob = 0.5
enabled_default = True
enabled_mutate_rate = 0.01
feed_forward = True
initial_connection = full_direct
node_add_prob = 0.2
node_delete_prob = 0.2
num_hidden = 0
num_inputs = 2
num_outputs = 1
response_init_mean = 1.0
response_init_stdev = 0.0
response_max_value = 30.0
response_min_value = -30.0
response_mutate_power = 0.0
response_mutate_rate = 0.0
response_replace_rate = 0.0
weight_init_mean = 0.0
weight_init_stdev = 1.0
weight_max_value = 30
weight_min_value = -30
weight_mutate_power = 0.5
weight_mutate_rate = 0.8
weight_replace_rate = 0.1
[DefaultSpeciesSet]
compatibility_threshold = 3.0
[DefaultStagnation]
species_fitness_func = max
max_stagnation = 20
species_elitism = 2
[DefaultReproduction]
elitism = 2
survival_threshold = 0.2
"""


def ours(problem: str, runs: int) -> tuple[list[int | None], float]:
    """Return the evaluations of each run, None if it failed, and the processor seconds of a run."""
    command = [
        "cargo",
        "run",
        "--quiet",
        "--release",
        "-p",
        "swarmwright-evolution",
        "--example",
        "neat",
        "--",
    ]
    subprocess.run([*command, problem, "0"], cwd=ENGINE, check=True, capture_output=True)  # compiles it
    begin = time.perf_counter()
    done = subprocess.run([*command, problem, str(runs)], cwd=ENGINE, check=True, capture_output=True)
    seconds = time.perf_counter() - begin
    results: list[int | None] = json.loads(done.stdout)
    return results, seconds / runs


def theirs(runs: int) -> tuple[list[int | None], float]:
    """Return the same of neat-python on XOR."""
    neat: Any = importlib.import_module("neat")

    with tempfile.NamedTemporaryFile("w", suffix=".ini") as file:
        file.write(CONFIGURATION)
        file.flush()
        parts = neat.DefaultGenome, neat.DefaultReproduction, neat.DefaultSpeciesSet, neat.DefaultStagnation
        config = neat.Config(*parts, file.name)
    results, begin = [], time.perf_counter()
    for seed in range(1, runs + 1):
        population = neat.Population(config, seed=seed)
        results.append(_solve(neat, population))
    return results, (time.perf_counter() - begin) / runs


def _solve(neat: Any, population: Any) -> int | None:
    count, solved = 0, None

    def evaluate(genomes: list[tuple[int, Any]], config: Any) -> None:
        nonlocal count, solved
        for _, genome in genomes:
            network = neat.nn.FeedForwardNetwork.create(genome, config)
            outputs = [(network.activate(inputs)[0], wanted) for inputs, wanted in CASES]
            genome.fitness = (4 - sum(abs(output - wanted) for output, wanted in outputs)) ** 2
            count += 1
            if solved is None and all((output > 0.5) == (wanted > 0.5) for output, wanted in outputs):
                solved = count

    for _ in range(GENERATIONS):
        population.run(evaluate, 1)
        if solved is not None:
            return solved
    return None


def row(name: str, results: list[int | None], seconds: float, paper: int) -> str:
    """Return a row of the table."""
    counts = [count for count in results if count is not None]
    error = statistics.stdev(counts) / len(counts) ** 0.5
    mean = f"{statistics.mean(counts):,.0f} ± {error:,.0f}"
    return f"| {name} | {mean} | {len(results) - len(counts)} of {len(results)} | {seconds:.2g} | {paper:,} |"


def main(runs: int) -> None:
    """Print the table."""
    print("| problem | evaluations | failed | s | paper |\n|---|---|---|---|---|")
    for name, (problem, paper) in PROBLEMS.items():
        print(row(name, *ours(problem, runs), paper), flush=True)
        if problem == "xor":
            print(row(f"{name}, neat-python", *theirs(runs), paper), flush=True)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 100)
