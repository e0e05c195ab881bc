"""Robots in a simulator with `simulation_interfaces`, over DDS: `simulation: {ros: 2, ..}`."""

import math
import random
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import swarmwright
from swarmwright import Controller, Experiment, SwarmwrightError
from tests.python.records import same_record
from tests.python.simulations.command.processes import running

pytestmark = pytest.mark.timeout(120)
SIMULATOR = Path(__file__).with_name("simulator.py")
TWIST, ODOMETRY = "geometry_msgs/Twist", "nav_msgs/Odometry"
SMALL = {
    "method": {"kind": "random_search", "population": 2, "generations": 1},
    "ranking": {"episodes": 1},
}


def experiment(path: Path, *arguments: str, top: dict[str, Any] | None = None, **changes: Any) -> Experiment:
    values: dict[str, Any] = {
        "ros": 2,
        "start": [sys.executable, str(SIMULATOR), *arguments, "--note", str(path)],
        "robots": 3,
        "sensors": [
            {"sensor": "goal x", "topic": "goal", "type": TWIST, "field": "linear.x", "scale": 0.2},
            {"sensor": "goal y", "topic": "/{robot}/goal", "type": TWIST, "field": "linear.y", "scale": 0.2},
        ],
        "actuators": [
            {"actuator": "speed", "topic": "cmd_vel", "type": TWIST, "field": "linear.x"},
            {"actuator": "turn", "topic": "cmd_vel", "type": TWIST, "field": "angular.z", "scale": 2.0},
        ],
        "step": {"type": "simulation_interfaces/StepSimulation", "steps": 10},
        "reset": {"type": "simulation_interfaces/ResetSimulation"},
        "spawn": {"uri": "file:///rover.sdf", "area": {"x": [-1, 1], "y": [-1, 1]}},
        "steps": 20,
        "patience": 2.0,
        "metrics": {
            "x": {"topic": "odom", "type": ODOMETRY, "field": "pose.pose.position.x"},
            "truth": {
                "type": "simulation_interfaces/GetEntitiesStates",
                "field": "pose.position.x",
                "robots": "min",
            },
            "ahead": {"sensor": "goal x", "time": "min", "robots": "max"},
        },
        "folder": str(path),
        **changes,
    }
    return Experiment.from_mapping(
        {
            "simulation": {key: value for key, value in values.items() if value is not None},
            "fitness": "x + truth",
            "controller": {"kind": "fully_meshed", "hidden": 2},
            "method": {"population": 6, "generations": 4},
            "ranking": {"episodes": 2},
            "faults": {"attempts": 1},
            **(top or {}),
        }
    )


def driven(controller: Controller, seed: int) -> float:
    """The same episode in plain Python: its fitness."""
    numbers, last = random.Random(seed), []
    for _ in range(3):
        x, y = numbers.uniform(-1, 1), numbers.uniform(-1, 1)
        half = numbers.uniform(-math.pi, math.pi) / 2
        z, w = math.sin(half), math.cos(half)
        yaw = math.atan2(2 * (w * z + 0.0), 1 - 2 * (0.0 + z * z))
        own = Controller(controller.json)
        for _ in range(20):
            dx, dy = 3.0 - x, -y
            goal = (math.cos(yaw) * dx + math.sin(yaw) * dy, math.cos(yaw) * dy - math.sin(yaw) * dx)
            speed, turn = (float(value) for value in own([np.float32(value * 0.2) for value in goal]))
            for _ in range(10):
                yaw += 0.01 * (turn * 2.0)
                x += 0.01 * speed * math.cos(yaw)
                y += 0.01 * speed * math.sin(yaw)
        last.append(x)
    return math.fsum(last) / 3 + min(last)


@pytest.mark.slow
def test_runs_have_one_record_and_compute_what_plain_python_does(tmp_path: Path) -> None:
    runs = [
        swarmwright.optimize(experiment(tmp_path), servers=servers, out=tmp_path / str(servers))
        for servers in (1, 2)
    ]
    same_record(*runs)
    best = runs[0].best
    assert best.fitness == sum(driven(best.controller, seed) for seed in (0, 1)) / 2
    assert runs[0].history[-1].best > runs[0].history[0].median
    assert not running(str(tmp_path))


def failure(path: Path, *arguments: str, **changes: Any) -> str:
    failing = experiment(path, *arguments, top=SMALL, **changes)
    with pytest.raises(SwarmwrightError) as caught:
        swarmwright.optimize(failing, servers=1, out=path / "run")
    return str(caught.value)


STEP, RESET = "/step_simulation (StepSimulation)", "/reset_simulation (ResetSimulation)"
REASONS = {
    "dies": f"simulation.start: {sys.executable} has ended (status 7); its last output: the engine",
    "reset_fails": f"{RESET}: result 4, the operation failed: the world is locked",
    "step_fails": f"{STEP}: result 4, the operation failed: physics diverged",
    "step_hangs": "/step_simulation: no answer within 2 s",
    "silent": "/robot_1/goal (geometry_msgs/Twist): nothing came for 2 s; sensor goal x, sensor goal y",
    "nan": "/robot_1/goal (geometry_msgs/Twist): sensor goal y: nan came for 2 s, expected a finite number",
    "wrong_type": "/robot_1/odom has the type geometry_msgs/Twist",
}


@pytest.mark.slow
@pytest.mark.parametrize("fault", REASONS)
def test_a_failure_names_what_where_and_for_how_long_and_leaves_nothing(fault: str, tmp_path: Path) -> None:
    said = failure(tmp_path, "--fault", fault, startup=8.0)
    assert REASONS[fault] in said
    assert "Traceback" not in said
    assert not running(str(tmp_path))


