"""Simulators whose steps take longer than servers wait for actuators, or than the keep-alive interval."""

import json
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import paho.mqtt.client as mqtt
import pytest
from paho.mqtt.enums import CallbackAPIVersion

from swarmwright import Run
from tests.python.cli.test_services import events

SLOW = """\
import time

import numpy as np

from swarmwright import Simulation


class Slow(Simulation):
    title = "slow"
    sensors = 1
    actuators = 1
    max_agents = 1

    def reset(self, parameters, seed):
        self.steps = 0
        time.sleep({seconds})
        return np.zeros((1, 1))

    def step(self, actions):
        self.steps += 1
        time.sleep({seconds})
        return np.zeros((1, 1))

    def done(self):
        return self.steps == 2

    def fitness(self):
        return float(self.steps)
"""
DISCOVERY = {"simulation": "another", "simulation_hash": "h", "requirements": {"dimensions": 2}}
EXPERIMENT = """\
simulation: slow.py:Slow
mode: {}
method: {{kind: random_search, population: 2, generations: 1}}
"""


@contextmanager
def discoveries(url: str) -> Iterator[None]:
    """Messages that servers get meanwhile, several a second."""
    client = mqtt.Client(CallbackAPIVersion.VERSION2)
    client.connect("127.0.0.1", int(url.rpartition(":")[2]))
    client.loop_start()
    ended = threading.Event()

    def publish() -> None:
        while not ended.wait(0.2):
            client.publish("discovery", json.dumps(DISCOVERY))

    thread = threading.Thread(target=publish)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()
        client.disconnect()
        client.loop_stop()


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["stepwise", "batched"])
def test_a_step_may_take_longer_than_the_wait_for_actuators(
    program: Any, start: Any, embedded_broker: str, tmp_path: Path, mode: str
) -> None:
    (tmp_path / "slow.py").write_text(SLOW.format(seconds=1))
    (tmp_path / "e.yaml").write_text(EXPERIMENT.format(mode))
    server = start("serve", "slow.py:Slow", "--broker", embedded_broker, "--step-timeout", "0.5", "--json")
    events(server, "ready")
    run = program("optimize", "e.yaml", "--broker", embedded_broker, "--out", "run")
    assert (run.returncode, "has not sent" in run.stderr) == (0, False), run.stderr
    opened = Run.open(tmp_path / "run")
    assert (opened.best.fitness, opened.evaluations) == (2, 2)


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["stepwise", "batched"])
def test_a_step_may_take_longer_than_the_keep_alive_interval(
    program: Any, start: Any, embedded_broker: str, tmp_path: Path, mode: str
) -> None:
    (tmp_path / "slow.py").write_text(SLOW.format(seconds=3))  # the broker waits for 1.5 s
    (tmp_path / "e.yaml").write_text(EXPERIMENT.format(mode))
    often = {"SWARMWRIGHT_KEEP_ALIVE": "1"}
    server = start("serve", "slow.py:Slow", "--broker", embedded_broker, "--json", env=often)
    events(server, "ready")
    few = ("--set", "method.population=1")
    with discoveries(embedded_broker):
        run = program("optimize", "e.yaml", "--broker", embedded_broker, "--out", "run", *few)
    assert run.returncode == 0, run.stderr
    assert Run.open(tmp_path / "run").best.fitness == 2
    server.terminate()
    assert '"lost"' not in server.communicate(timeout=20)[0]
