"""One run of ten million evaluations: its memory, its file, how it goes on, and how it is looked at."""

import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from benchmarks.measurement import Samples
from benchmarks.processes import PROGRAM, ROOT, output
from swarmwright import Experiment

POPULATION = 4096
EVALUATIONS = 10_000_000
PARTS = 10
"""The memory of the run is compared with that of one that is so many times shorter."""

_RUN = """
import json, os, sys, time, swarmwright
from benchmarks.long import evolution
from benchmarks.processes import peak_memory
generations, folder = int(sys.argv[1]), sys.argv[2]
start, used = time.perf_counter(), time.process_time()
if os.path.exists(folder):
    swarmwright.resume(folder, generations=generations)
else:
    swarmwright.optimize(evolution(generations), out=folder)
print(json.dumps([time.perf_counter() - start, time.process_time() - used, peak_memory(os.getpid())]))
"""


def evolution(generations: int) -> Experiment:
    """Minisim with a 4-8-1 network, 49 genes."""
    values = {"simulation": "minisim", "servers": "local", "controller": {"kind": "layered", "hidden": [8]}}
    method = {"kind": "openai_es", "population": POPULATION, "generations": generations}
    return Experiment.from_mapping({**values, "method": method})


class LongSuite:
    """The run is made once; it goes on by a generation and is looked at in each repetition."""

    def __init__(self, smaller: int = 1) -> None:
        self._generations = max(EVALUATIONS // POPULATION // smaller, PARTS)
        self._folder = tempfile.TemporaryDirectory()
        self._path = Path(self._folder.name) / "run"
        name = f"{self._generations * POPULATION:,} evaluations"
        self._made = Samples(f"{name} of openai_es in one run", "s")
        short = Samples(f"peak memory of a run with 1/{PARTS} of them", "MB")
        self._peaks = short, Samples(f"peak memory, {name}", "MB", short, "<= 1.1")
        self._bytes = Samples(f"the run's file, {name}", "bytes/evaluation")
        self._resume = Samples(f"resume after {name}", "s", aim="<= 10 s")
        self._processor = Samples(f"resume after {name}, processor time", "s")
        self._show = Samples(f"swarmwright runs show, {name}", "s", aim="<= 1 s")

    def repeat(self) -> None:
        """Take one sample of everything that varies."""
        if not self._made.values:
            _, _, memory = _run(self._generations // PARTS, self._path.with_name("short"))
            self._peaks[0].add(memory)
            seconds, _, memory = _run(self._generations, self._path)
            self._made.add(seconds)
            self._peaks[1].add(memory)
            size = sum(file.stat().st_size for file in self._path.iterdir())
            self._bytes.add(size / self._generations / POPULATION)
        self._generations += 1
        seconds, processor, _ = _run(self._generations, self._path)
        self._resume.add(seconds)
        self._processor.add(processor)
        start = time.perf_counter()
        output(*PROGRAM, "runs", "show", str(self._path), cwd=ROOT)
        self._show.add(time.perf_counter() - start)

    def samples(self) -> list[Samples]:
        """Everything measured, in the order of the table."""
        return [self._made, *self._peaks, self._bytes, self._resume, self._processor, self._show]

    def close(self) -> None:
        """Remove the runs."""
        self._folder.cleanup()


def _run(generations: int, folder: Path) -> tuple[float, float, float]:
    """Make a run, or go on with it; return seconds, those of processors, and the peak memory in MB."""
    arguments = [sys.executable, "-c", _RUN, str(generations), str(folder)]
    environment = {**os.environ, "SWARMWRIGHT_PLOT": "0"}
    result = subprocess.run(arguments, cwd=ROOT, check=True, capture_output=True, text=True, env=environment)
    seconds, processor, memory = json.loads(result.stdout)
    return seconds, processor, memory
