"""Missions of the arena in ARGoS and in Stage, against the simulators' own loops.

    python -m benchmarks.attached [--robots 2,10,100] [--ticks 3000] [--repetitions 5]

Bare: the simulator's loop with robots that have proximity sensors or rangers of 24 beams, and a controller
in C++. Server: as many robots with such sensors in a mission, and a network, over a broker, offloaded. Both
are measured in turn. `SWARMWRIGHT_ARGOS` and `SWARMWRIGHT_STAGE` name the folders where the simulators are
installed; what is missing is skipped, and said.
"""

import argparse
import contextlib
import statistics
import subprocess
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from benchmarks.processes import embedded
from benchmarks.wrappers import Server, Subject, evaluate, pool_for
from tests.attached import ARGOS, STAGE, Simulator, build

TICKS_PER_SECOND = 10


@dataclass(frozen=True)
class Compared:
    """A server of missions, its robots, and how many numbers they sense."""

    simulator: Simulator
    title: str
    sensors: int
    robot: Any
    more: Mapping[str, Any] = field(default_factory=dict)


RANGERS = {
    "radius": 0.085,
    "drive": {"kind": "differential", "wheel_base": 0.14, "max_speed": 0.3},
    "sensors": [{"kind": "proximity", "count": 24, "range": 1}],
}
COMPARED = (
    Compared(ARGOS, "arena-argos", 57, "foot-bot"),
    Compared(STAGE, "arena-stage", 24, RANGERS),
)


def _bare(compared: Compared, robots: int, ticks: int) -> float:
    """Steps per second of the simulator's own loop."""
    name = f"{compared.simulator.name.lower()}-bare"
    done = subprocess.run(
        [str(build(compared.simulator) / name), str(robots), str(ticks)],
        capture_output=True,
        text=True,
        check=True,
        timeout=600,
    )
    return float(done.stdout.split()[-1])


def _served(compared: Compared, robots: int, ticks: int) -> float:
    """Steps per second through the server."""
    apothem = 1.226 * max(1.0, robots / 20) ** 0.5
    mission = {
        "walls": {"sides": 12, "apothem": apothem},
        "start": {"disc": {"radius": apothem - 0.15}},
        "metrics": {"apart": {"kind": "nearest_distance", "when": "end"}},
        "fitness": "apart",
    }
    parameters = {
        "mission": mission,
        "robots": robots,
        "robot": compared.robot,
        "duration": ticks / TICKS_PER_SECOND,
    }
    subject = Subject(
        [str(build(compared.simulator) / f"swarmwright-{compared.simulator.name.lower()}")],
        compared.title,
        parameters,
        compared.sensors,
        2,
    )
    prefix = "bench/attached"
    with (
        embedded() as broker,
        contextlib.closing(Server(subject.command, broker, prefix)),
        pool_for(broker, prefix, subject, "offloaded") as pool,
    ):
        evaluate(pool, subject.block(1))
        _, seconds = evaluate(pool, subject.block(3))
    return 3 * ticks / seconds


def main() -> None:
    """Measure what is installed."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.attached", description=__doc__)
    parser.add_argument("--robots", default="2,10,100", help="numbers of robots; default: %(default)s")
    parser.add_argument("--ticks", type=int, default=3000, help="of an episode; default: %(default)s")
    parser.add_argument("--repetitions", type=int, default=5, help="default: %(default)s")
    arguments = parser.parse_args()
    print(f"{'simulator':<12}{'robots':>8}{'bare, steps/s':>16}{'server, steps/s':>18}{'ratio':>8}")
    for compared in COMPARED:
        if compared.simulator.prefix is None:
            print(
                f"{compared.simulator.name:<12} skipped: not installed; {compared.simulator.variable} names "
                "the folder where it is"
            )
            continue
        for robots in map(int, arguments.robots.split(",")):
            ticks = max(100, arguments.ticks * 10 // max(10, robots))
            pairs = [
                (_bare(compared, robots, ticks), _served(compared, robots, ticks))
                for _ in range(arguments.repetitions)
            ]
            bare, served = (statistics.median(column) for column in zip(*pairs, strict=True))
            ratio = statistics.median(ours / theirs for theirs, ours in pairs)
            print(f"{compared.simulator.name:<12}{robots:>8}{bare:>16,.0f}{served:>18,.0f}{ratio:>8.2f}")


if __name__ == "__main__":
    main()
