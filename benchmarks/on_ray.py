"""Evaluations of 0.1 ms in Python: servers on a Ray cluster of this machine, and the cluster's own tasks."""

import contextlib
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

from benchmarks.measurement import Samples
from benchmarks.processes import ROOT, embedded
from swarmwright import _engine
from swarmwright.servers.launchers import LAUNCHERS, Code, Specification
from swarmwright.servers.rows import Journal

SERVERS = 2
SPINS = 1.0
"""Fitness of an evaluation: how often it was busy."""
ARCHITECTURE = {
    "version": 1,
    "kind": "layered",
    "sensors": 1,
    "actuators": 1,
    "hidden": [],
    "activation": "tanh",
    "output_range": [-1, 1],
}


class RaySuite:
    """A cluster with two processors: its own tasks, then two servers on it."""

    def __init__(self, *, scale: int = 1) -> None:
        self._evaluations = max(200, 20_000 // scale)
        self._tasks = Samples("Ray, tasks of 0.1 ms", "tasks/s")
        self._served = Samples(
            "Swarmwright on Ray, evaluations of 0.1 ms", "evaluations/s", self._tasks, ">= 5"
        )
        self._stack = contextlib.ExitStack()
        self._process = subprocess.Popen(
            [sys.executable, "-m", "benchmarks.on_ray_process", str(SERVERS)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
            cwd=ROOT,
        )
        self._stack.callback(self._process.communicate)
        self._broker = self._stack.enter_context(embedded())
        self._address = self._answer("address")

    def repeat(self) -> None:
        """Take one sample of everything."""
        assert self._process.stdin is not None
        self._process.stdin.write(f"{self._evaluations // 5}\n")
        self._process.stdin.flush()
        self._tasks.add(float(self._answer("rate")))
        self._served.add(self._rate())

    def _rate(self) -> float:
        component = LAUNCHERS.get("ray")
        options = component.options_model.model_validate({"launcher": "ray", "address": self._address})
        source = (Path(__file__).parent / "spinning.py").read_bytes()
        specification = Specification(
            "spinning.py:Spinning",
            self._broker.url,
            prefix="bench/ray",
            code=Code.from_files({"spinning.py": source}),
        )
        shape = (self._evaluations, _engine.genome_size(ARCHITECTURE))
        genomes = np.random.default_rng(1).uniform(-1, 1, shape).astype(np.float32)
        with contextlib.closing(component(options, specification)) as launcher:
            launcher.open()
            launcher.start(range(1, SERVERS + 1))
            while len(_engine.servers(self._broker.url, prefix="bench/ray", wait=0.2)) < SERVERS:
                pass
            pool = _engine.Pool(
                self._broker.url,
                simulation="spinning",
                parameters={},
                requirements={"dimensions": 1},
                prefix="bench/ray",
                tool="bench",
                mode="offloaded",
            )
            with contextlib.closing(pool):
                pool.wait_for_server()
                pool.evaluate(ARCHITECTURE, genomes, [0])  # the pool learns how fast the servers are
                start = time.perf_counter()
                fitness, _, attempts, _ = pool.evaluate(ARCHITECTURE, genomes, [0])
                rate = self._evaluations / (time.perf_counter() - start)
                errors = Journal.from_fields(attempts, []).errors
                if errors or not np.array_equal(fitness[:, 0], SPINS * np.ones(self._evaluations)):
                    raise SystemExit(f"evaluation on Ray failed: {errors[:1]}, fitness {fitness[:3]}")
                return rate

    def _answer(self, word: str) -> str:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            if line.startswith(word):
                return line.removeprefix(word).strip()
        raise SystemExit("Ray did not start; `make bench` installs it")

    def samples(self) -> list[Samples]:
        """Everything measured, in the order of the table."""
        return [self._tasks, self._served]

    def close(self) -> None:
        """End everything that was started."""
        self._stack.close()
