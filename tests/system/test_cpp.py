"""Simulation servers in C++: the same records, to the byte, as those of the built-in servers."""

import signal
import subprocess
from pathlib import Path
from typing import Any

import pytest

from tests.cpp import build
from tests.system.brokers import BrokerProcess
from tests.system.conftest import EXPERIMENT, Experiment, Launch, Serve, ServeCpp
from tests.system.peer import PRESENCE, Peer
from tests.system.plain_tool import PlainTool
from tests.system.runs import attempts, record
from tests.system.test_plain_tool import CONVERSATIONS

pytestmark = pytest.mark.timeout(600)  # the first of them builds the library

MAINS = pytest.mark.parametrize("main", ["minisim", "minisim_plugin"])


@pytest.mark.journey
@MAINS
@pytest.mark.parametrize("mode", ["stepwise", "batched", "offloaded"])
def test_the_record_is_that_of_the_built_in_server(
    embedded: BrokerProcess,
    serve_cpp: ServeCpp,
    launch: Launch,
    experiment: Experiment,
    expected: dict[str, Any],
    main: str,
    mode: str,
) -> None:
    serve_cpp(embedded.url, main=main)
    path = experiment(f"{EXPERIMENT}mode: {mode}\n")
    program = launch("optimize", path, "--broker", embedded.url, "--out", "cpp")
    assert program.wait() == 0, program.stderr
    assert record(path.parent / "cpp") == expected


def test_several_threads_give_the_same_record(
    embedded: BrokerProcess,
    serve_cpp: ServeCpp,
    launch: Launch,
    experiment: Experiment,
    expected: dict[str, Any],
) -> None:
    serve_cpp(embedded.url, "--threads", "3")
    path = experiment(f"{EXPERIMENT}mode: offloaded\n")
    program = launch("optimize", path, "--broker", embedded.url, "--out", "threads")
    assert program.wait() == 0, program.stderr
    assert record(path.parent / "threads") == expected


@pytest.mark.parametrize("mode", ["stepwise", "offloaded"])
def test_a_built_in_and_two_cpp_servers_together(
    embedded: BrokerProcess,
    serve: Serve,
    serve_cpp: ServeCpp,
    launch: Launch,
    experiment: Experiment,
    expected: dict[str, Any],
    mode: str,
) -> None:
    serve(embedded.url, first=1)
    serve_cpp(embedded.url, server=2)
    serve_cpp(embedded.url, server=3, main="minisim_plugin")
    path = experiment(f"{EXPERIMENT}mode: {mode}\n")
    program = launch("optimize", path, "--broker", embedded.url, "--out", "together")
    assert program.wait() == 0, program.stderr
    assert record(path.parent / "together") == expected
    if mode == "stepwise":
        assert {entry["server"] for entry in attempts(path.parent / "together")} == {1, 2, 3}


@MAINS
def test_conversations(broker: BrokerProcess, serve_cpp: ServeCpp, main: str) -> None:
    serve_cpp(broker.url, main=main)
    assert len(CONVERSATIONS) >= 9
    for name, conversation in CONVERSATIONS.items():
        with PlainTool(broker.url) as tool:
            heard = tool.replay(conversation)
            assert heard == sum(entry.get("from") == "server" for entry in conversation["messages"]), name
            if name == "reserved":
                bye = {"server": 1, "simulation_hash": "d" * 64, "run": False, "tool": "ada@lab-3/4711"}
                tool.send("control", **bye)


