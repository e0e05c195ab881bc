"""The program that drives robots, over standard input and output, against a simulator over DDS."""

import gc
import json
import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmwright import InputError, Simulation
from swarmwright.common.yaml import dump
from swarmwright.simulations.command.ros_definition import PROGRAM, RosOptions
from swarmwright.simulations.loading import load

pytestmark = pytest.mark.timeout(60)
SIMULATOR = Path(__file__).with_name("simulator.py")
TWIST = "geometry_msgs/Twist"


class Program:
    """The program, told a line at a time."""

    def __init__(self, process: "subprocess.Popen[str]", log: Path) -> None:
        self.process, self._log = process, log

    def say(self, message: Any) -> Any:
        assert self.process.stdin is not None
        self.process.stdin.write(f"{json.dumps(message)}\n")
        self.process.stdin.flush()
        return self.answer()

    def answer(self) -> Any:
        assert self.process.stdout is not None
        return json.loads(self.process.stdout.readline())

    def reset(self) -> Any:
        return self.say({"reset": {"parameters": {}, "seed": 1}})

    def step(self, speed: float) -> Any:
        return self.say({"actuators": [[speed], [speed]]})

    def last(self) -> list[float]:
        """The last command of each robot."""
        said = dict.fromkeys(("robot_1", "robot_2"), 0.0)
        for line in self._log.read_text("utf-8").splitlines():
            robot, speed, _ = line.split()
            said[robot] = float(speed)
        return list(said.values())

    def until(self, expected: list[float], seconds: float = 10.0) -> None:
        deadline = time.monotonic() + seconds
        while self.last() != expected:
            assert time.monotonic() < deadline, f"{self.last()} instead of {expected}"
            time.sleep(0.02)


@contextmanager
def program(folder: Path, *arguments: str, **changes: Any) -> Iterator[Program]:
    log = folder / "commands"
    log.touch()
    environment = {
        **os.environ,
        "ROS_DOMAIN_ID": str(random.SystemRandom().randrange(102, 160)),
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
    }
    options = RosOptions.model_validate(
        {
            "ros": 2,
            "start": [sys.executable, str(SIMULATOR), "--robots", "2", "--log", str(log), *arguments],
            "robots": 2,
            "sensors": [{"sensor": "ahead", "topic": "goal", "type": TWIST, "field": "linear.x"}],
            "actuators": [{"actuator": "speed", "topic": "cmd_vel", "type": TWIST, "field": "linear.x"}],
            "step": 0.1,
            "steps": 10,
            "patience": 2.0,
            "startup": 10.0,
            "metrics": {"ahead": {"sensor": "ahead"}, "steps": {"sensor": "ahead", "time": "count"}},
            **changes,
        }
    )
    file = folder / "attachment.json"
    file.write_text(json.dumps({**options.attachment(), "values": {}}), "utf-8")
    process = subprocess.Popen(
        [sys.executable, str(PROGRAM), str(file)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        env=environment,
        text=True,
        start_new_session=True,
    )
    try:
        yield Program(process, log)
    finally:
        for stream in (process.stdin, process.stdout):
            assert stream is not None
            stream.close()
        try:
            process.wait(10)
        finally:
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGKILL)
                process.wait()


@pytest.mark.slow
def test_robots_are_stopped_while_nobody_asks_for_a_step_and_go_on(tmp_path: Path) -> None:
    with program(tmp_path, "--realtime", "1") as running:
        first = running.reset()["sensors"]
        assert len(first) == 2
        for _ in range(3):
            answer = running.step(0.75)
        assert answer["sensors"][0][0] < first[0][0]
        running.until([0.75, 0.75])
        running.until([0.0, 0.0])
        assert "sensors" in running.step(-0.5)
        running.until([-0.5, -0.5])


@pytest.mark.slow
@pytest.mark.parametrize("way", ["end of input", "SIGTERM", "SIGINT", "SIGTERM in a step"])
def test_robots_are_stopped_when_the_program_ends(way: str, tmp_path: Path) -> None:
    duration = 0.5 if way.endswith("step") else 0.1
    with program(tmp_path, "--realtime", "1", step=duration) as running:
        running.reset()
        running.step(0.75)
        running.until([0.75, 0.75])
        assert running.process.stdin is not None
        if way == "end of input":
            running.process.stdin.close()
        elif way == "SIGTERM in a step":
            running.process.stdin.write('{"actuators": [[0.25], [0.25]]}\n')
            running.process.stdin.flush()
            running.until([0.25, 0.25])
            running.process.send_signal(signal.SIGTERM)
        else:
            running.process.send_signal(getattr(signal, way))
        running.process.wait(10)
        assert running.last() == [0.0, 0.0]


@pytest.mark.slow
def test_an_episode_ends_with_metrics_and_stopped_robots(tmp_path: Path) -> None:
    with program(tmp_path, "--realtime", "1", steps=3) as running:
        running.reset()
        assert "sensors" in running.step(0.75)
        assert "sensors" in running.step(0.75)
        answer = running.step(0.75)
        assert answer["done"]
        assert answer["metrics"]["steps"] == 4
        running.until([0.0, 0.0])
        assert len(running.reset()["sensors"]) == 2


