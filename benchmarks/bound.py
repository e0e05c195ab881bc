"""How near a rollout comes to what the processor could do at most with the operations that it needs.

The counts below are those of the algorithm for one agent-step of one vector of lanes, read off the sources
named, each arithmetic operation of a vector once; moving data between registers and memory is not counted,
except for what lanes must read and write one by one. In the arena, what is done depends on where robots are:
`engine/worlds/arena/examples/operations` computes the same episodes with lanes that count. `benchmarks/peak`
measures how many operations of each kind the processor does in a nanosecond.
"""

import copy
import json
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from benchmarks import arena
from benchmarks.measurement import Samples
from benchmarks.rollout import Block, minisim, stadium

PEAK = Path(__file__).parent / "peak"
ENGINE = Path(__file__).parents[1] / "engine"
PEAK_PROGRAM = (str(PEAK / "Cargo.toml"), "--release")
# No package is named: so crates have the features of the workspace, with which the library has compiled them.
COUNTING_PROGRAM = (str(ENGINE / "Cargo.toml"), "--release", "--example", "operations")


@dataclass(frozen=True)
class Count:
    """Operations of one phase. vector: those at the rate of multiplications and additions."""

    vector: int = 0
    divide: int = 0
    square_root: int = 0
    scalar_load: int = 0
    scalar_store: int = 0

    def __add__(self, other: "Count") -> "Count":
        return Count(*(getattr(self, kind.name) + getattr(other, kind.name) for kind in fields(self)))


TANH = Count(vector=21, divide=2)
"""engine/numeric/controllers/src/functions/lanes.rs: 2 limits, z, two cubics of 6, y*P, t+t, t*t, 1+,
2 limits."""

MINISIM = {
    # Differences to the goal, four quotients; the way to the defender is known from the step before.
    "sensors": Count(vector=2, divide=4),
    # 8 nodes of 4 products, 4 sums and a bias, 1 node of 8, 8 and 1; 9 tanh; the output checked and limited.
    "network": Count(vector=8 * 9 + 17 + 9 * TANH.vector + 3, divide=9 * TANH.divide),
    # Cosine 16, sine 18, two products and sums, four limits, two selections.
    "move": Count(vector=44),
    # The closest agent 11, the step 4, which of them 5.
    "defender": Count(vector=20, divide=1, square_root=1),
    # Distances to goal and defender, and both compared.
    "judge": Count(vector=12, square_root=2),
}
"""engine/worlds/worlds/src/minisim/lanes.rs with a 4-8-1 tanh network, one agent and one defender."""

EMERGENCY_EXIT = {
    # Two indices and a shift of what lies around (4), eight neighbours (8), two halves of the way (5); each
    # lane reads its four bytes of the grid.
    "sensors": Count(vector=17, scalar_load=16),
    # 4 nodes of 2 products and sums, and of 8 sums where a neighbour is free; twice 4 nodes of 4 products and
    # sums, a bias and 2 limits; the range of 2 outputs.
    "network": Count(vector=4 * 4 + 32 + 88 + 4),
    # 4 comparisons, the step they make (5), its cell (2), whether that is free, who is out.
    "move": Count(vector=13),
}
"""engine/worlds/worlds/src/emergency_exit/lanes with 2 hidden nodes, 2 iterations, clamped, in 16 lanes.
What else agents need that do move is left out, since most are in each other's way; so the bound is rather
too low."""


ARENA = {"EvoStick": (arena.evostick, "e-puck-rm1.1"), "modules": (arena.machines, "e-puck-rm1.2")}
"""Controllers and robots of the arena whose operations are counted."""


def build() -> None:
    """Compile the measurements in Rust, which takes minutes where nothing of the engine is compiled."""
    for program in (PEAK_PROGRAM, COUNTING_PROGRAM):
        subprocess.run(["cargo", "build", "--quiet", "--manifest-path", *program], check=True)


def _printed(program: Sequence[str], text: str = "") -> dict[str, Any]:
    """Return the object that a measurement in Rust prints, compiling it before."""
    command = ["cargo", "run", "--quiet", "--manifest-path", *program]
    done = subprocess.run(command, input=text, check=True, stdout=subprocess.PIPE, text=True)
    printed: dict[str, Any] = json.loads(done.stdout)
    return printed


def peak() -> dict[str, float]:
    """Operations per nanosecond of one core by kind, best instruction set; and `lanes` of a vector."""
    return _printed(PEAK_PROGRAM)


