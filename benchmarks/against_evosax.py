"""Whole runs against evosax: Minisim, a 4-8-1 network, warm in a process and from the command line."""

import json
import os
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from unittest.mock import patch

from benchmarks.measurement import Samples
from benchmarks.processes import PROGRAM, ROOT, output
from swarmwright import Experiment, optimize
from swarmwright.runs import picture


@dataclass(frozen=True)
class Row:
    """A method, the algorithm of evosax that is most like it, and how much both do."""

    kind: str
    algorithm: str
    population: int
    generations: int

    def __str__(self) -> str:
        """Name what is done."""
        return f"{self.population:,} x {self.generations}"

    def experiment(self) -> Experiment:
        """Return the experiment of this method."""
        method = {"kind": self.kind, "population": self.population, "generations": self.generations}
        return Experiment.from_mapping(
            {
                "simulation": "minisim",
                "controller": {"kind": "layered", "hidden": [8], "activation": "tanh"},
                "method": method,
            }
        )


ROWS = (
    Row("openai_es", "Open_ES", 256, 300),
    Row("openai_es", "Open_ES", 4_096, 100),
    Row("pgpe", "PGPE", 256, 100),
    Row("snes", "SNES", 256, 100),
    Row("xnes", "xNES", 256, 100),
    Row("nnga", "SimpleGA", 1_024, 100),
    Row("cma_es", "CMA_ES", 256, 100),
    Row("sep_cma_es", "Sep_CMA_ES", 256, 100),
    Row("de", "DifferentialEvolution", 256, 100),
    Row("pso", "PSO", 256, 100),
)
COLD = ("openai_es", "cma_es")
"""Methods whose first row is also measured from the start of a process to its end."""


class EvosaxSuite:
    """evosax compiles a run and keeps the best fitness; ours keeps every evaluation in its record."""

    def __init__(self, rows: tuple[Row, ...] = ROWS) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-m", "benchmarks.evosax_process"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
            cwd=ROOT,
        )
        self._warm: dict[Row, tuple[Samples, Samples]] = {}
        self._cold: dict[Row, tuple[Samples, Samples, Samples]] = {}
        for row in rows:
            peer = Samples(f"evosax {row.algorithm}, {row}, warm", "s")
            self._warm[row] = peer, Samples(f"{row.kind}, {row}, in process", "s", peer, "<= 1")
            if row.kind in COLD and row.population == 256:
                cold = Samples(f"evosax {row.algorithm}, {row}, a process", "s")
                name = f"{row.kind}, {row}, from the command line"
                ours = Samples(f"{name}, without the picture", "s", cold, "<= 0.2")
                self._cold[row] = cold, ours, Samples(f"{name}, until the picture is drawn", "s", cold)

    def _ask(self, row: Row) -> float:
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(f"{row.algorithm} {row.population} {row.generations}\n")
        self._process.stdin.flush()
        line = self._process.stdout.readline()
        if not line:
            raise SystemExit("the evosax process ended; `make bench` installs what it needs")
        return float(json.loads(line))

    def repeat(self) -> None:
        """Take one sample of everything."""
        for row, (peer, ours) in self._warm.items():
            peer.add(self._ask(row))
            ours.add(_in_process(row))
        for row, (peer, ours, drawn) in self._cold.items():
            settings = (row.algorithm, str(row.population), str(row.generations))
            peer.add(_process(sys.executable, "-m", "benchmarks.evosax_process", *settings))
            with tempfile.TemporaryDirectory() as name:
                file = Path(name) / "experiment.yaml"
                row.experiment().save(file)
                command = [*PROGRAM, "optimize", str(file), "--servers", "in-process"]
                # evosax draws nothing.
                ours.add(_process(*command, "--out", str(file.with_name("run")), SWARMWRIGHT_PLOT="0"))
                drawn.add(_process(*command, "--out", str(file.with_name("drawn"))))

    def samples(self) -> list[Samples]:
        """Everything measured, in the order of the table."""
        rows = [*self._warm.values(), *self._cold.values()]
        return [one for row in rows for one in row]

    def close(self) -> None:
        """End the process."""
        self._process.communicate(timeout=20)


def _in_process(row: Row) -> float:
    """Seconds of the fastest of three whole runs, as evosax's."""
    return min(_run(row) for _ in range(3))


def _run(row: Row) -> float:
    with tempfile.TemporaryDirectory() as name:
        start = time.perf_counter()
        optimize(row.experiment(), servers="in-process", out=Path(name) / "run", progress=False)
        seconds = time.perf_counter() - start
        picture.wait()  # it is drawn beside what follows, and would take a processor of it
    return seconds


def _process(*command: str, **environment: str) -> float:
    """Seconds from the start of a process to its end; environment: beside that of this one."""
    start = time.perf_counter()
    with patch.dict(os.environ, environment):
        output(*command, cwd=ROOT)
    return time.perf_counter() - start
