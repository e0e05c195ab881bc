"""What a method costs: asking for candidates and telling their fitness, without any evaluation."""

import statistics
import time

import numpy as np

from benchmarks.measurement import Samples
from swarmwright.controllers import REPRESENTATIONS
from swarmwright.methods import METHODS, Method

CANDIDATES = 1000
SENSORS, HIDDEN, ACTUATORS = 9, 9, 1
"""Of a layered network of 100 genes."""


def new(kind: str, generations: int) -> Method:
    """A method with CANDIDATES candidates of 100 genes."""
    layered = REPRESENTATIONS.get("layered")
    representation = layered(
        layered.options_model.model_validate({"hidden": [HIDDEN]}), sensors=SENSORS, actuators=ACTUATORS
    )
    assert representation.genome_size == 100
    method = METHODS.get(kind)
    options = method.options_model.model_validate({"population": CANDIDATES, "generations": generations})
    return method(options, representation, seed=1)


def ask_and_tell(kind: str, generations: int) -> float:
    """Milliseconds of a generation: the median of all but the first."""
    method = new(kind, generations)
    seconds = []
    while not method.done:
        start = time.perf_counter()
        genomes = method.ask()
        asked = time.perf_counter() - start
        fitness = -np.abs(genomes).sum(axis=1, dtype=np.float64)
        start = time.perf_counter()
        method.tell(fitness)
        seconds.append(asked + time.perf_counter() - start)
    return statistics.median(seconds[1:]) * 1e3


class MethodSuite:
    """Each method that has a population, one generation of it."""

    def __init__(self, scale: int = 1) -> None:
        self._generations = 2 + 100 // scale
        self._samples = {
            kind: Samples(f"{kind}: ask and tell, {CANDIDATES} candidates x 100 genes", "ms", aim=aim)
            for kind, aim in (("nnga", "<= 2 ms"), ("random_search", ""))
        }

    def repeat(self) -> None:
        """Take one sample of everything."""
        for kind, samples in self._samples.items():
            samples.add(ask_and_tell(kind, self._generations))

    def samples(self) -> list[Samples]:
        """Everything measured, in the order of the table."""
        return list(self._samples.values())

    def close(self) -> None:
        """Nothing is left open."""
