"""HyperNEAT on object discrimination: `python -m benchmarks.hyperneat [RUNS [WIDTH]]`.

Prints the table of docs/explanation/method-benchmarks.md. After Stanley, D'Ambrosio and Gauci (2009), but
smaller: a square of 3 x 3 pixels and one of a single pixel are somewhere in a field, and do not overlap;
there is a sensor and an actuator for each pixel, and the actuator in the middle of the large square should
be the most active one. The fitness is minus the mean squared distance over all scenes. All methods have the
same number of evaluations, and their default populations.
"""

import statistics
import sys
import time
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmwright import Controller, Experiment
from swarmwright.controllers import Representation

EVALUATIONS = 15_000
LIT = 0.1
"""Reading of a lit pixel: small, so that activation functions do not saturate."""
CASES: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
    "`hyperneat` by `neat`": ({"kind": "hyperneat", "hidden": []}, {"kind": "neat", "threshold": 4.0}),
    "`hyperneat`, faster growth, by `neat`": (
        {"kind": "hyperneat", "hidden": [], "add_node": 0.1, "add_connection": 0.2},
        {"kind": "neat", "severity": 0.7, "species": 12},
    ),
    "`hyperneat` with `length` by `neat`": (
        {"kind": "hyperneat", "hidden": [], "length": True},
        {"kind": "neat", "threshold": 4.0},
    ),
    "`neat` by `neat`": ({"kind": "neat", "max_nodes": 20, "output_activation": "tanh"}, {"kind": "neat"}),
    "`layered` by `cma_es`": ({"kind": "layered", "hidden": []}, {"kind": "cma_es"}),
    "`layered` by `sep_cma_es`": ({"kind": "layered", "hidden": []}, {"kind": "sep_cma_es"}),
}
LARGE_WIDTH = 11
"""Width of the field for which found patterns are decoded anew, as in the paper."""


def make_scenes(width: int) -> tuple[NDArray[np.float32], NDArray[np.int64]]:
    """Return the pixels of every scene, (scenes, width ** 2), and the column and row of each large square."""
    scenes, centers = [], []
    for row, column in product(range(1, width - 1), repeat=2):
        field = np.zeros((width, width), dtype=np.float32)
        field[row - 1 : row + 2, column - 1 : column + 2] = LIT
        for small in np.flatnonzero(field == 0):
            scene = field.ravel().copy()
            scene[small] = LIT
            scenes.append(scene)
            centers.append((column, row))
    return np.array(scenes), np.array(centers)


def grid(width: int) -> list[list[float]]:
    """Return the positions of pixels."""
    return [
        [2 * column / (width - 1) - 1, 2 * row / (width - 1) - 1]
        for row, column in product(range(width), repeat=2)
    ]


def distances(representation: Representation, genome: NDArray[np.float32], width: int) -> NDArray[np.float64]:
    """Return how far the most active actuator is from the middle of the large square, for each scene."""
    scenes, centers = make_scenes(width) if width != _SCENES[0] else _SCENES[1]
    specification = representation.specification(genome)
    if specification["kind"] == "layered":  # without hidden nodes; the activation does not change the order
        rows = np.array(specification["weights"], dtype=np.float64).reshape(width**2, -1)
        outputs = scenes @ rows[:, 1:].T + rows[:, 0]
    else:
        outputs = Controller(specification)(scenes)
    active = outputs.argmax(axis=1)
    offsets = np.stack([active % width, active // width], axis=1) - centers
    away: NDArray[np.float64] = np.hypot(offsets[:, 0], offsets[:, 1], dtype=np.float64)
    return away


_SCENES: tuple[int, Any] = (0, None)


def solve(case: str, width: int, seed: int) -> tuple[float, float, float | None]:
    """Return mean distance and share of exact scenes of the best genome; its distance in a large field."""
    controller, method = CASES[case]
    if controller["kind"] == "hyperneat":
        controller = {**controller, "sensor_positions": grid(width), "actuator_positions": grid(width)}
    size = width**2
    experiment = Experiment.from_mapping(
        {"simulation": "pixels", "sensors": size, "actuators": size, "seed": seed, "controller": controller,
         "method": {**method, "generations": EVALUATIONS}}
    )  # fmt: skip
    representation = experiment.representation()
    search = experiment.new_method(representation)
    best, best_fitness, count = None, -np.inf, 0
    while count < EVALUATIONS:
        genomes = np.asarray(search.ask())
        count += len(genomes)
        fitness = np.array([-np.mean(distances(representation, row, width) ** 2) for row in genomes])
        search.tell(fitness)
        if fitness.max() > best_fitness:
            best, best_fitness = genomes[fitness.argmax()].copy(), fitness.max()
    assert best is not None
    reached = distances(representation, best, width)
    larger = None
    if controller["kind"] == "hyperneat":
        positions = {f"{noun}_positions": grid(LARGE_WIDTH) for noun in ("sensor", "actuator")}
        options = experiment.controller.model_copy(update=positions)
        pixels = LARGE_WIDTH**2
        decoded = type(representation)(options, sensors=pixels, actuators=pixels)
        larger = float(distances(decoded, best, LARGE_WIDTH).mean())
    return float(reached.mean()), float((reached == 0).mean()), larger


def main(runs: int, width: int) -> None:
    """Print a row for each method."""
    global _SCENES  # noqa: PLW0603 - made once for all evaluations
    _SCENES = (width, make_scenes(width))
    print(
        f"{width} x {width} pixels, {len(_SCENES[1][0])} scenes, {runs} runs, {EVALUATIONS} evaluations each"
    )
    for case in CASES:
        begun = time.process_time()
        results = [solve(case, width, seed) for seed in range(1, runs + 1)]
        means = [result[0] for result in results]
        exact = statistics.fmean(result[1] for result in results)
        error = statistics.stdev(means) / runs**0.5 if runs > 1 else 0.0
        solved = sum(result[0] == 0 for result in results)
        larger = [result[2] for result in results if result[2] is not None]
        wide = f"{statistics.fmean(larger):.2f}" if larger else "-"
        print(
            f"| {case} | {statistics.fmean(means):.3f} ± {error:.3f} | {100 * exact:.0f} % | {solved} | "
            f"{wide} | {(time.process_time() - begun) / runs:.0f} s |",
            flush=True,
        )


if __name__ == "__main__":
    main(*(int(text) for text in [*sys.argv[1:3], *("10", "5")[len(sys.argv) - 1 :]]))
