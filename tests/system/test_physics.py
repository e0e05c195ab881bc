"""Missions of the arena whose robots a simulator in C++ moves."""

import subprocess
from typing import Any

import pytest

from tests.cpp import build
from tests.system.brokers import BrokerProcess
from tests.system.conftest import Experiment, Launch, ServeCpp
from tests.system.runs import record

pytestmark = pytest.mark.timeout(600)  # the first of them builds the library

EXPERIMENT = """simulation: arena-floating
parameters: {mission: aggregation, robots: 5, duration: 5}
controller: {kind: evostick}
method: {kind: evostick, population: 6, elites: 2, generations: 3}
ranking: {episodes: 2, seeds: new}
validate: false
"""


@pytest.fixture
def records(
    embedded: BrokerProcess, serve_cpp: ServeCpp, launch: Launch, experiment: Experiment
) -> dict[str, Any]:
    """The records of one experiment, by what is changed in it."""
    serve_cpp(embedded.url, main="floating")
    found = {}
    for name, more in {
        "offloaded": "mode: offloaded\n",
        "stepwise": "mode: stepwise\n",
        "batched": "mode: batched\n",
    }.items():
        path = experiment(EXPERIMENT + more)
        program = launch("optimize", path, "--broker", embedded.url, "--out", name)
        assert program.wait() == 0, program.stderr
        found[name] = record(path.parent / name)
    return found


def test_all_modes_give_the_same_record(records: dict[str, Any]) -> None:
    assert records["offloaded"] == records["stepwise"] == records["batched"]


def test_the_run_is_replayed_and_transferred(
    embedded: BrokerProcess, serve_cpp: ServeCpp, launch: Launch, experiment: Experiment
) -> None:
    serve_cpp(embedded.url, main="floating")
    path = experiment(EXPERIMENT.replace("arena-floating", "arena"))
    program = launch("optimize", path, "--servers", "local", "--out", "here")
    assert program.wait() == 0, program.stderr
    options = ["--broker", embedded.url]
    table = path.parent / "table.csv"
    program = launch("transfer", "here", "--to", "arena-floating", "--seeds", "3", "--csv", table, *options)
    assert program.wait() == 0, program.stderr
    assert table.read_text().count("arena-floating") == 10 * 3
    there = experiment(EXPERIMENT)
    program = launch("optimize", there, "--out", "there", *options)
    assert program.wait() == 0, program.stderr
    program = launch("replay", "there", "--save", "there.gif", *options)
    assert program.wait() == 0, program.stderr
    assert (path.parent / "there.gif").stat().st_size > 10_000


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("mission: aggregation", "mission: agregation"), 'mission: "agregation" found, expected the name'),
        (("robots: 5", "robot: 5"), "robot: 5 found, expected the name of a robot"),
        (("{kind: evostick}", "{kind: chocolate}"), "chocolate"),
    ],
)
def test_experiments_know_the_missions_before_any_server(
    launch: Launch, experiment: Experiment, change: tuple[str, str], message: str
) -> None:
    program = launch("optimize", experiment(EXPERIMENT.replace(*change)), "--broker", "mqtt://localhost:1")
    assert program.wait() != 0
    assert message in program.stderr
    assert "Traceback" not in program.stderr


def test_without_a_broker_it_is_said_that_one_is_needed(launch: Launch, experiment: Experiment) -> None:
    program = launch("optimize", experiment(EXPERIMENT), "--servers", "local")
    assert program.wait() != 0
    assert "need a broker with a server that offers them" in program.stderr


def test_several_threads_are_refused(embedded: BrokerProcess) -> None:
    command = [str(build() / "floating"), "--broker", embedded.url, "--threads", "2"]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)
    assert done.returncode == 2
    assert "start more servers" in done.stderr
