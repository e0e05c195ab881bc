"""Minisim here against the same Minisim in JAX, on one core and on all."""

import json
import os
import subprocess
import sys

from benchmarks.measurement import Samples
from benchmarks.processes import ROOT

CANDIDATES = (256, 4_096, 65_536)
FEW_APART = 2e-3
"""Share of candidates whose fitness may differ: a rounding decides whether a radius is reached."""


class JaxSuite:
    """Each number of cores has a process of its own, limited to them from the start."""

    def __init__(self, candidates: tuple[int, ...] = CANDIDATES) -> None:
        self._processes = {}
        self._figures: dict[tuple[int, int], dict[str, Samples]] = {}
        for cores in sorted({1, len(os.sched_getaffinity(0))}):
            self._processes[cores] = subprocess.Popen(
                [sys.executable, "-m", "benchmarks.jax_process", str(cores)],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                text=True,
                cwd=ROOT,
            )
            for count in candidates:
                shape = f"Minisim, {count:,} candidates, {cores} {'cores' if cores > 1 else 'core'}"
                plain = Samples(f"JAX as one writes it, {shape}", "evaluations/s")
                best = Samples(f"JAX, best of four, {shape}", "evaluations/s")
                self._figures[cores, count] = {
                    "plain": plain,
                    "best": best,
                    "ours": Samples(f"lanes, {shape}", "evaluations/s", plain, ">= 10"),
                    "ours again": Samples(f"the same against the best, {shape}", "evaluations/s", best),
                }
        for cores, count in self._figures:
            # Compiled here, not in what is measured.
            self._ask(cores, count)

    def _ask(self, cores: int, count: int) -> dict[str, float]:
        process = self._processes[cores]
        assert process.stdin is not None
        assert process.stdout is not None
        process.stdin.write(f"{count}\n")
        process.stdin.flush()
        line = process.stdout.readline()
        if not line:
            raise SystemExit("the JAX process ended; `make bench` installs what it needs")
        answer: dict[str, float] = json.loads(line)
        if answer["apart"] > FEW_APART:
            raise SystemExit(f"JAX and the engine disagree on {answer['apart']:.2%} of the fitness values")
        return answer

    def repeat(self) -> None:
        """Take one sample of everything."""
        for (cores, count), figures in self._figures.items():
            answer = self._ask(cores, count)
            # One core is measured in processor time, several by the clock.
            unit = "_processor" if cores == 1 else ""
            for name, samples in figures.items():
                samples.add(count / answer[name.split()[0] + unit])

    def samples(self) -> list[Samples]:
        """Everything measured, in the order of the table."""
        return [one for figures in self._figures.values() for one in figures.values()]

    def close(self) -> None:
        """End the processes."""
        for process in self._processes.values():
            process.communicate(timeout=20)
