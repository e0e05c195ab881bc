"""Servers whose time limits end one after another, each in the middle of an evaluation."""

import signal

import pytest

from swarmwright import Run
from tests.system.brokers import BrokerProcess
from tests.system.conftest import Experiment, Launch
from tests.system.processes import Program
from tests.system.runs import attempts, record

SOURCE = """\
import os
import time

import numpy as np
from swarmwright import Simulation


class Slow(Simulation):
    title, dimensions, sensors, actuators = "slow", 1, 1, 1

    def reset(self, parameters, seed):
        self.left, self.sum = 20, 0.0
        print("begins", flush=True)
        return np.array([[1.0]])

    def step(self, actions):
        time.sleep(float(os.environ.get("PAUSE_S", 0)))
        self.left -= 1
        self.sum += float(actions[0, 0])
        return np.array([[self.sum]])

    def done(self):
        return self.left == 0

    def fitness(self):
        return self.sum
"""
EXPERIMENT = """\
simulation: slow.py:Slow
controller: {kind: layered, hidden: []}
method: {kind: random_search, population: 1, generations: 1}
validate: false
seed: 5
timeouts: {discovery: 60}
"""
ENDS = 4
"""Time limits that end: more than faults.attempts and faults.quarantine, which are 3."""


@pytest.mark.timeout(180)
@pytest.mark.parametrize("mode", ["offloaded", "stepwise", "batched"])
def test_an_evaluation_that_time_limits_end_is_repeated_and_has_not_failed(
    embedded: BrokerProcess, launch: Launch, experiment: Experiment, mode: str
) -> None:
    """The episode takes longer than a server may go on with it."""
    path = experiment(f"{EXPERIMENT}mode: {mode}\n")
    (path.parent / "slow.py").write_text(SOURCE)
    here = launch("optimize", path, "--servers", "in-process", "--out", "here")
    assert here.wait() == 0, here.stderr

    def serving(number: int, pause_s: float) -> Program:
        where = ("--broker", embedded.url, "--id", number, "--grace", 0.2, "--json")
        started = launch("serve", "slow.py:Slow", *where, env={"PAUSE_S": str(pause_s)})
        started.until_event("ready", server=number)
        return started

    server = serving(1, 0.5)
    tool = launch("optimize", path, "--broker", embedded.url, "--out", "there")
    for number in range(1, 1 + ENDS):
        server.until(lambda one: "begins" in one.stderr or "begins" in one.lines, "an episode")
        later = serving(1 + number, 0.5 if number < ENDS else 0.0)
        server.signal(signal.SIGTERM)  # as Slurm does before the limit
        server.wait()
        server = later
    assert tool.wait(60) == 0, tool.stderr
    there = path.parent / "there"
    assert record(there) == record(path.parent / "here")
    errors = [one["error"] for one in attempts(there)]
    assert errors[-1] is None
    assert set(errors[:-1]) <= {f"server {number} left" for number in range(1, 1 + ENDS)}
    assert len(errors) > ENDS
    assert not [event.text for event in Run.open(there).events() if "fail" in event.text]
    assert "failed" not in tool.stderr
    server.signal(signal.SIGTERM)
    server.wait()
    listing = launch("servers", "--broker", embedded.url, "--json")
    assert (listing.wait(), listing.lines) == (0, []), "none stays as lost"