@pytest.mark.slow
def test_no_simulator(tmp_path: Path) -> None:
    said = failure(tmp_path, start=None, startup=1.0, environment={"ROS_DOMAIN_ID": "{domain}"})
    assert "/reset_simulation: no node offers this service" in said
    assert "RMW_IMPLEMENTATION=rmw_cyclonedds_cpp" in said


@pytest.mark.slow
def test_a_service_of_another_type(tmp_path: Path) -> None:
    changes: dict[str, Any] = {"startup": 3.0, "reset": {"service": "/reset_simulation"}, "spawn": None}
    said = failure(tmp_path, "--robots", "3", **changes)
    assert "/reset_simulation: the service has the type simulation_interfaces/ResetSimulation" in said


@pytest.mark.slow
def test_a_simulator_that_does_not_start_is_noticed_at_once(tmp_path: Path) -> None:
    began = time.monotonic()
    said = failure(tmp_path, start=["sh", "-c", "echo no licence >&2; exit 3"], startup=60.0)
    assert "simulation.start: sh has ended (status 3); its last output: no licence" in said
    assert time.monotonic() - began < 30


@pytest.mark.slow
def test_files_of_a_simulator_are_named_by_the_folder_of_the_experiment(tmp_path: Path) -> None:
    (tmp_path / "world.yaml").write_text("the world\n", encoding="utf-8")
    show = 'cat "${0#world:=}" >&2; exit 3'
    said = failure(tmp_path, start=["sh", "-c", show, "world:={here}/world.yaml"], startup=60.0)
    assert "simulation.start: sh has ended (status 3); its last output: the world" in said


@pytest.mark.slow
def test_robots_that_are_there_are_reset_and_their_node_gets_parameters(tmp_path: Path) -> None:
    changes: dict[str, Any] = {
        "spawn": None,
        "robots": 2,
        "reset": {
            "type": "simulation_interfaces/ResetSimulation",
            "scope": ["time", "state"],
            "parameters": "/simulator",
            "settle": 0,
        },
        "metrics": {"x": {"type": "simulation_interfaces/GetEntitiesStates", "field": "pose.position.x"}},
    }
    arguments = ("--robots", "2", "--publish-on-reset")
    found = []
    for gain in (0.0, 0.5):
        top = {**SMALL, "fitness": "x", "parameters": {"gain": gain, "seed": 3}}
        attached = experiment(tmp_path, *arguments, top=top, **changes)
        found.append(swarmwright.optimize(attached, servers=1, out=tmp_path / str(gain)).best.fitness)
    # They begin at x = 0, and without a gain they stay there.
    assert found[0] == 0
    assert found[1] != 0
    top = {**SMALL, "fitness": "x", "parameters": {"gian": 1.0}}
    with pytest.raises(SwarmwrightError, match=r"/simulator/set_parameters: gian was refused: there is no"):
        swarmwright.optimize(
            experiment(tmp_path, *arguments, top=top, **changes), servers=1, out=tmp_path / "wrong"
        )


@pytest.mark.slow
def test_a_run_is_exported_with_its_topics_and_real_robots_are_not_driven_for_that(tmp_path: Path) -> None:
    sensors = [{"sensor": "goal x", "topic": "goal", "type": TWIST, "field": "linear.x", "scale": 0.2}]
    metrics = {"ahead": {"sensor": "goal x"}}
    real = {"step": 0.1, "steps": 3, "spawn": None, "robots": 2, "reset": None, "sensors": sensors}
    arguments = ("--robots", "2", "--realtime", "1", "--log", str(tmp_path / "commands"))
    attached = experiment(tmp_path, *arguments, top={**SMALL, "fitness": "ahead"}, metrics=metrics, **real)
    run = swarmwright.optimize(attached, servers=1, out=tmp_path / "run")
    driven_until = (tmp_path / "commands").stat().st_size
    swarmwright.export_controller(run, to="ros2", output=tmp_path / "package", prefix="rover")
    assert (tmp_path / "commands").stat().st_size == driven_until
    mapping = (tmp_path / "package" / "config" / "mapping.template.yaml").read_text("utf-8")
    assert 'topic: "goal"' in mapping
    assert "\nrate: 10 " in mapping


@pytest.mark.slow
def test_names_and_topics_are_exported_where_the_simulator_does_not_start(tmp_path: Path) -> None:
    """As in a shell in which ROS was not sourced."""
    start = f'test ! -e "{tmp_path}/gone" && exec "{sys.executable}" "{SIMULATOR}" --note "{tmp_path}"'
    sensors = [{"sensor": "goal x", "topic": "goal", "type": TWIST, "field": "linear.x", "scale": 0.2}]
    attached = experiment(
        tmp_path,
        top={**SMALL, "fitness": "ahead"},
        start=["sh", "-c", start],
        sensors=sensors,
        metrics={"ahead": {"sensor": "goal x"}},
    )
    run = swarmwright.optimize(attached, servers=1, out=tmp_path / "run")
    (tmp_path / "gone").touch()
    swarmwright.export_controller(run, to="ros2", output=tmp_path / "package", prefix="rover")
    mapping = (tmp_path / "package" / "config" / "mapping.template.yaml").read_text("utf-8")
    assert 'sensor: "goal x"' in mapping
    assert 'topic: "goal"' in mapping
    assert "\n    scale: 0.2\n" in mapping  # as in the experiment
    assert "goal x, -1 to 1 for -5 to 5 */" in (tmp_path / "package/src/rover.h").read_text("utf-8")
