"""Blocks of episodes in this process, timed: Minisim and Emergency Exit as FREVO's Stadium."""

import json
import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.measurement import Samples
from swarmwright import Experiment, _engine, evaluate

STADIUM = Path(__file__).parents[1] / "tests" / "data" / "frevo" / "stadium.json"
FREVO_RATE = 733.0
"""Evaluations/s of FREVO 1.5 on the Stadium field, one thread, quoted from tests/data/frevo/README.md."""

LAYERED = {
    "version": 1,
    "kind": "layered",
    "sensors": 4,
    "actuators": 1,
    "hidden": [8],
    "activation": "tanh",
    "output_range": [-1, 1],
}
MESHED = {
    "version": 1,
    "kind": "fully_meshed",
    "sensors": 10,
    "actuators": 2,
    "hidden": 2,
    "activation": "clamp",
    "iterations": 2,
    "output_range": [0, 1],
}


@dataclass(frozen=True)
class Timing:
    """Seconds of the clock and of processors."""

    clock: float
    processor: float


class Block:
    """One episode each of many random networks. architecture: specification without weights; seeds: one."""

    def __init__(
        self, title: str, parameters: dict[str, Any], architecture: dict[str, Any], candidates: int
    ) -> None:
        self.title, self.parameters = title, parameters
        self.architecture = architecture
        self.candidates = candidates
        weights = _engine.genome_size(self.architecture)
        source = np.random.default_rng(1)
        self.genomes: NDArray[np.float32] = source.uniform(-2, 2, (candidates, weights)).astype(np.float32)

    def run(self, level: str = "auto", threads: int = 1) -> NDArray[np.float64]:
        """The fitness, (candidates,)."""
        arguments = (self.title, self.parameters, self.architecture, self.genomes, [0])
        fitness, _ = _engine.evaluate(*arguments, level=level, threads=threads)
        return fitness[:, 0]

    def kept(self, threads: int) -> Callable[[], object]:
        """What evaluates the block as often as it is called, prepared as for the generations of a run."""
        evaluator = _engine.Evaluator(self.title, self.parameters, self.architecture, threads=threads)
        return lambda: evaluator.evaluate(self.genomes, [0])

    def time(self, level: str = "auto", threads: int = 1) -> Timing:
        """How long it takes."""
        clock, processor = time.perf_counter(), time.process_time()
        self.run(level, threads)
        return Timing(time.perf_counter() - clock, time.process_time() - processor)


def minisim(candidates: int, **parameters: Any) -> Block:
    """The published example, with 4-8-1 tanh networks."""
    return Block("minisim", parameters, LAYERED, candidates)


def defended(candidates: int, *, is_match: bool) -> Block:
    """Four agents against four defenders, with one 4-8-1 tanh network for all, or one for each side."""
    parameters = {
        "placement": "random",
        "numAgents": 4,
        "numDefenders": 4,
        "defenderSteering": "controller",
        "mapWidth": 30,
        "mapHeight": 20,
    }
    names = ("agents", "defenders")
    groups = [{"name": name, "agents": 4, "controller": LAYERED} for name in names]
    team = {"version": 1, "kind": "team", "groups": groups}
    return Block("minisim", parameters, team if is_match else LAYERED, candidates)


def stadium(candidates: int, **parameters: Any) -> Block:
    """FREVO's Stadium, 72 agents, 50 steps, with its networks: 2 hidden nodes, clamped."""
    field = json.loads(STADIUM.read_text(encoding="utf-8"))
    return Block("emergency_exit", {"field": field, **parameters}, MESHED, candidates)