@pytest.mark.slow
def test_seconds_of_a_simulator_that_is_faster(tmp_path: Path) -> None:
    with program(tmp_path, "--realtime", "5", step={"duration": 0.2, "clock": "ros"}, steps=10) as running:
        running.reset()
        began = time.monotonic()
        for _ in range(10):
            answer = running.step(0.5)
        took = time.monotonic() - began
        assert answer["done"]
        # 2 s of the simulator, a fifth of that on a real clock, and more on a busy machine.
        assert took < 1.8


def simulation(name: str) -> type[Simulation]:
    kind = load(name)
    assert issubclass(kind, Simulation)
    return kind


@pytest.mark.slow
def test_robots_are_driven_by_one_server(monkeypatch: pytest.MonkeyPatch) -> None:
    domain = str(random.SystemRandom().randrange(102, 160))
    monkeypatch.setenv("ROS_DOMAIN_ID", domain)
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    values = {
        "ros": 2,
        "robots": ["robot_1", "robot_2"],
        "sensors": [{"sensor": "ahead", "topic": "goal", "type": TWIST, "field": "linear.x"}],
        "actuators": [{"actuator": "speed", "topic": "cmd_vel", "type": TWIST, "field": "linear.x"}],
        "step": 0.1,
        "metrics": {"ahead": {"sensor": "ahead"}},
        "fitness": "ahead",
    }
    both, second = (
        simulation(RosOptions.model_validate({**values, "robots": robots}).name)
        for robots in (values["robots"], ["robot_2"])
    )
    with subprocess.Popen([sys.executable, str(SIMULATOR), "--robots", "2", "--realtime", "1"]) as simulator:
        try:
            one, other = both(), second()
            assert np.asarray(one.reset({}, 0)).shape == (2, 1)
            for _ in range(2):
                with pytest.raises(InputError, match="another server on this machine controls robot_2"):
                    other.reset({}, 0)
            del one
            gc.collect()
            assert np.asarray(second().reset({}, 0)).shape == (1, 1)
        finally:
            simulator.kill()


@pytest.mark.slow
@pytest.mark.parametrize("group", [True, False], ids=["group", "process"])
def test_robots_are_stopped_when_a_run_is_interrupted(group: bool, tmp_path: Path) -> None:
    """The simulator is not the run's own, as robots are not: they would keep their last command."""
    log, file = tmp_path / "commands", tmp_path / "experiment.yaml"
    log.touch()
    environment = {
        **os.environ,
        "ROS_DOMAIN_ID": str(random.SystemRandom().randrange(102, 160)),
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
    }
    experiment = {
        "simulation": {
            "ros": 2,
            "robots": 2,
            "sensors": [{"sensor": "ahead", "topic": "goal", "type": TWIST, "field": "linear.x"}],
            "actuators": [
                {"actuator": "speed", "topic": "cmd_vel", "type": TWIST, "field": "linear.x", "offset": 2.0}
            ],
            "step": {"duration": 0.2, "clock": "ros"},
            "steps": 1000,
            "metrics": {"ahead": {"sensor": "ahead"}},
        },
        "fitness": "-ahead",
        "servers": 1,
    }
    file.write_text(dump(experiment), "utf-8")
    command = [sys.executable, str(SIMULATOR), "--robots", "2", "--log", str(log), "--realtime", "1"]
    simulator = subprocess.Popen(command, env=environment)
    try:
        said = tmp_path / "said"
        with said.open("w") as errors:
            run = subprocess.Popen(
                [sys.executable, "-m", "swarmwright", "optimize", str(file), "--out", str(tmp_path / "run")],
                env=environment,
                stdout=subprocess.DEVNULL,
                stderr=errors,
                start_new_session=True,
            )
        running = Program(run, log)  # type: ignore[arg-type] # only its last commands are asked for
        try:
            deadline = time.monotonic() + 30
            while 0.0 in running.last():
                assert time.monotonic() < deadline
                assert run.poll() is None, said.read_text("utf-8")
                time.sleep(0.1)
            time.sleep(0.25)
            (os.killpg if group else os.kill)(run.pid, signal.SIGINT)
            assert run.wait(20) == 130
        finally:
            if run.poll() is None:
                os.killpg(run.pid, signal.SIGKILL)
                run.wait()
        running.until([0.0, 0.0])
    finally:
        simulator.kill()
        simulator.wait()


@pytest.mark.slow
def test_a_clock_that_stands_still(tmp_path: Path) -> None:
    step = {"duration": 0.5, "clock": "ros"}
    with program(tmp_path, "--realtime", "1", "--fault", "clock_stops", step=step) as running:
        answer = running.reset()
        for _ in range(6):
            if "error" in answer:
                break
            answer = running.step(0.5)
        assert "/clock stands still at 1.5" in answer["error"]
        running.until([0.0, 0.0])
