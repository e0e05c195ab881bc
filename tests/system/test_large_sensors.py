"""Agents that see much: sensor messages above 1 MiB, and above what a broker takes."""

from pathlib import Path

import pytest

from tests.system.brokers import BrokerProcess
from tests.system.conftest import Experiment, Launch
from tests.system.runs import evaluations, warnings

EYE = '''\
import numpy as np

from swarmwright import Simulation


class Eye(Simulation):
    """One agent that sees 170,000 numbers, about 1.9 MB of JSON."""

    sensors = 170_000
    actuators = 1

    def reset(self, parameters, seed):
        self.random, self.left, self.sum = np.random.default_rng(seed), 2, 0.0
        return self.seen()

    def step(self, actions):
        self.sum += float(actions[0, 0])
        self.left -= 1
        return self.seen()

    def seen(self):
        return self.random.uniform(-1, 1, (1, self.sensors))

    def done(self):
        return self.left == 0

    def fitness(self):
        return self.sum
'''
EXPERIMENT = """\
simulation: eye
mode: stepwise
controller: {kind: layered, hidden: []}
method: {kind: random_search, population: 2, generations: 1}
seed: 3
"""


@pytest.fixture(autouse=True)
def eye(tmp_path: Path) -> None:
    (tmp_path / "eye.py").write_text(EYE, encoding="utf-8")


def test_sensors_of_two_megabytes_are_stepped(
    broker: BrokerProcess, launch: Launch, experiment: Experiment, tmp_path: Path
) -> None:
    launch("serve", "eye.py:Eye", "--broker", broker.url, "--json").until_event("ready")
    tool = launch("optimize", experiment(EXPERIMENT), "--broker", broker.url, "--out", "run")
    assert tool.wait(50) == 0, tool.stderr
    fitness = [value for value, _ in evaluations(tmp_path / "run")]
    assert len(fitness) == 2
    assert all(-2 <= value <= 2 for value in fitness), "none failed"
    assert not warnings(tmp_path / "run")


def test_sensors_above_what_the_broker_takes_are_refused_at_once_with_both_figures(
    tmp_path: Path, launch: Launch, experiment: Experiment
) -> None:
    process = BrokerProcess("mosquitto", tmp_path / "narrow")
    with (tmp_path / "narrow" / "mosquitto.conf").open("a") as file:
        file.write("max_packet_size 1000000\n")
    narrow = process.start()
    try:
        launch("serve", "eye.py:Eye", "--broker", narrow.url, "--json").until_event("ready")
        tool = launch("optimize", experiment(EXPERIMENT), "--broker", narrow.url, "--out", "run")
        assert tool.wait(20) == 1
        assert "no server can do this work" in tool.stderr
        assert "a sensor message of 1" in tool.stderr
        assert "is larger than the 1000000 that the broker takes" in tool.stderr
    finally:
        process.stop()
