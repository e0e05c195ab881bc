"""What a user waits for first: compiling the library from nothing, and how large it is."""

import os
import resource
import shutil
import subprocess
import tempfile
from pathlib import Path

from benchmarks.measurement import Samples
from benchmarks.suite import NotBuiltError

ENGINE = Path(__file__).parents[1] / "engine"
COMMAND = ("cargo", "build", "--release", "--quiet", "-p", "swarmwright-python", "--features",
           "pyo3/extension-module,pyo3/abi3-py311")  # fmt: skip


class BuildSuite:
    """The library as `make demo` compiles it, and as wheels have it: for all instruction sets."""

    def __init__(self) -> None:
        if shutil.which("cargo") is None:
            raise NotBuiltError("cargo is missing")
        self._samples: list[Samples] = []

    def repeat(self) -> None:
        """Compile both, once: processor time hardly depends on what else runs."""
        if self._samples:
            return
        for levels, what in (("native", "for this processor"), ("all", "for all processors")):
            seconds, bytes_ = _built(levels)
            for name, unit, value in (
                (f"compiling the library {what}", "s of processor time", seconds),
                (f"size of the library {what}", "MB", bytes_ / 1e6),
            ):
                sample = Samples(name, unit)
                sample.add(value)
                self._samples.append(sample)

    def samples(self) -> list[Samples]:
        """Return everything measured."""
        return self._samples

    def close(self) -> None:
        """Nothing is left."""


def _built(levels: str) -> tuple[float, int]:
    """Compile the library in an empty folder; return the processor time in seconds, and its size in bytes."""
    with tempfile.TemporaryDirectory() as target:
        environment = {**os.environ, "CARGO_TARGET_DIR": target, "SWARMWRIGHT_LEVELS": levels}
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run(COMMAND, cwd=ENGINE, env=environment, check=True)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        size = (Path(target) / "release" / "lib_engine.so").stat().st_size
    return after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime, size