class WholeRate:
    """`swarmwright.evaluate` beside the engine's own function, in turn."""

    SECONDS = 0.4
    """In which they take turns."""

    def __init__(self, candidates: int) -> None:
        self._block = minisim(candidates)
        self._experiment = Experiment.from_mapping(
            {
                "simulation": "minisim",
                "controller": {"kind": "layered", "hidden": [8], "activation": "tanh"},
                "servers": "in-process",
            }
        )
        name = f"Minisim, {candidates:,} genomes"
        self.engine = Samples(f"{name}, the engine alone, all processors, by the clock", "evaluations/s")
        self.evaluate = Samples(f"{name}, swarmwright.evaluate", "evaluations/s", self.engine, ">= 0.9")

    def repeat(self) -> None:
        """Take a sample of both: the median of their calls."""
        ways: list[Callable[[], NDArray[np.float64]]] = [
            lambda: self._block.run(threads=0),
            lambda: evaluate(self._experiment, self._block.genomes),
        ]
        assert ways[0]().tobytes() == ways[1]().tobytes()
        taken: tuple[list[float], list[float]] = ([], [])
        begin = time.perf_counter()
        while time.perf_counter() - begin < self.SECONDS:
            for way, seconds in zip(ways, taken, strict=True):
                start = time.perf_counter()
                way()
                seconds.append(time.perf_counter() - start)
        for samples, seconds in zip((self.engine, self.evaluate), taken, strict=True):
            samples.add(self._block.candidates / statistics.median(seconds))


class RolloutSuite:
    """Evaluations/s for each instruction set, and on two threads, against one episode at a time."""

    def __init__(self, scale: int = 1) -> None:
        self._blocks = {
            "Minisim": (minisim(65_536 // scale), minisim(4_096 // scale)),
            "Stadium": (stadium(4_096 // scale), stadium(256 // scale)),
        }
        self._levels = [level for level in _engine.levels() if level != "scalar"]
        self._sides = [defended(16_384 // scale, is_match=is_match) for is_match in (False, True)]
        words = "Minisim, 4 agents and 4 defenders, the fastest way"
        shared = Samples(f"{words}, one controller", "evaluations/s")
        each = Samples(f"{words}, a controller for each side", "evaluations/s", shared, ">= 0.7")
        self._matches = [shared, each]
        self._rates: dict[str, Samples] = {}
        for name in self._blocks:
            scalar = Samples(f"{name}, scalar stepper, one core", "evaluations/s")
            self._rates[f"{name} scalar"] = scalar
            for level in self._levels:
                self._rates[f"{name} {level}"] = Samples(
                    f"{name}, {level}, one core", "evaluations/s", scalar
                )
        self._frevo = Samples("FREVO on Stadium (quoted)", "evaluations/s", values=[FREVO_RATE])
        self._two = {
            "Minisim": Samples("Minisim, two threads, by the clock", "evaluations/s"),
            "Stadium": Samples(
                "Stadium, two threads, by the clock", "evaluations/s", self._frevo, ">= 95 (70,000/s)"
            ),
        }
        self._whole = [WholeRate(65_536 // scale), WholeRate(4_096 // scale)]
        self._two_processor = Samples(
            "Stadium, two threads, by processor time", "evaluations/s", self._frevo, ">= 95 (70,000/s)"
        )

    def repeat(self) -> None:
        """Take one sample of everything."""
        for name, (block, few) in self._blocks.items():
            self._rates[f"{name} scalar"].add(few.candidates / few.time("scalar").processor)
            for level in self._levels:
                self._rates[f"{name} {level}"].add(block.candidates / block.time(level).processor)
            timing = block.time(threads=2)
            self._two[name].add(block.candidates / timing.clock)
            if name == "Stadium":
                self._two_processor.add(2 * block.candidates / timing.processor)
        for block, samples in zip(self._sides, self._matches, strict=True):
            samples.add(block.candidates / block.time().processor)
        for whole in self._whole:
            whole.repeat()

    def samples(self) -> list[Samples]:
        """Everything measured, in the order of the table."""
        whole = [one for rate in self._whole for one in (rate.engine, rate.evaluate)]
        rates = [*self._rates.values(), *self._matches]
        return [*rates, self._frevo, *self._two.values(), self._two_processor, *whole]

    def close(self) -> None:
        """Nothing is left open."""
