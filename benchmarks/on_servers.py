"""Whole runs of a light simulation in process and on two servers of the same machine."""

import tempfile
import time
from pathlib import Path

from benchmarks.measurement import Samples
from swarmwright import Experiment, optimize
from swarmwright.runs import picture
from swarmwright.servers.evaluation.base import Servers

SERVERS = 2
POPULATIONS = (4096, 16_384)
CANDIDATES = 1_600_000


class ServersSuite:
    """openai_es on Minisim with a 4-8-1 network. The rate is that of what a longer run has more."""

    def __init__(self) -> None:
        self._generations = {size: CANDIDATES // size for size in POPULATIONS}
        self._rates = {size: _samples(size) for size in POPULATIONS}

    def repeat(self) -> None:
        """Take one sample of everything."""
        for size, generations in self._generations.items():
            here, there = self._rates[size]
            here.add(_rate(size, generations, "in-process"))
            there.add(_rate(size, generations, SERVERS))

    def samples(self) -> list[Samples]:
        """Everything measured, in the order of the table."""
        return [one for pair in self._rates.values() for one in pair]

    def close(self) -> None:
        """Nothing is left open."""


def _samples(size: int) -> tuple[Samples, Samples]:
    name = f"openai_es, {size:,} candidates of Minisim"
    here = Samples(f"{name}, in process", "evaluations/s")
    return here, Samples(f"{name}, {SERVERS} servers", "evaluations/s", here, ">= 0.8")


def _rate(size: int, generations: int, servers: Servers) -> float:
    short, long = (_seconds(size, count, servers) for count in (generations, 3 * generations))
    return 2 * generations * size / max(long - short, 1e-9)


def _seconds(size: int, generations: int, servers: Servers) -> float:
    method = {"kind": "openai_es", "population": size, "generations": generations}
    values = {"simulation": "minisim", "controller": {"kind": "layered", "hidden": [8]}, "method": method}
    with tempfile.TemporaryDirectory() as name:
        start = time.perf_counter()
        optimize(Experiment.from_mapping(values), servers=servers, out=Path(name) / "run", progress=False)
        seconds = time.perf_counter() - start
        picture.wait()  # it is drawn beside what follows, and would take a processor of it
    return seconds
