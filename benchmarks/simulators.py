"""Simulators that can be installed here: robot-steps per second of one core, and whether episodes repeat.

`python -m benchmarks.simulators` prints the rows of docs/explanation/simulators.md, with those that are not
installed left out. `--only NAME` measures one.
"""

import argparse
import hashlib
import importlib.util
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

from benchmarks.arena import evostick, robot_steps, square
from swarmwright.common.errors import InputError

ROOT = Path(__file__).parents[1]
NUMBERS = (2, 10, 100)
SECONDS = 1.0
"""Of processor time, for one sample."""
SAMPLES = 5
DIGEST_STEPS = 20

Made = tuple[Any, dict[str, Any]]
"""A simulation, and the parameters of its episodes."""


@dataclass(frozen=True)
class Subject:
    """A simulator, and how it is made with a number of robots."""

    name: str
    make: Callable[[int, Path], Made]
    """Given the number of robots and an empty folder."""
    step: str
    """What a step of a robot is."""


def filled(kind: type[Any], **parameters: Any) -> Made:
    """A simulation with its default parameters, but for these."""
    return kind(), {name: one.default for name, one in kind.parameters.items()} | parameters


def enki(robots: int, _: Path) -> Made:
    """E-pucks, as many in a square metre as 4 in one."""
    from swarmwright.simulations.enki import EPucks

    return filled(EPucks, agents=robots, size=100.0 * (robots / 4) ** 0.5, pillars=0, steps=10**9)


def mujoco(robots: int, _: Path) -> Made:
    """Rovers with eight range sensors."""
    from swarmwright.simulations.mujoco import Rovers

    side = 2.0 * max(robots, 4) ** 0.5
    return filled(Rovers, agents=robots, pillars=0, arena={"width": side, "depth": side}, steps=10**9)


def sumo(robots: int, folder: Path) -> Made:
    """A ring on which every vehicle is an agent."""
    from swarmwright.simulations.sumo import Vehicles
    from tests.python.simulations.sumo.roads import drivers, ring, written

    length = 20.0 * robots
    config = written(folder, ring(length), drivers(length, ["agent"] * robots))
    return filled(Vehicles, agents=robots, config=config, steps=10**9)


def from_example(
    example: str, module: str, kind: str, folder: Path, change: Callable[[str], str]
) -> type[Any]:
    """Load the class of an example after changing the files of the example."""
    for file in sorted((ROOT / "experiments" / example).iterdir()):
        if file.is_file():
            (folder / file.name).write_text(change(file.read_text("utf-8")), "utf-8")
    spec = importlib.util.spec_from_file_location(module, folder / f"{module}.py")
    assert spec is not None
    assert spec.loader is not None
    loaded = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(loaded)
    simulation: type[Any] = getattr(loaded, kind)
    return simulation


def pybullet(robots: int, folder: Path) -> Made:
    """The quadrotors of the example."""
    kind = from_example("pybullet", "quadrotors", "Quadrotors", folder, lambda text: text)
    return filled(kind, agents=robots, steps=10**9)


def ir_sim(robots: int, folder: Path) -> Made:
    """The robots of the example, in a world that grows with their number."""
    side = max(10, round(10 * (robots / 6) ** 0.5))

    def change(text: str) -> str:
        text = text.replace("number: 6\n", f"number: {robots}\n").replace(
            "SIZE = 3.0, 8, 10.0", f"SIZE = 3.0, 8, {side}"
        )
        text = text.replace("height: 10, width: 10", f"height: {side}, width: {side}")
        return text.replace("[9.5, 9.5, 3.14]", f"[{side - 0.5}, {side - 0.5}, 3.14]")

    kind = from_example("irsim", "navigate", "Navigate", folder, change)
    return filled(kind, steps=10**9)


