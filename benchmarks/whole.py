"""FREVO's Stadium experiment from its session file to the result, from the command line."""

import json
import resource
import statistics
import sys
import tempfile
import time
from pathlib import Path

from benchmarks.measurement import Samples
from benchmarks.processes import PROGRAM, ROOT, output, seconds_until
from swarmwright import Run

SESSION = ROOT / "tests" / "data" / "frevo" / "emergency_exit_stadium.zse"
FREVO_SECONDS = 15.2
"""A seed in FREVO 1.5, one thread, quoted from tests/data/frevo/README.md."""
FREVO_BEST = {50: -3.8, 100: -0.13, 299: 0.46}
"""By generation: FREVO's best fitness, mean of the seeds 12345 to 12354, quoted from the same page."""
SEEDS = range(12345, 12355)


class WholeSuite:
    """All ten seeds, each once: import and optimize, and both in one command; how good they get."""

    def __init__(self, seeds: range = SEEDS) -> None:
        self._seeds = iter(seeds)
        self._count = len(seeds)
        frevo = Samples("FREVO, Stadium, 300 generations (quoted)", "s", values=[FREVO_SECONDS])
        self._frevo = frevo
        self._printed = Samples(
            "swarmwright import and optimize, until the result is printed", "s", frevo, "<= 0.033 (0.5 s)"
        )
        self._single = Samples(
            "swarmwright optimize SESSION.zse, until the result is printed", "s", frevo, "<= 0.033 (0.5 s)"
        )
        self._clock = Samples("import and optimize, until the picture is drawn", "s", frevo)
        self._processor = Samples("import and optimize, processor time", "s", frevo)
        self._import = Samples("import alone, by the clock", "s")
        self._floor = Samples("Python that imports NumPy and ends, by the clock", "s")
        self._best = {generation: Samples("", "") for generation in FREVO_BEST}

    def repeat(self) -> None:
        """Two seeds each time, so that five repetitions take all ten."""
        for seed in (next(self._seeds, None), next(self._seeds, None)):
            if seed is not None:
                self._run(seed)

    def _run(self, seed: int) -> None:
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            before = _children()
            start = time.perf_counter()
            experiment = output(*PROGRAM, "import", str(SESSION), cwd=folder)
            (folder / "stadium.yaml").write_text(experiment, encoding="utf-8")
            imported = time.perf_counter() - start
            words = ("optimize", "stadium.yaml", "--seed", str(seed), "--out", "run", "--servers", "local")
            printed, line = seconds_until('"generations": ', *PROGRAM, *words, "--json", cwd=folder)
            self._printed.add(imported + printed)
            self._clock.add(time.perf_counter() - start)
            self._processor.add(_children() - before)
            self._import.add(imported)
            words = ("optimize", str(SESSION), "--seed", str(seed), "--out", "session", "--servers", "local")
            printed, session = seconds_until('"generations": ', *PROGRAM, *words, "--json", cwd=folder)
            self._single.add(printed)
            start = time.perf_counter()
            output(sys.executable, "-c", "import numpy", cwd=folder)
            self._floor.add(time.perf_counter() - start)
            assert json.loads(line)["generations"] == 300
            assert json.loads(session)["best"] == json.loads(line)["best"]
            history = Run.open(folder / "run").history
            for generation, samples in self._best.items():
                samples.add(history[generation].best_so_far)

    def samples(self) -> list[Samples]:
        """Everything measured, in the order of the table."""
        found = [
            self._frevo,
            self._printed,
            self._single,
            self._clock,
            self._processor,
            self._import,
            self._floor,
        ]
        for generation, samples in self._best.items():
            quoted = FREVO_BEST[generation]
            at = f"best fitness at generation {generation}"
            frevo = Samples(f"FREVO, {at}, mean of ten seeds (quoted)", "", values=[quoted])
            mean = statistics.fmean(samples.values)
            found += [
                frevo,
                Samples(f"{at}, mean of {len(samples.values)} seeds", "", aim=f">= {quoted}", values=[mean]),
                Samples(f"{at}, median", "", aim=f">= {quoted}", values=samples.values),
            ]
        return found

    def close(self) -> None:
        """Nothing is left open."""


def _children() -> float:
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime
