"""Simulation wrappers: one server of each on one broker, in every mode, its start-up and its memory.

Minisim is the same to the bit in every language; what differs is the language, the wrapper, and the
algorithm: the built-in server and that in numpy evaluate many episodes at once, the others one by one.
The adapters show what remains of an environment's or a simulator's own speed.
"""

import contextlib
import os
import shutil
import subprocess
import sysconfig
import tempfile
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.measurement import Samples
from benchmarks.processes import PATIENCE, PROGRAM, ROOT, Broker, embedded, peak_memory
from benchmarks.rollout import LAYERED, Block
from swarmwright import _engine
from swarmwright.servers.rows import Journal

JAR = ROOT / "wrappers" / "java" / "target" / "minisim.jar"
CPP = ROOT / "wrappers" / "cpp" / "build" / "minisim"
SIMULATIONS = ROOT / "tests" / "python" / "simulations"
ENKI = Path(f"/usr/lib/python3/dist-packages/pyenki{sysconfig.get_config_var('EXT_SUFFIX')}")

MODES = ("stepwise", "batched", "offloaded")
COLUMNS = {"start-up": "ms", **dict.fromkeys(MODES, "evaluations/s"), "peak memory": "MB"}
"""What is measured of each server, and its unit."""
FIRST = 4
"""Evaluations at first; as many as last long enough follow."""
LASTS = 0.4
"""Seconds that are aimed at for one measurement."""
MOST = 200_000
"""Evaluations of one measurement; more would not change it."""


@dataclass(frozen=True)
class Subject:
    """command: what starts it, but for broker, id, prefix. same: whether all modes give the same bits."""

    command: list[str]
    title: str = "minisim"
    parameters: Mapping[str, Any] = field(default_factory=lambda: {"placement": "random", "maxSteps": 15})
    sensors: int = 4
    actuators: int = 1
    dimensions: int = 2
    same: bool = True

    def block(self, candidates: int) -> Block:
        """Random networks with 8 hidden nodes; the first ones of a larger block."""
        controller = {**LAYERED, "sensors": self.sensors, "actuators": self.actuators}
        return Block(self.title, dict(self.parameters), controller, candidates)


def _renamed(folder: Path, name: str, title: str) -> str:
    """Copy a simulation of the tests, so that it has the title of the built-in one; its name for `serve`."""
    source = (SIMULATIONS / f"{name}.py").read_text(encoding="utf-8")
    line = f'title = "{title}"'
    if line not in source:
        raise SystemExit(f"{SIMULATIONS / name}.py does not say {line}")
    copy = folder / f"{name}.py"
    copy.write_text(source.replace(line, 'title = "minisim"'), encoding="utf-8")
    return f"{copy}:Minisim"


def subjects(folder: Path) -> dict[str, Subject]:
    """Every server by its row in the table."""
    for built in (JAR, CPP):
        if not built.exists():
            raise SystemExit(f"{built.relative_to(ROOT)} is missing; `make java cpp` builds it")
    java = shutil.which("java")
    if java is None:
        raise SystemExit("Java is missing; `make java` installs it")

    def served(name: str) -> list[str]:
        return [*PROGRAM, "serve", name]

    found = {
        "Minisim, Rust (built in)": Subject(served("minisim")),
        "Minisim, C++": Subject([str(CPP)]),
        "Minisim, Java": Subject([java, "-jar", str(JAR)]),
        "Minisim, Python": Subject(served(_renamed(folder, "minisim", "minisim in Python"))),
        "Minisim, numpy": Subject(served(_renamed(folder, "minisim_batch", "minisim in numpy"))),
        "Gymnasium, CartPole": Subject(served("gymnasium:CartPole-v1"), "CartPole-v1", {}),
        "PettingZoo, 3 agents, 25 steps": Subject(
            served("pettingzoo:mpe2.simple_spread_v3"), "mpe2.simple_spread_v3", {}, 18, 5
        ),
        "MuJoCo, 4 rovers, 50 steps": Subject(
            served("swarmwright.simulations.mujoco:Rovers"),
            "mujoco rovers",
            {"agents": 4, "steps": 50},
            12,
            2,
            3,
        ),
    }
    if ENKI.is_file():
        found["Enki, 4 e-pucks, 50 steps"] = Subject(
            served("swarmwright.simulations.enki:EPucks"),
            "enki e-pucks",
            {"agents": 4, "steps": 50},
            8,
            2,
            2,
            False,
        )
    return found


class Server:
    """A server of some kind, ready once made. start_up: seconds until then."""

    def __init__(self, command: list[str], broker: Broker, prefix: str) -> None:
        options = ["--broker", broker.url, "--id", "1", "--prefix", prefix]
        paths = [str(ROOT), os.environ.get("PYTHONPATH", "")]  # where one in Python finds the tests'
        start = time.perf_counter()
        self._process = subprocess.Popen(
            [*command, *options],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, paths))},
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

    @property
    def pid(self) -> int:
        """Of the process that was started."""
        return self._process.pid

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
def pool_for(broker: Broker, prefix: str, subject: Subject, mode: str) -> Iterator[_engine.Pool]:
    """A connected pool for servers of a kind, closed afterwards."""
    pool = _engine.Pool(
        broker.url,
        simulation=subject.title,
        parameters=dict(subject.parameters),
        requirements={"dimensions": subject.dimensions},
        sensors=subject.sensors,
        actuators=subject.actuators,
        prefix=prefix,
        tool="bench",
        mode=mode,
    )
    try:
        pool.wait_for_server()
        yield pool
    finally:
        pool.close()


def evaluate(pool: _engine.Pool, block: Block) -> tuple[NDArray[np.float64], float]:
    """Evaluate a block: the fitness, (candidates,); seconds."""
    start = time.perf_counter()
    fitness, _, attempts, _ = pool.evaluate(block.architecture, block.genomes, [0])
    seconds = time.perf_counter() - start
    errors = Journal.from_fields(attempts, []).errors
    if errors:
        raise SystemExit(f"an evaluation failed: {errors[0]}")
    return fitness[:, 0], seconds


class WrapperSuite:
    """Rates of one server of each kind, Minisim's against those of the built-in one."""

    def __init__(self, scale: int = 1) -> None:
        self._stack = contextlib.ExitStack()
        folder = self._stack.enter_context(tempfile.TemporaryDirectory())
        self._subjects = subjects(Path(folder))
        self._broker = self._stack.enter_context(embedded())
        self._lasts = LASTS / scale
        self._samples: dict[tuple[str, str], Samples] = {}
        for measured, unit in COLUMNS.items():
            floor: Samples | None = None
            for row, subject in self._subjects.items():
                against = floor if subject.title == "minisim" else None
                one = Samples(f"{row}: {measured}", unit, against, row=row, column=measured)
                floor = floor or one
                self._samples[row, measured] = one

    def repeat(self) -> None:
        """Take one sample of everything, with new servers."""
        for number, (row, subject) in enumerate(self._subjects.items()):
            prefix = f"bench/wrappers/{number}"
            with contextlib.closing(Server(subject.command, self._broker, prefix)) as server:
                self._samples[row, "start-up"].add(server.start_up * 1e3)
                found = [self._measure(row, subject, mode, prefix) for mode in MODES]
                self._samples[row, "peak memory"].add(server.peak_memory())
            if subject.title == "minisim":
                found.append(subject.block(max(map(len, found))).run())
            for one in found if subject.same else []:
                common = min(len(one), len(found[-1]))
                if one[:common].tobytes() != found[-1][:common].tobytes():
                    raise SystemExit(f"{row}: another fitness in another mode, or than in this process")

    def _measure(self, row: str, subject: Subject, mode: str, prefix: str) -> NDArray[np.float64]:
        """Take as many evaluations as last long enough; their fitness."""
        with pool_for(self._broker, prefix, subject, mode) as pool:
            count, seconds, warm = FIRST, 0.0, 0.0
            # Java's programs are compiled as they run, so what comes first says little.
            while seconds < self._lasts / 2 or warm < self._lasts:
                warm += seconds
                found, seconds = evaluate(pool, subject.block(count))
                rate = count / seconds
                if count == MOST:
                    break
                count = min(MOST, max(FIRST, int(min(16 * count, rate * self._lasts))))
        self._samples[row, mode].add(rate)
        return found

    def samples(self) -> list[Samples]:
        """Everything measured, row by row."""
        return [self._samples[row, measured] for row in self._subjects for measured in COLUMNS]

    def close(self) -> None:
        """End everything that was started."""
        self._stack.close()
