"""Servers that fail whatever they get, and servers that are lost or stopped again and again.

The record is as if nothing had been, or the run ends, says why, and can be resumed.
"""

import os
import signal
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmwright import Run
from tests.system.brokers import BrokerProcess
from tests.system.conftest import Experiment, Launch
from tests.system.processes import Program
from tests.system.runs import record, warnings

pytestmark = pytest.mark.timeout(180)

SIMULATION = """\
import os
import time
from pathlib import Path

import swarmwright


class Work(swarmwright.Simulation):
    title, dimensions, sensors, actuators = "work", 1, 1, 1
    determinism = os.environ.get("DETERMINISM", "none")

    def reset(self, parameters, seed):
        if os.environ.get("BROKEN") or Path("broken").exists():
            raise ImportError("libphysics.so.3: cannot open shared object file")
        self.left, self.sum = 5, 0.0
        return [[0.5]]

    def step(self, actions):
        time.sleep(float(os.environ.get("PACE", "0")))
        self.left -= 1
        self.sum += float(actions[0, 0])
        return [[self.sum]]

    def done(self):
        return self.left == 0

    def fitness(self):
        return self.sum
"""
EXPERIMENT = """\
simulation: {simulation}
requirements: {{dimensions: 1}}
sensors: 1
actuators: 1
controller: {{kind: layered, hidden: []}}
method: {{kind: nnga, population: {population}, generations: 3}}
seed: 5
mode: {mode}
timeouts: {{discovery: 10, step: {step}}}
"""
MODES = ["stepwise", "batched", "offloaded"]
ServeWork = Callable[..., Program]


@pytest.fixture
def serve_work(embedded: BrokerProcess, launch: Launch, tmp_path: Path) -> ServeWork:
    """Starts a server: `serve_work(id, BROKEN=...)`."""
    (tmp_path / "work.py").write_text(SIMULATION)

    def start(server: int, **variables: str) -> Program:
        arguments = ["serve", "work.py:Work", "--broker", embedded.url, "--id", server, "--count", 1]
        program = launch(*arguments, "--json", env=variables)
        program.until_event("ready")
        return program

    return start


def written(experiment: Experiment, launch: Launch, mode: str, population: int = 19, step: float = 20) -> Any:
    """The experiment's file, and the record without servers and accidents."""
    values = {"mode": mode, "population": population, "step": step}
    local = experiment(EXPERIMENT.format(simulation="work.py:Work", **values), "local.yaml")
    program = launch("optimize", local, "--servers", "in-process", "--out", "local")
    assert program.wait() == 0, program.stderr
    return experiment(EXPERIMENT.format(simulation="work", **values)), record(local.parent / "local")


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize(("good", "determinism"), [(1, "none"), (2, "bitwise")])
def test_broken_installations_cost_nothing_but_are_named(
    embedded: BrokerProcess,
    serve_work: ServeWork,
    launch: Launch,
    experiment: Experiment,
    mode: str,
    good: int,
    determinism: str,
) -> None:
    for server in range(1, 5):
        broken = {} if server <= good else {"BROKEN": "1"}
        serve_work(server, PACE="0.01", DETERMINISM=determinism, **broken)
    path, expected = written(experiment, launch, mode)
    run = launch("optimize", path, "--broker", embedded.url, "--out", "result")
    assert run.wait(60) == 0, run.stderr
    failed = np.isnan(Run.open(path.parent / "result").record.fitness)
    assert not failed.any(), f"{failed.sum()} of {failed.size}"
    assert record(path.parent / "result") == expected
    told = [text for text in warnings(path.parent / "result") if "is broken: it fails" in text]
    assert told
    assert all("libphysics" in text for text in told)
    assert len(told) == len(set(told))


@pytest.mark.parametrize("mode", MODES)
def test_when_all_break_the_run_ends_and_is_resumed(
    embedded: BrokerProcess, serve_work: ServeWork, launch: Launch, experiment: Experiment, mode: str
) -> None:
    servers = [serve_work(server, PACE="0.04") for server in (1, 2)]
    path, expected = written(experiment, launch, mode)
    flag = path.parent / "broken"
    run = launch("optimize", path, "--broker", embedded.url, "--out", "result", "--json")
    run.until(lambda program: len(program.lines) >= 1, "a generation")
    time.sleep(0.3)
    flag.touch()
    assert run.wait(60) == 1, run.stderr
    assert "libphysics" in run.stderr, run.stderr
    flag.unlink()
    again = launch("resume", "result", "--broker", embedded.url)
    assert again.wait(60) == 0, again.stderr
    assert record(path.parent / "result") == expected
    assert all(server.process.poll() is None for server in servers)


def pids(servers: list[Program]) -> list[int]:
    """Of the servers' last starts."""
    return [int(program.events("ready")[-1]["pid"]) for program in servers]


@pytest.mark.parametrize("mode", ["stepwise", "offloaded"])
def test_servers_that_are_killed_and_replaced_again_and_again_are_no_candidates_failure(
    embedded: BrokerProcess, serve_work: ServeWork, launch: Launch, experiment: Experiment, mode: str
) -> None:
    servers = [serve_work(server, PACE="0.3") for server in (1, 2)]
    path, expected = written(experiment, launch, mode, population=3)
    run = launch("optimize", path, "--broker", embedded.url, "--out", "result")
    time.sleep(4)  # something has succeeded
    for _ in range(4):
        starts = [len(program.events("ready")) for program in servers]
        for pid in pids(servers):
            os.kill(pid, signal.SIGKILL)
        for program, count in zip(servers, starts, strict=True):
            program.until_event("ready", count + 1)
        time.sleep(0.7)  # an evaluation is under way, and takes 1.5 s
    status = run.wait(60)
    ended_well(run, status, path, expected, launch, embedded)


@pytest.mark.parametrize("mode", MODES)
def test_servers_that_are_stopped_again_and_again_are_no_candidates_failure(
    embedded: BrokerProcess, serve_work: ServeWork, launch: Launch, experiment: Experiment, mode: str
) -> None:
    servers = [serve_work(server, PACE="0.2") for server in (1, 2)]
    path, expected = written(experiment, launch, mode, population=6, step=1.5)
    run = launch("optimize", path, "--broker", embedded.url, "--out", "result")
    time.sleep(3)
    for _ in range(5):
        for pid in pids(servers):
            os.kill(pid, signal.SIGSTOP)
        time.sleep(2.2)
        for pid in pids(servers):
            os.kill(pid, signal.SIGCONT)
        time.sleep(0.5)
    status = run.wait(60)
    ended_well(run, status, path, expected, launch, embedded)


def ended_well(
    run: Program, status: int, path: Path, expected: Any, launch: Launch, broker: BrokerProcess
) -> None:
    """The record is that of an undisturbed run, at once or after the run was resumed."""
    folder = path.parent / "result"
    if status:
        assert "lost or silent" in run.stderr or "no server fits" in run.stderr, run.stderr
        assert not np.isnan(Run.open(folder).record.fitness).any()
        again = launch("resume", "result", "--broker", broker.url)
        assert again.wait(60) == 0, again.stderr
    assert not np.isnan(Run.open(folder).record.fitness).any()
    assert record(folder) == expected
