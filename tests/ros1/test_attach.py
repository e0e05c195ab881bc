"""Robots of a running ROS 1 as a simulation: `simulation: {ros: 1, ..}`."""

import json
import math
import random
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import swarmwright
from swarmwright import Controller, Experiment, SwarmwrightError
from swarmwright.simulations.command.ros_definition import PROGRAM, RosOptions
from tests.python.records import same_record
from tests.python.simulations.command.processes import running
from tests.python.simulations.ros.conversation import until
from tests.ros1.machine import Driver, Master, end

pytestmark = pytest.mark.timeout(180)
SIMULATOR = Path(__file__).with_name("simulator.py")
TWIST, ODOMETRY = "geometry_msgs/Twist", "nav_msgs/Odometry"


SMALL = {
    "method": {"kind": "random_search", "population": 2, "generations": 1},
    "ranking": {"episodes": 1},
}


def experiment(path: Path, *arguments: str, top: dict[str, Any] | None = None, **changes: Any) -> Experiment:
    values: dict[str, Any] = {
        "ros": 1,
        "start": ["/usr/bin/python3", str(SIMULATOR), *arguments],
        "robots": 2,
        "sensors": [
            {"sensor": "goal x", "topic": "goal", "type": TWIST, "field": "linear.x", "scale": 0.2},
            {"sensor": "goal y", "topic": "goal", "type": TWIST, "field": "linear.y", "scale": 0.2},
        ],
        "actuators": [
            {"actuator": "speed", "topic": "cmd_vel", "type": TWIST, "field": "linear.x"},
            {"actuator": "turn", "topic": "cmd_vel", "type": TWIST, "field": "angular.z", "scale": 2.0},
        ],
        "step": {"service": "/step"},
        "reset": {"service": "/reset", "parameters": "/simulator"},
        "steps": 20,
        "patience": 1.5,
        "metrics": {
            "x": {"topic": "odom", "type": ODOMETRY, "field": "pose.pose.position.x"},
            "ahead": {"sensor": "goal x", "time": "min", "robots": "max"},
        },
        **changes,
    }
    values["folder"] = str(path)
    return Experiment.from_mapping(
        {
            "simulation": {key: value for key, value in values.items() if value is not None},
            "fitness": "x",
            "controller": {"kind": "layered", "hidden": [3]},
            "method": {"population": 6, "generations": 4},
            "ranking": {"episodes": 2},
            "faults": {"attempts": 1},
            **(top or {}),
        }
    )


def driven(controller: Controller, seed: int, steps: int = 20) -> tuple[float, float]:
    """The same episode in plain Python: the metrics `x` and `ahead`."""
    numbers = random.Random(seed)
    starts = [(numbers.uniform(-1, 1), numbers.uniform(-1, 1)) for _ in range(2)]
    last, nearest = [], []
    for start in starts:
        (x, y), yaw, own = start, 0.0, Controller(controller.json)
        ahead = []
        for step in range(steps + 1):
            dx, dy = 3.0 - x, -y
            goal = (math.cos(yaw) * dx + math.sin(yaw) * dy, math.cos(yaw) * dy - math.sin(yaw) * dx)
            sensors = [np.float32(value * 0.2) for value in goal]
            ahead.append(float(sensors[0]))
            if step == steps:
                break
            speed, turn = (float(value) for value in own(sensors))
            yaw += 0.1 * (turn * 2.0)
            x += 0.1 * speed * math.cos(yaw)
            y += 0.1 * speed * math.sin(yaw)
        last.append(x)
        nearest.append(min(ahead))
    return math.fsum(last) / 2, max(nearest)


def test_steps_of_a_service_have_one_record_and_compute_what_plain_python_does(tmp_path: Path) -> None:
    runs = [
        swarmwright.optimize(experiment(tmp_path), servers=servers, out=tmp_path / str(servers))
        for servers in (1, 2)
    ]
    same_record(*runs)
    # Looking whether services are there leaves no warning of theirs.
    assert not [log for log in tmp_path.glob("*/servers.log") if "Inbound TCP" in log.read_text("utf-8")]
    best = runs[0].best
    expected = [driven(best.controller, seed)[0] for seed in (0, 1)]
    assert best.fitness == sum(expected) / 2
    assert runs[0].history[-1].best > runs[0].history[0].median


def failure(path: Path, *arguments: str, **changes: Any) -> str:
    failing = experiment(path, *arguments, top=SMALL, **changes)
    with pytest.raises(SwarmwrightError) as caught:
        swarmwright.optimize(failing, servers=1, out=path / "run")
    return str(caught.value)


REASONS: dict[str, tuple[dict[str, Any], str]] = {
    "dies": ({}, "simulation.start: /usr/bin/python3 has ended (status 7)"),
    "silent": (
        {},
        "/robot_1/goal (geometry_msgs/Twist): nothing came for 1.5 s; sensor goal x, sensor goal y",
    ),
    "nan": ({}, "/robot_1/goal (geometry_msgs/Twist): sensor goal y: nan came for 1.5 s, expected a finite"),
    "wrong_type": (
        {},
        "/robot_1/odom has the type geometry_msgs/Twist, but the definition says nav_msgs/Odom",
    ),
    "step_fails": ({}, "/step (std_srvs/Trigger) reports a failure: physics diverged"),
    "reset_fails": (
        {"reset": {"service": "/reset", "type": "std_srvs/Trigger"}},
        "/reset (std_srvs/Trigger) reports a failure: the world is locked",
    ),
    "deaf": (
        {"startup": 3.0},
        "no node subscribes to /robot_1/cmd_vel (geometry_msgs/Twist) after 3 s (simulation.startup)",
    ),
}