def counted(name: str, candidates: int) -> Count:
    """Return the operations of a robot-step of 16 lanes in whole missions; the mean of some candidates.

    Integers take the units of numbers.
    """
    make, robot = ARENA[name]
    architecture, genomes = make(candidates)
    work = {
        "parameters": {"mission": "aac", "robot": robot},
        "architecture": architecture,
        "genomes": genomes.ravel().tolist(),
        "seeds": [0],
    }
    found = _printed(COUNTING_PROGRAM, json.dumps(work))
    steps = found["vectors"] * arena.ROBOTS * arena.TICKS
    each = {kind: round(found[kind] / steps) for kind in ("divide", "square_root", "scalar_load")}
    return Count(vector=round((found["vector"] + found["integer"]) / steps), **each)


def bounds(count: Count, rates: dict[str, float], lanes: int) -> tuple[float, float]:
    """Nanoseconds that `count` takes at least: all units busy at once, and one kind after the other.

    Quotients and roots share a unit, and take a vector instruction each as well. Counts of scalar operations
    are for 16 lanes.
    """
    divider = count.divide / rates["divide"] + count.square_root / rates["square_root"]
    vector = (count.vector + count.divide + count.square_root) / rates["multiply_add"]
    load = count.scalar_load * lanes / 16 / rates["scalar_load"]
    store = count.scalar_store * lanes / 16 / rates["scalar_store"]
    return max(divider, vector, load, store), count.vector / rates["multiply_add"] + divider + load + store


def endless_minisim(candidates: int) -> tuple[Block, int]:
    """Nobody arrives, nobody is caught, the defender follows; and its agent-steps."""
    block = minisim(
        candidates, mapWidth=10_000, mapHeight=10_000, goalRadius=0, captureRadius=0, maxSteps=200
    )
    return block, candidates * 200


def endless_stadium(candidates: int) -> tuple[Block, int]:
    """Stadium with its exits walled in; and its agent-steps."""
    block = stadium(candidates)
    parameters = copy.deepcopy(block.parameters)
    field = parameters["field"]
    field["blockades"] += [[x, y] for x in (1, 18) for y in (8, 9, 10, 11)]
    agents = len(field["agents"])
    block.parameters = parameters
    return block, candidates * agents * 50


class BoundSuite:
    """Nanoseconds of a vector's agent-step, and what share of them the bound is."""

    def __init__(self, scale: int = 1) -> None:
        self._blocks = {
            "Minisim": (*endless_minisim(8_192 // scale), sum(MINISIM.values(), Count())),
            "Emergency Exit": (*endless_stadium(2_048 // scale), sum(EMERGENCY_EXIT.values(), Count())),
        }
        self._arena = {f"arena, {name}": (name, counted(name, 512 // scale)) for name in ARENA}
        self._candidates = 512 // scale
        self._rates: dict[str, Samples] = {}
        self._figures: dict[str, tuple[Samples, Samples, Samples]] = {}
        for name in (*self._blocks, *self._arena):
            taken = Samples(f"{name}, a vector's agent-step", "ns")
            self._figures[name] = (
                taken,
                Samples(f"{name}, counted bound, all units at once", "ns", taken, ">= 0.4"),
                Samples(f"{name}, counted bound, one kind after the other", "ns", taken),
            )

    def repeat(self) -> None:
        """Take one sample of everything."""
        rates = peak()
        lanes = int(rates["lanes"])
        for kind in ("multiply_add", "divide", "square_root", "scalar_load", "scalar_store"):
            samples = self._rates.setdefault(kind, Samples(f"peak, {kind}", "operations/ns"))
            samples.add(rates[kind])
        for name, (block, agent_steps, count) in self._blocks.items():
            seconds = min(block.time().processor for _ in range(3))
            self._add(name, seconds / agent_steps * lanes * 1e9, bounds(count, rates, lanes))
        for name, (kind, count) in self._arena.items():
            make, robot = ARENA[kind]
            parameters = {"mission": "aac", "robot": robot}
            steps = arena.ROBOTS * arena.TICKS
            rate = arena.robot_steps(parameters, make(self._candidates), steps, "auto")
            self._add(name, lanes / rate * 1e9, bounds(count, rates, lanes))

    def _add(self, name: str, taken: float, bounds: tuple[float, float]) -> None:
        for samples, value in zip(self._figures[name], (taken, *bounds), strict=True):
            samples.add(value)

    def samples(self) -> list[Samples]:
        """Everything measured, in the order of the table."""
        return [*self._rates.values(), *(one for figures in self._figures.values() for one in figures)]

    def close(self) -> None:
        """Nothing is left open."""
