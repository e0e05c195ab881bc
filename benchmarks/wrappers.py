"""Simulation wrappers by language: one server of Minisim each, on one broker.

Minisim is the same to the bit in all of them; what differs is the language, the wrapper, and the algorithm:
the built-in server evaluates offloaded candidates in lanes, the others one after the other.
"""

import contextlib
import json
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.measurement import Samples
from benchmarks.processes import PATIENCE, PROGRAM, ROOT, Broker, embedded, peak_memory
from benchmarks.rollout import Block, minisim
from swarmwright import _engine

JAR = ROOT / "wrappers" / "java" / "target" / "minisim.jar"
CPP = ROOT / "wrappers" / "cpp" / "build" / "minisim"
PYTHON = ROOT / "tests" / "python" / "own" / "minisim.py"
TITLE = 'title = "minisim in Python"'


def commands(folder: Path) -> dict[str, list[str]]:
    """How a server is started in each language, but for broker, id and prefix."""
    source = PYTHON.read_text(encoding="utf-8")
    if TITLE not in source:
        raise SystemExit(f"{PYTHON} does not say {TITLE}")
    for built in (JAR, CPP):
        if not built.exists():
            raise SystemExit(f"{built.relative_to(ROOT)} is missing; `make java cpp` builds it")
    own = folder / "minisim.py"
    own.write_text(source.replace(TITLE, 'title = "minisim"'), encoding="utf-8")
    java = shutil.which("java")
    if java is None:
        raise SystemExit("Java is missing; `make java` installs it")
    return {
        "Rust (built in)": [*PROGRAM, "serve", "minisim"],
        "Python": [*PROGRAM, "serve", f"{own}:Minisim"],
        "Java": [java, "-jar", str(JAR)],
        "C++": [str(CPP)],
    }


class Server:
    """A server in some language, ready once made. start_up: seconds until then."""

    def __init__(self, command: list[str], broker: Broker, prefix: str) -> None:
        options = ["--broker", broker.url, "--id", "1", "--prefix", prefix]
        start = time.perf_counter()
        self._process = subprocess.Popen(
            [*command, *options],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        assert self._process.stdout is not None
        said = []
        for line in self._process.stdout:
            said.append(line)
            if "ready" in line:
                break
        else:
            raise SystemExit(f"{command[0]} ended before it was ready:\n{''.join(said)}")
        self.start_up = time.perf_counter() - start

    def peak_memory(self) -> float:
        """Most memory so far, MB; of the process that serves, where another one watches over it."""
        children = Path(f"/proc/{self._process.pid}/task/{self._process.pid}/children")
        found = [self._process.pid, *map(int, children.read_text(encoding="ascii").split())]
        return max(map(peak_memory, found))

    def close(self) -> None:
        """End it."""
        self._process.terminate()
        try:
            self._process.wait(PATIENCE)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        if self._process.stdout is not None:
            self._process.stdout.close()


@contextlib.contextmanager
def _pool(broker: Broker, prefix: str, block: Block, mode: str) -> Iterator[_engine.Pool]:
    pool = _engine.Pool(
        broker.url,
        simulation=block.title,
        parameters=block.parameters,
        requirements='{"dimensions": 2}',
        prefix=prefix,
        tool="bench",
        mode=mode,
    )
    try:
        pool.wait_for_server()
        yield pool
    finally:
        pool.close()


def _evaluate(pool: _engine.Pool, block: Block) -> tuple[NDArray[np.float64], float, int]:
    """The fitness, (candidates,); seconds; steps over the broker."""
    start = time.perf_counter()
    fitness, _, journal = pool.evaluate(block.architecture, block.genomes, [0])
    seconds = time.perf_counter() - start
    attempts = [json.loads(line) for line in journal.splitlines()]
    errors = [attempt["error"] for attempt in attempts if attempt.get("error")]
    if errors:
        raise SystemExit(f"an evaluation failed: {errors[0]}")
    return fitness[:, 0], seconds, sum(int(attempt.get("steps") or 0) for attempt in attempts)


class WrapperSuite:
    """Rates of one server, against those of the built-in one."""

    def __init__(self, scale: int = 1) -> None:
        self._stack = contextlib.ExitStack()
        folder = self._stack.enter_context(tempfile.TemporaryDirectory())
        self._commands = commands(Path(folder))
        self._broker = self._stack.enter_context(embedded())
        self._stepwise = minisim(max(2, 200 // scale), placement="random", maxSteps=15)
        self._offloaded = minisim(max(20, 2_000 // scale), placement="random", maxSteps=15)
        self._samples: dict[str, dict[str, Samples]] = {}
        for measured, unit in (
            ("start-up", "ms"),
            ("stepwise", "steps/s"),
            ("offloaded", "evaluations/s"),
            ("peak memory", "MB"),
        ):
            floor: Samples | None = None
            for language in self._commands:
                one = Samples(f"{language}: {measured}", unit, floor)
                floor = floor or one
                self._samples.setdefault(measured, {})[language] = one

    def repeat(self) -> None:
        """Take one sample of everything, with new servers."""
        for number, (language, command) in enumerate(self._commands.items()):
            prefix = f"bench/wrappers/{number}"
            with contextlib.closing(Server(command, self._broker, prefix)) as server:
                self._samples["start-up"][language].add(server.start_up * 1e3)
                self._measure(language, prefix)
                self._samples["peak memory"][language].add(server.peak_memory())

    def _measure(self, language: str, prefix: str) -> None:
        for mode, block in (("stepwise", self._stepwise), ("offloaded", self._offloaded)):
            with _pool(self._broker, prefix, block, mode) as pool:
                # The first time, programs are compiled as they run, and the pool learns how fast they are.
                _evaluate(pool, block)
                found, seconds, steps = _evaluate(pool, block)
            if found.tobytes() != block.run().tobytes():
                raise SystemExit(f"{language}, {mode}: another fitness than in this process")
            work = steps if mode == "stepwise" else block.candidates
            self._samples[mode][language].add(work / seconds)

    def samples(self) -> list[Samples]:
        """Everything measured, in the order of the table."""
        return [one for by_language in self._samples.values() for one in by_language.values()]

    def close(self) -> None:
        """End everything that was started."""
        self._stack.close()
