"""What keeping every evaluation costs: the store's share of a run, and memory as runs grow longer."""

import itertools
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any
from unittest.mock import patch

from benchmarks.measurement import Samples
from benchmarks.processes import ROOT
from swarmwright import Experiment, optimize
from swarmwright.runs import picture
from swarmwright.runs.store import StoreWriter
from swarmwright.servers.evaluation.base import Controllers
from swarmwright.servers.evaluation.opening import open_backend

CANDIDATES = 1000
EVALUATION = 1e-3
"""Seconds that an evaluation is to take, at least."""
LARGE = 4_096
"""Candidates of a run whose evaluations take next to no time."""
LENGTHS = (100, 1000)
"""Generations of the runs whose memory is compared."""

_PEAK = """
import os, sys, swarmwright
from benchmarks.processes import peak_memory
from benchmarks.store import tiny
swarmwright.optimize(tiny(int(sys.argv[1]), int(sys.argv[2])), out=sys.argv[3])
print(peak_memory(os.getpid()))
"""


def slow(steps: int, candidates: int, generations: int) -> Experiment:
    """A swarm that neither arrives nor is caught: an evaluation takes as long as it has steps."""
    parameters: dict[str, Any] = {
        "numAgents": 30, "numDefenders": 30, "placement": "random", "mapWidth": 200, "mapHeight": 200,
        "goalRadius": 0, "captureRadius": 0, "speedDefenders": 0.1, "maxSteps": steps,
    }  # fmt: skip
    return _experiment(parameters, {"kind": "random_search"}, candidates, generations)


def tiny(candidates: int, generations: int) -> Experiment:
    """One agent, one step."""
    return _experiment({"maxSteps": 1}, {"kind": "nnga"}, candidates, generations)


def _experiment(
    parameters: dict[str, Any], method: dict[str, Any], candidates: int, generations: int
) -> Experiment:
    values = {"simulation": "minisim", "servers": "local", "parameters": parameters}
    return Experiment.from_mapping(
        {**values, "method": {**method, "population": candidates, "generations": generations}}
    )


class StoreSuite:
    """The store of a run whose evaluations take a millisecond, and the memory of long runs."""

    def __init__(self, smaller: int = 1) -> None:
        self._candidates = max(CANDIDATES // smaller, 10)
        self._lengths = [max(length // smaller, 2) for length in LENGTHS]
        self._steps = 0
        wall = Samples(f"a generation of {self._candidates} evaluations of 1 ms, local", "ms")
        share = Samples("storing it, share of its time", "%", aim="<= 5 %")
        short, long = (
            Samples(f"peak memory, {length} generations of {self._candidates}", "MB")
            for length in self._lengths
        )
        long.against, long.aim = short, "<= 1.1"
        self._wall, self._share, self._peaks = wall, share, (short, long)
        self._large = max(LARGE // smaller, 16)
        shape = f"openai_es, {self._large:,} x 100 of Minisim, processor time"
        self._bare = Samples(f"{shape}, nothing kept", "s")
        self._whole = Samples(f"{shape}, with the record", "s", self._bare)
        self._cost = Samples("the record, share of it", "%", aim="<= 25 %")

    def repeat(self) -> None:
        """Take one sample of the store's share; memory is measured once, for it does not vary."""
        with tempfile.TemporaryDirectory() as name:
            if not self._steps:
                self._steps = self._calibrate(Path(name))
            wall, commit = _shares(slow(self._steps, self._candidates, 3), Path(name) / "run")
            self._wall.add(wall * 1e3)
            self._share.add(commit / wall * 100)
            bare, whole = _bare_and_whole(self._large, Path(name) / "large")
            self._bare.add(bare)
            self._whole.add(whole)
            self._cost.add((whole - bare) / whole * 100)
            if not self._peaks[0].values:
                for samples, length in zip(self._peaks, self._lengths, strict=True):
                    samples.add(_peak(self._candidates, length, Path(name) / f"peak-{length}"))

    def _calibrate(self, folder: Path) -> int:
        """Return the steps by which an evaluation takes EVALUATION."""
        steps = 500
        wall, _ = _shares(slow(steps, self._candidates, 2), folder / "calibration")
        return max(1, round(steps * EVALUATION * self._candidates / wall))

    def samples(self) -> list[Samples]:
        """Everything measured, in the order of the table."""
        return [self._wall, self._share, self._bare, self._whole, self._cost, *self._peaks]

    def close(self) -> None:
        """Nothing is left open."""


def _shares(experiment: Experiment, folder: Path) -> tuple[float, float]:
    """Return the seconds of a generation, and those of its commit: medians of all but the first."""
    commits: list[float] = []
    ends: list[float] = []
    commit = StoreWriter.commit

    def timed(*arguments: Any) -> None:
        start = time.perf_counter()
        commit(*arguments)
        ends.append(time.perf_counter())
        commits.append(ends[-1] - start)

    with patch.object(StoreWriter, "commit", timed):
        optimize(experiment, out=folder)
    spans = [after - before for before, after in itertools.pairwise(ends)]
    return statistics.median(spans), statistics.median(commits[1:])


def _bare_and_whole(candidates: int, folder: Path) -> tuple[float, float]:
    """Return the processor time of a run of which nothing is kept, and of `optimize`."""
    method = {"kind": "openai_es", "population": candidates, "generations": 100}
    experiment = Experiment.from_mapping(
        {"simulation": "minisim", "servers": "in-process", "method": method, "validate": False}
    )
    start = time.process_time()
    with open_backend(experiment) as backend:
        representation = experiment.representation(backend.sensors, backend.actuators)
        search, ranking = experiment.new_method(representation), experiment.new_ranking()
        seeds = ranking.seeds(experiment.first_seed)
        while not search.done:
            controllers = Controllers.from_genomes(representation, search.ask())
            search.tell(ranking.score(backend.evaluate(controllers, seeds, lambda *_: None).fitness))
    bare = time.process_time() - start
    start = time.process_time()
    optimize(experiment, out=folder)
    whole = time.process_time() - start
    picture.wait()
    return bare, whole


def _peak(candidates: int, generations: int, folder: Path) -> float:
    """Return the largest resident memory, in MB, of a process that makes a run."""
    arguments = [sys.executable, "-c", _PEAK, str(candidates), str(generations), str(folder)]
    result = subprocess.run(arguments, cwd=ROOT, check=True, capture_output=True, text=True)
    return float(result.stdout)
