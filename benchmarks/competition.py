"""The matrix of champions: matches of all against all, and the same controllers in a plain evaluation."""

import time
from typing import Any

import numpy as np

from benchmarks.measurement import Samples
from swarmwright import Experiment
from swarmwright.analysis.competition import assess
from swarmwright.runs.matches import play_all, slices_of
from swarmwright.servers.evaluation.base import Controllers
from swarmwright.servers.evaluation.opening import open_backend

CHAMPIONS = 200
"""Of each side."""
EPISODES = 5
ROBOTS = 8
"""Of both sides."""
SECONDS = 30
TICKS = 10
"""In a second."""
EXPERIMENT: dict[str, Any] = {
    "simulation": "arena",
    "parameters": {"mission": "pursuit", "duration": SECONDS},
    "populations": {
        "predators": {"controller": {"hidden": [6]}},
        "prey": {"controller": {"hidden": [4]}},
    },
    "ranking": {"pairing": "best"},
    "method": {"generations": 1},
    "servers": "in-process",
}


class CompetitionSuite:
    """Pursuit with four robots a side, in this process. scale: divides the number of champions."""

    def __init__(self, scale: int = 1) -> None:
        self._champions = max(2, CHAMPIONS // scale)
        self._experiment = Experiment.from_mapping(EXPERIMENT)
        self._representation = self._experiment.representation()
        low, high = self._representation.initial_range
        size = (self._champions, self._representation.genome_size)
        self._genomes = np.random.default_rng(1).uniform(low, high, size).astype(np.float32)
        words = f"pursuit, 2 x 4 robots, {SECONDS} s, {self._champions} champions a side, {EPISODES} episodes"
        self._plain = Samples(f"{words}, plain evaluation", "robot-steps/s")
        self._matrix = Samples(f"{words}, matrix", "robot-steps/s", self._plain, ">= 0.7")
        self._assessed = Samples(f"{words}, matrix with statistics", "robot-steps/s", self._plain, ">= 0.7")

    def repeat(self) -> None:
        """Take one sample of everything."""
        steps = self._champions**2 * EPISODES * ROBOTS * SECONDS * TICKS
        firsts, seconds = np.divmod(np.arange(self._champions**2), self._champions)
        own, other = slices_of(self._experiment).values()
        joined = np.concatenate([self._genomes[firsts, own], self._genomes[seconds, other]], axis=1)
        start = time.perf_counter()
        with open_backend(self._experiment, metrics=("prey_fitness",)) as backend:
            controllers = Controllers.from_genomes(self._representation, joined)
            plain = backend.evaluate(controllers, range(EPISODES), lambda *_: None)
        self._plain.add(steps / (time.perf_counter() - start))
        start = time.perf_counter()
        fitness = play_all(self._experiment, self._genomes, "predators", range(EPISODES))
        self._matrix.add(steps / (time.perf_counter() - start))
        assert np.array_equal(fitness[..., 0].ravel(), plain.fitness.ravel())
        for side in (0, 1):
            values = fitness[..., side].swapaxes(0, 1) if side else fitness[..., side]
            assess("", range(self._champions), values)
        self._assessed.add(steps / (time.perf_counter() - start))

    def samples(self) -> list[Samples]:
        """Everything measured, in the order of the table."""
        return [self._plain, self._matrix, self._assessed]

    def close(self) -> None:
        """Nothing is left open."""
