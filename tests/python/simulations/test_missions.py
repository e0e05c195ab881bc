"""The arena's missions in MuJoCo and Enki: the real ones."""

import importlib
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmwright import Experiment, InputError, optimize
from swarmwright.simulations.physics import Physics, PushedObject, RobotModel, Wall, World
from tests.enki import needs_enki

NAMES = [
    pytest.param("swarmwright.simulations.mujoco:Missions", id="mujoco"),
    pytest.param("swarmwright.simulations.enki:Missions", id="enki", marks=needs_enki),
]
SIMULATORS = pytest.mark.parametrize("name", NAMES)
E_PUCK = RobotModel(0.035, 0.08, 0.16, 0.053, 0.12, 3.66, np.zeros(0, np.float32), 0.0, 0.0)


def made(name: str) -> Physics:
    module, _, kind = name.partition(":")
    simulator: Physics = getattr(importlib.import_module(module), kind)()
    return simulator


def square(half: float) -> np.ndarray[Any, Any]:
    return np.array([[-half, -half], [half, -half], [half, half], [-half, half]], np.float32)


def world(robots: int, *more: Wall, half: float = 5, objects: tuple[PushedObject, ...] = ()) -> World:
    return World(0.1, 0.5, [Wall(square(half), 0.1), *more], [], [], [E_PUCK], [0] * robots, objects)


def rows(*poses: tuple[float, float, float]) -> np.ndarray[Any, Any]:
    return np.array(poses, np.float32).reshape(-1, 3)


def after(simulator: Physics, ticks: int, *motions: tuple[float, float, float]) -> tuple[Any, Any]:
    for _ in range(ticks):
        simulator.step(rows(*motions))
    robots, objects = simulator.poses()
    return np.asarray(robots), np.asarray(objects)


@SIMULATORS
def test_robots_go_as_they_are_told(name: str) -> None:
    simulator = made(name)
    simulator.start(world(2), True, rows((0, 0, 0.5), (1, 1, 2)), rows(), 1)
    robots, _ = after(simulator, 50, (0.1, 0, 0), (0.05, 0, 0.4))
    way = 50 * 0.1 * 0.1
    # Enki's motors are off by 5 % at random, in the direction, too.
    assert robots[0, :2] == pytest.approx([way * math.cos(0.5), way * math.sin(0.5)], abs=0.05)
    turned = (robots[1, 2] - 2 + math.pi) % (2 * math.pi) - math.pi
    assert turned == pytest.approx(2, abs=0.15)
    radius = 0.05 / 0.4
    assert math.dist(robots[1, :2], (1, 1)) == pytest.approx(2 * radius * math.sin(1), abs=0.03)


@SIMULATORS
def test_walls_obstacles_and_robots_hold_robots(name: str) -> None:
    simulator = made(name)
    obstacle = Wall(square(0.1) + np.array([0.5, 0], np.float32), 0.1)
    start = rows((0, 0, 0), (0, 0.7, math.pi / 2), (-0.5, -0.5, 0), (-0.3, -0.5, math.pi))
    simulator.start(world(4, obstacle, half=1), True, start, rows(), 1)
    robots, _ = after(simulator, 120, *[(0.1, 0, 0)] * 4)
    radius = E_PUCK.radius
    assert robots[0, 0] < 0.4 - radius + 0.006, "in front of the obstacle"
    assert robots[1, 1] < 1 - radius + 0.006, "in front of the wall"
    assert math.dist(robots[2, :2], robots[3, :2]) > 2 * radius - 0.006, "in front of each other"


@SIMULATORS
def test_objects_are_pushed(name: str) -> None:
    simulator = made(name)
    objects = (PushedObject(0.05, 0, 0, 0.05, 0.02, 0.1), PushedObject(0, 0.1, 0.2, 0.05, 0.02, 0.1))
    places = rows((0.2, 0, 0), (0.2, 1, 0))
    start = rows((0, 0, 0), (0, 1, 0), (0, 2, 0))
    simulator.start(world(3, objects=objects), True, start, places, 1)
    robots, pushed = after(simulator, 60, *[(0.1, 0, 0)] * 3)
    assert (pushed[:, 0] > 0.3).all(), "they went"
    assert (pushed[:, 0] > robots[:2, 0]).all(), "ahead of the robots"


@SIMULATORS
def test_every_episode_begins_anew(name: str) -> None:
    simulator = made(name)
    there = world(3)
    starts = rows((0, 0, 0), (0.2, 0.01, 3), (1, 1, 1))
    seen = []
    for changed in (True, False, False):
        simulator.start(there, changed, starts, rows(), 5)
        first = np.asarray(simulator.poses()[0])
        assert first == pytest.approx(starts, abs=1e-6)
        seen.append(after(simulator, 30, *[(0.1, 0, 0.1)] * 3)[0])
    if simulator.determinism == "bitwise":
        assert np.array_equal(seen[0], seen[1])
        assert np.array_equal(seen[0], seen[2])
    other = made(name)
    other.start(world(3, Wall(square(0.1) + 2, 0.1)), True, starts, rows(), 5)


def experiment(name: str, **more: Any) -> Experiment:
    return Experiment.from_mapping(
        {
            "simulation": name,
            "parameters": {"mission": "aggregation", "robots": 5, "duration": 3},
            "controller": {"kind": "evostick"},
            "method": {"kind": "evostick", "population": 4, "elites": 1, "generations": 2},
            "ranking": {"episodes": 2, "seeds": "new"},
            "validate": False,
            **more,
        }
    )


@pytest.mark.slow
@SIMULATORS
@pytest.mark.timeout(120)
def test_controllers_are_evolved(name: str, tmp_path: Path) -> None:
    here = optimize(experiment(name), out=tmp_path / "here", servers="local")
    there = optimize(experiment(name), out=tmp_path / "there", servers=2)
    assert np.isfinite(here.record.fitness).all()
    assert np.isfinite(there.record.fitness).all()
    if "mujoco" in name:
        assert here.digest == there.digest


@pytest.mark.slow
@needs_enki
def test_enki_has_e_pucks_only() -> None:
    name = "swarmwright.simulations.enki:Missions"
    other = {"mission": "aggregation", "robots": 2, "robot": "turtlebot3"}
    with pytest.raises((InputError, Exception), match="Enki simulates e-pucks"):
        optimize(experiment(name, parameters=other, controller={"kind": "layered"}), servers="local")