SUBJECTS = [
    Subject("Enki", enki, "0.1 s, 3 steps of physics; e-puck, 8 proximity sensors"),
    Subject("MuJoCo", mujoco, "0.1 s, 10 steps of physics; rover with contacts, 8 range sensors of 3 rays"),
    Subject("PyBullet", pybullet, "0.1 s, 24 steps of physics; quadrotor with autopilot in Python"),
    Subject("SUMO", sumo, "1 s, 2 steps of SUMO; vehicle on a ring"),
    Subject("IR-SIM", ir_sim, "0.1 s; 8 beams of a laser scanner"),
]


def arena(robots: int) -> float:
    """Robot-steps/s of the built-in world, controllers included."""
    ticks = 200
    candidates = max(1, 1_600_000 // (robots * ticks))
    parameters = {**square(robots), "duration": ticks / 10}
    return robot_steps(parameters, evostick(candidates), robots * ticks, "auto")


def rate(simulation: Any, parameters: dict[str, Any], robots: int) -> float:
    """Robot-steps/s of processor time, observations included, without controllers."""
    simulation.reset(parameters, 1)
    actions = np.random.default_rng(1).uniform(-1, 1, (64, robots, simulation.actuators)).astype(np.float32)
    steps, start = 0, time.process_time()
    while time.process_time() - start < SECONDS:
        simulation.step(actions[steps % 64])
        steps += 1
    return steps * robots / (time.process_time() - start)


def digest(subject: Subject, robots: int) -> str:
    """SHA-256 of what robots observe in an episode, twice where it is not the same when it is repeated."""
    with tempfile.TemporaryDirectory() as folder:
        simulation, parameters = subject.make(robots, Path(folder))
        found = []
        for _ in range(2):
            rows = [np.asarray(simulation.reset(parameters, 3), np.float64)]
            random = np.random.default_rng(2)
            for _ in range(DIGEST_STEPS):
                actions = random.uniform(-1, 1, (robots, simulation.actuators)).astype(np.float32)
                rows.append(np.asarray(simulation.step(actions), np.float64))
            found.append(hashlib.sha256(np.array(rows).tobytes()).hexdigest())
        return found[0] if found[0] == found[1] else " and ".join(found)


def repeats(subject: Subject) -> bool:
    """Whether ten robots observe the same, to the bit, in this process and in two others."""
    command = [sys.executable, "-m", "benchmarks.simulators", "--digest", "--only", subject.name]
    runs = [
        subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout for _ in range(2)
    ]
    said = {text.split()[-1] for text in runs} | {digest(subject, 10)}
    return len(said) == 1 and not any(" and " in text for text in (*runs, *said))


def measure(subject: Subject) -> str:
    """A row of the table."""
    figures = []
    for robots in NUMBERS:
        with tempfile.TemporaryDirectory() as folder:
            simulation, parameters = subject.make(robots, Path(folder))
            figures.append(median(rate(simulation, parameters, robots) for _ in range(SAMPLES)))
    rates = " | ".join(f"{figure:,.0f}" for figure in figures)
    return f"| {subject.name} | {subject.step} | {'yes' if repeats(subject) else 'no'} | {rates} |"


def main() -> None:
    """Print the rows."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.simulators", description=__doc__)
    parser.add_argument("--only", default="", metavar="NAME", help="one of them")
    parser.add_argument("--digest", action="store_true", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    chosen = [one for one in SUBJECTS if arguments.only in ("", one.name)]
    if arguments.digest:
        print(digest(chosen[0], 10))
        return
    print("| simulator | a step | the same to the bit | robot-steps/s with 2 | 10 | 100 robots |")
    print("|---|---|---|---|---|---|")
    if arguments.only in ("", "arena"):
        rates = " | ".join(f"{median(arena(robots) for _ in range(SAMPLES)):,.0f}" for robots in NUMBERS)
        print(
            f"| arena | 0.1 s; e-puck with 24 inputs, its controller included | yes | {rates} |", flush=True
        )
    for subject in chosen:
        try:
            print(measure(subject), flush=True)
        except (InputError, ModuleNotFoundError) as error:
            print(f"{subject.name}: {error}", file=sys.stderr)


if __name__ == "__main__":
    main()
