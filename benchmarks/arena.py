"""The arena: robot-steps per second of one core, by controller, instructions, robots and sides of a match."""

import math
import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.measurement import Samples
from swarmwright import _engine
from swarmwright.controllers.kinds.modules.representation import Modules, ModulesOptions

ARGOS_RATE = 87_000.0
"""Robot-steps/s of ARGoS 3 on a core, 20 e-pucks with all of these sensors: the better end of 70,000 to
87,000, quoted from shared/data/argos."""

ROBOTS = 20
TICKS = 1200
"""Of a whole mission, 120 s."""
AREA = 4.87
"""Of the dodecagon of the missions, m^2, for 20 robots."""
EVOSTICK = {"version": 1, "kind": "evostick", "sensors": 24, "actuators": 2}
WEIGHTS = 50
AIMS = {
    ("EvoStick", "avx512"): ">= 172 (15,000,000/s)",
    ("modules", "avx512"): ">= 92 (8,000,000/s)",
    ("EvoStick", "scalar"): ">= 23 (2,000,000/s)",
}
MOST_IN_LANES = 16_384
"""More robots are computed one episode at a time, as engine/worlds/arena/src/sensing/verlet.rs says."""
SIDE = 4
"""Robots of each side of a match."""
MATCH_SECONDS = 30
MATCH_AIM = ">= 0.7"
NUMBERS = (20, 100, 1_000, 10_000, 100_000)

Controllers = tuple[dict[str, Any], NDArray[np.float32]]


def evostick(candidates: int) -> Controllers:
    """Weights from -2 to 2: robots that turn, cluster, and jam at walls and at each other."""
    source = np.random.default_rng(1)
    return EVOSTICK, source.uniform(-2, 2, (candidates, WEIGHTS)).astype(np.float32)


def machines(candidates: int) -> Controllers:
    """Random machines of up to four states with up to four transitions."""
    representation = Modules(ModulesOptions(), sensors=9, actuators=2)
    lower, upper = representation.bounds
    genomes = np.random.default_rng(1).uniform(lower, upper, (candidates, lower.size)).astype(np.float32)
    return representation.architecture(), representation.weights(genomes)


def sides(controllers: Controllers) -> Controllers:
    """Join each of the controllers with the next one, for a match of two sides."""
    architecture, weights = controllers
    groups = [{"name": name, "agents": SIDE, "controller": architecture} for name in ("left", "right")]
    joined = np.concatenate([weights, np.roll(weights, 1, axis=0)], axis=1)
    return {"version": 1, "kind": "team", "groups": groups}, joined


def match(robot: str) -> dict[str, Any]:
    """Two sides of the same robots in an arena with as much space for each robot as in the missions."""
    robots = [{"name": name, "robot": robot, "count": SIDE} for name in ("left", "right")]
    return {"mission": {**square(2 * SIDE)["mission"], "robots": robots}, "duration": MATCH_SECONDS}


def robot_steps(parameters: dict[str, Any], controllers: Controllers, steps: int, level: str) -> float:
    """Robot-steps per second of processor time. steps: of all robots in one episode."""
    architecture, genomes = controllers
    start = time.process_time()
    _engine.evaluate("arena", parameters, architecture, genomes, [0], level=level, threads=1)
    return len(genomes) * steps / (time.process_time() - start)


def square(robots: int) -> dict[str, Any]:
    """A square with as much space for each robot as in the missions, a lamp and a black spot."""
    side = math.sqrt(AREA * robots / ROBOTS)
    ends = [-side / 2 + 0.04, side / 2 - 0.04]
    mission = {
        "walls": {"rectangle": [side, side]},
        "start": {"rectangle": {"x": ends, "y": ends}},
        "floor": {"patches": [{"name": "spot", "circle": {"radius": 0.3}, "color": "black"}]},
        "lights": [{"at": [0, -side / 2 - 0.3, 0.4], "intensity": 3}],
        "metrics": {"robots": {"kind": "robots_on", "patch": "spot"}},
        "fitness": "robots",
    }
    return {"mission": mission, "robots": robots}


KINDS = {"EvoStick": (evostick, "e-puck-rm1.1"), "modules": (machines, "e-puck-rm1.2")}
"""Controllers, and the robots that they are for."""


class ArenaSuite:
    """Whole missions with 20 robots, and a tick's cost from 20 to 100,000 robots at equal density."""

    def __init__(self, scale: int = 1) -> None:
        self._scale = scale
        self._argos = Samples("ARGoS 3, 20 e-pucks (quoted)", "robot-steps/s", values=[ARGOS_RATE])
        self._levels = [level for level in _engine.levels() if level != "portable"]
        self._whole: dict[tuple[str, str], Samples] = {}
        for name in ("EvoStick", "modules"):
            for level in self._levels:
                self._whole[name, level] = Samples(
                    f"arena, {name}, 120 s, {level}, one core",
                    "robot-steps/s",
                    self._argos,
                    AIMS.get((name, level), ""),
                )
        self._matches: dict[tuple[str, bool], Samples] = {}
        for name in ("EvoStick", "modules"):
            words = f"arena, two sides of {SIDE} robots, {MATCH_SECONDS} s, {name}, the fastest way"
            shared = Samples(f"{words}, one controller", "robot-steps/s")
            self._matches[name, False] = shared
            self._matches[name, True] = Samples(
                f"{words}, a controller for each side", "robot-steps/s", shared, MATCH_AIM
            )
        self._costs: dict[tuple[str, int], Samples] = {}
        for level in ("scalar", "auto"):
            for robots in NUMBERS:
                few = self._costs.get((level, NUMBERS[0]))
                way = "one episode at a time" if level == "scalar" else "the fastest way"
                self._costs[level, robots] = Samples(
                    f"arena, {robots:,} robots, {way}", "ns/robot-step", few, "<= 2" if few else ""
                )

    def repeat(self) -> None:
        """Take one sample of everything."""
        for (name, level), samples in self._whole.items():
            candidates = max(1, (64 if level == "scalar" else 512) // self._scale)
            make, robot = KINDS[name]
            parameters: dict[str, Any] = {"mission": "aac", "robot": robot}
            samples.add(robot_steps(parameters, make(candidates), ROBOTS * TICKS, level))
        for (name, is_match), samples in self._matches.items():
            make, robot = KINDS[name]
            controllers = make(max(1, 2048 // self._scale))
            steps = 2 * SIDE * MATCH_SECONDS * 10
            controllers = sides(controllers) if is_match else controllers
            samples.add(robot_steps(match(robot), controllers, steps, "auto"))
        for (level, robots), samples in self._costs.items():
            # As many robot-steps for each number of robots, in episodes of up to 20 s, one for each lane.
            lanes = 32 if level == "auto" and robots <= MOST_IN_LANES else 1
            steps = (1_600_000 if lanes == 1 else 12_800_000) // self._scale
            ticks = min(200, max(10, steps // (robots * lanes)))
            candidates = max(1, steps // (robots * ticks))
            parameters = {**square(robots), "duration": ticks / 10}
            rate = robot_steps(parameters, evostick(candidates), robots * ticks, level)
            samples.add(1e9 / rate)

    def samples(self) -> list[Samples]:
        """Everything measured, in the order of the table."""
        return [self._argos, *self._whole.values(), *self._matches.values(), *self._costs.values()]

    def close(self) -> None:
        """Nothing is left open."""