@pytest.mark.parametrize("fault", REASONS)
def test_a_failure_names_what_where_and_for_how_long_and_leaves_nothing(fault: str, tmp_path: Path) -> None:
    changes, reason = REASONS[fault]
    mark = str(tmp_path)
    said = failure(tmp_path, "--fault", fault, f"__log:={mark}/log", **changes)
    assert reason in said
    assert "Traceback" not in said
    assert not running(mark)


def test_a_master_that_does_not_answer(tmp_path: Path) -> None:
    nowhere = {"ROS_MASTER_URI": "http://127.0.0.1:9"}
    said = failure(tmp_path, start=None, startup=1.0, environment=nowhere)
    assert "no master answers at http://127.0.0.1:9 (ROS_MASTER_URI); start roscore" in said


def test_a_service_that_is_not_there(tmp_path: Path) -> None:
    said = failure(tmp_path, startup=3.0, reset={"service": "/restart"})
    assert "/restart: no node offers this service" in said


def test_a_python_without_rospy(tmp_path: Path) -> None:
    said = failure(tmp_path, python=sys.executable)
    assert f"{sys.executable} cannot import" in said
    assert "simulation.python" in said


def test_robots_that_move_by_themselves(tmp_path: Path) -> None:
    real_time = experiment(tmp_path, "--realtime", top=SMALL, step=0.1, steps=10)
    began = time.monotonic()
    run = swarmwright.optimize(real_time, servers=1, out=tmp_path / "run")
    assert time.monotonic() - began > 2 * 10 * 0.1
    # A simulator's steps and those of the controllers overlap somehow.
    x, _ = driven(run.best.controller, 0, steps=10)
    assert abs(run.best.fitness - x) < 0.5


def test_the_robot_is_stopped_when_the_node_is_told_to_end(
    master: Master, driver: Driver, tmp_path: Path
) -> None:
    twist = {"topic": "cmd_vel", "type": TWIST, "field": "linear.x"}
    options = RosOptions.model_validate(
        {
            "ros": 1,
            "robots": ["killed"],
            "sensors": [{"sensor": "light", "topic": "light", "type": "std_msgs/Float32", "timeout": 9}],
            "actuators": [{"actuator": "speed", **twist}],
            "step": 20.0,
        }
    )
    file = tmp_path / "attachment.json"
    file.write_text(json.dumps({**options.attachment(), "values": {}}), encoding="utf-8")
    driver("publish", topic="/killed/light", kind="std_msgs/Float32", message={"data": 0.5})
    program = master.workspace.start(
        "/usr/bin/python3", str(PROGRAM), str(file), stdin=subprocess.PIPE, stdout=subprocess.PIPE
    )
    assert program.stdin is not None
    assert program.stdout is not None

    def speed() -> float | None:
        commands = driver("recorded", topic="/killed/cmd_vel")
        return float(commands[-1]["linear"]["x"]) if commands else None

    try:
        program.stdin.write('{"reset": {"parameters": {}, "seed": 1}}\n')
        program.stdin.flush()
        driver("record", topic="/killed/cmd_vel", kind=TWIST)
        assert json.loads(program.stdout.readline()) == {"sensors": [[0.5]]}
        program.stdin.write('{"actuators": [[0.75]]}\n')
        program.stdin.flush()
        until(lambda: speed() == 0.75)
        driver("kill", node=driver("node", begin=f"/swarmwright_{program.pid}_"))
        until(lambda: speed() == 0.0, 5)
        assert json.loads(program.stdout.readline()) == {"error": "the node was shut down"}
    finally:
        end(program)
        program.stdin.close()
        program.stdout.close()


def test_a_command_resets_and_an_episode_ends_before_its_last_step(tmp_path: Path) -> None:
    script = tmp_path / "reset.sh"
    script.write_text(f"#!/bin/sh\necho $1 $2 >> {tmp_path}/resets\nrosservice call /reset > /dev/null\n")
    script.chmod(0o755)
    changes: dict[str, Any] = {
        "reset": {"command": ["./reset.sh", "{seed}", "{speed}"]},
        "done": "seen >= 3",
        "metrics": {"seen": {"sensor": "goal x", "time": "count"}},
    }
    top = {**SMALL, "parameters": {"speed": 2.5, "seed": 8}, "fitness": "seen"}
    run = swarmwright.optimize(experiment(tmp_path, top=top, **changes), servers=1, out=tmp_path / "run")
    assert run.best.fitness == 3  # before the first step, and after two
    assert (tmp_path / "resets").read_text().splitlines() == ["8 2.5"] * 2


def test_parameters_of_a_node_are_evolved(tmp_path: Path) -> None:
    """No sensors and no actuators: the robots steer themselves, and what is evolved is set before a reset."""
    top = {
        **SMALL,
        "controller": {"kind": "parameter_set", "parameters": {"speed": {"type": "real", "range": [0, 1]}}},
    }
    changes: dict[str, Any] = {
        "sensors": None,
        "actuators": None,
        "metrics": {"x": {"topic": "odom", "type": ODOMETRY, "field": "pose.pose.position.x"}},
        "steps": 2,
    }
    run = swarmwright.optimize(
        experiment(tmp_path, "--steers-itself", top=top, **changes), servers=1, out=tmp_path / "run"
    )
    speed = run.best.controller.parameters["speed"]
    numbers = random.Random(0)
    starts = [(numbers.uniform(-1, 1), numbers.uniform(-1, 1)) for _ in range(2)]
    assert run.best.fitness == math.fsum(x + 0.1 * speed + 0.1 * speed for x, _ in starts) / 2