@MAINS
def test_metrics_and_parameters_of_the_simulation_are_evolved(
    embedded: BrokerProcess, serve_cpp: ServeCpp, launch: Launch, experiment: Experiment, main: str
) -> None:
    """A fitness made of metrics, and a simulation that steers its agents itself, in every mode."""
    serve_cpp(embedded.url, main=main)
    metrics = EXPERIMENT + 'fitness: "arrived - 0.01 * steps + fitness"\n'
    avoidance = """\
simulation: minisim
parameters: {steering: rule, numAgents: 3, numDefenders: 2, placement: random}
controller:
  kind: parameter_set
  parameters:
    avoidance: {type: real, range: [0, 4]}
    evasion: {type: categorical, choices: [away, left, right]}
method: {kind: random_search, population: 8, generations: 2}
seed: 2
"""
    for name, text in (("metrics", metrics), ("avoidance", avoidance)):
        records = []
        for mode in ("local", "stepwise", "batched", "offloaded"):
            where = ["--servers", "local"] if mode == "local" else ["--broker", embedded.url]
            path = experiment(text if mode == "local" else f"{text}mode: {mode}\n", f"{name}-{mode}.yaml")
            program = launch("optimize", path, *where, "--out", f"{name}-{mode}")
            assert program.wait() == 0, program.stderr
            records.append(record(path.parent / f"{name}-{mode}"))
        assert all(other == records[0] for other in records[1:]), name


@MAINS
def test_presence_tells_of_the_server_and_of_its_loss(
    broker: BrokerProcess, serve_cpp: ServeCpp, connect: Any, main: str
) -> None:
    server = serve_cpp(broker.url, server=5, main=main)
    watcher = connect(Peer, broker.url, f"{PRESENCE}+")
    first = watcher.inbox.get(timeout=10).json
    assert (first["server"], first["state"], first["simulations"]) == (5, "ready", ["minisim"])
    announced = first["capabilities"]["swarmwright"]
    assert announced["metrics"] == ["arrived", "caught", "steps", "distance"]
    assert announced["determinism"] == "bitwise"
    assert announced["batch"] == (256 if main == "minisim" else 1)
    server.signal(signal.SIGKILL)
    assert watcher.inbox.get(timeout=10).json["state"] == "lost"
    again = serve_cpp(broker.url, server=5, main=main)
    assert watcher.inbox.get(timeout=10).json["state"] == "ready"
    again.stop()
    assert watcher.inbox.get(timeout=10).payload == b"", again.stderr
    assert again.process.returncode == 0


@MAINS
def test_an_id_that_is_taken_and_arguments_that_are_wrong(
    embedded: BrokerProcess, serve: Serve, tmp_path: Path, main: str
) -> None:
    serve(embedded.url, first=3)
    for options, status, words in (
        (["--broker", embedded.url, "--id", "3"], 1, "the id 3 is taken by a server on"),
        (["--broker", "http://x", "--id", "4"], 2, "the scheme must be mqtt://"),
        (["--id", "one"], 2, '--id: "one" is not a number'),
        (["--id", "18446744073709551615"], 2, "the id is 18446744073709551615, expected a number from 0"),
        (["--step-timeout=0"], 2, "the step time-out is 0 s"),
        (["--step-timeout"], 2, "--step-timeout: expected a value"),
        (["--colour", "red"], 2, "--colour: unknown"),
        (["--broker", embedded.url, "--prefix", "a/#"], 2, "prefix"),
        (["--broker", "mqtt://127.0.0.1:1", "--id", "4"], 1, "no broker answers at"),
    ):
        command = [str(build() / main), *options]
        result = subprocess.run(
            command, capture_output=True, text=True, timeout=30, cwd=tmp_path, check=False
        )
        assert (result.returncode, words in result.stderr) == (status, True), result.stderr


def test_an_episode_is_shown(embedded: BrokerProcess, serve_cpp: ServeCpp) -> None:
    server = serve_cpp(embedded.url)
    with PlainTool(embedded.url) as tool:
        digest = "e" * 64
        tool.send("parameters", server=1, simulation_hash=digest, stepSize=1, maxSteps=2, numDefenders=0)
        tool.send("control", server=1, simulation_hash=digest, run=True, visual=True)
        server.until(lambda _: len(server.lines) >= 8, "a picture")
    assert server.lines[:5] == ["Welcome to minisim, step 0", *["." * 13] * 3, "A...........X"]
