"""Simulation servers in Java: the same records, to the byte, as those of the built-in servers."""

import signal
import subprocess
from pathlib import Path
from typing import Any

import pytest

from tests.java import jar
from tests.system.brokers import BrokerProcess
from tests.system.conftest import EXPERIMENT, Experiment, Launch, Serve, ServeJava
from tests.system.peer import PRESENCE, Peer
from tests.system.plain_tool import PlainTool
from tests.system.runs import attempts, record
from tests.system.test_plain_tool import CONVERSATIONS

pytestmark = pytest.mark.timeout(600)  # the first of them builds the jar


@pytest.mark.journey
@pytest.mark.parametrize("mode", ["stepwise", "batched", "offloaded"])
def test_the_record_is_that_of_the_built_in_server(
    embedded: BrokerProcess,
    serve_java: ServeJava,
    launch: Launch,
    experiment: Experiment,
    expected: dict[str, Any],
    mode: str,
) -> None:
    serve_java(embedded.url)
    path = experiment(f"{EXPERIMENT}mode: {mode}\n")
    program = launch("optimize", path, "--broker", embedded.url, "--out", "java")
    assert program.wait() == 0, program.stderr
    assert record(path.parent / "java") == expected


@pytest.mark.parametrize(
    "controller",
    [
        "{kind: layered, hidden: [5, 3], activation: sigmoid}",
        "{kind: mealy_fsm, states: 3, levels: 3}",
        "{kind: evostick}",
        "{kind: hebbian, hidden: 1, learning_range: 0.5}",
        "{kind: neat, weight_range: 4, sources: [[0, 4, 5], [1, 2, 3, 4, 5]]}",
        "{kind: neat, recurrent: true, add_node: 0.5, add_connection: 0.5}",
    ],
    ids=["layered", "mealy_fsm", "evostick", "hebbian", "neat", "growing"],
)
def test_other_controllers_are_evaluated_to_the_bit(
    embedded: BrokerProcess, serve_java: ServeJava, launch: Launch, experiment: Experiment, controller: str
) -> None:
    serve_java(embedded.url)
    text = EXPERIMENT.replace("{kind: fully_meshed, hidden: 2}", controller)
    records = []
    for name, where in (("local", ["--servers", "local"]), ("java", ["--broker", embedded.url])):
        path = experiment(text if name == "local" else f"{text}mode: offloaded\n", f"{name}.yaml")
        program = launch("optimize", path, *where, "--out", name)
        assert program.wait() == 0, program.stderr
        records.append(record(path.parent / name))
    assert records[0] == records[1]


@pytest.mark.parametrize("mode", ["stepwise", "offloaded"])
def test_tools_have_a_server_in_turns(
    embedded: BrokerProcess, serve_java: ServeJava, launch: Launch, experiment: Experiment, mode: str
) -> None:
    """A short run is through while one goes on that would take hours."""
    serve_java(embedded.url)
    text = f"simulation: minisim\nmode: {mode}\nmethod: {{population: 100, generations: GENERATIONS}}\n"
    endless = experiment(text.replace("GENERATIONS", "1000000"), "endless.yaml")
    first = launch("optimize", endless, "--broker", embedded.url, "--out", "endless")
    first.until(lambda _: (endless.parent / "endless" / "run.sqlite").exists(), "the first run")
    short = experiment(text.replace("GENERATIONS", "2"), "short.yaml")
    second = launch("optimize", short, "--broker", embedded.url, "--out", "short")
    assert second.wait(60) == 0, second.stderr
    assert first.process.poll() is None
    local = launch("optimize", short, "--servers", "local", "--out", "local")
    assert local.wait() == 0, local.stderr
    assert record(short.parent / "short") == record(short.parent / "local")


@pytest.mark.parametrize("mode", ["stepwise", "offloaded"])
def test_a_built_in_and_a_java_server_together(
    embedded: BrokerProcess,
    serve: Serve,
    serve_java: ServeJava,
    launch: Launch,
    experiment: Experiment,
    expected: dict[str, Any],
    mode: str,
) -> None:
    serve(embedded.url, first=1)
    serve_java(embedded.url, server=2)
    path = experiment(f"{EXPERIMENT}mode: {mode}\n")
    program = launch("optimize", path, "--broker", embedded.url, "--out", "both")
    assert program.wait() == 0, program.stderr
    assert record(path.parent / "both") == expected
    if mode == "stepwise":
        assert {entry["server"] for entry in attempts(path.parent / "both")} == {1, 2}


def test_the_wrapper_of_d61_gives_the_same_record(
    broker: BrokerProcess,
    serve_java: ServeJava,
    launch: Launch,
    experiment: Experiment,
    expected: dict[str, Any],
) -> None:
    """It announces nothing, so that the experiment has to tell the sizes."""
    serve_java(broker.url, "--plain")
    path = experiment(f"{EXPERIMENT}sensors: 4\nactuators: 1\n")
    program = launch("optimize", path, "--broker", broker.url, "--out", "plain")
    assert program.wait() == 0, program.stderr
    assert record(path.parent / "plain") == expected


def test_conversations(broker: BrokerProcess, serve_java: ServeJava) -> None:
    serve_java(broker.url)
    assert len(CONVERSATIONS) >= 9
    for name, conversation in CONVERSATIONS.items():
        with PlainTool(broker.url) as tool:
            heard = tool.replay(conversation)
            assert heard == sum(entry.get("from") == "server" for entry in conversation["messages"]), name
            if name == "reserved":
                bye = {"server": 1, "simulation_hash": "d" * 64, "run": False, "tool": "ada@lab-3/4711"}
                tool.send("control", **bye)


def test_metrics_and_parameters_of_the_simulation_are_evolved(
    embedded: BrokerProcess, serve_java: ServeJava, launch: Launch, experiment: Experiment
) -> None:
    """A fitness made of metrics, and a simulation that steers its agents itself, in every mode."""
    serve_java(embedded.url)
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


def test_presence_tells_of_the_server_and_of_its_loss(
    broker: BrokerProcess, serve_java: ServeJava, connect: Any
) -> None:
    server = serve_java(broker.url, server=5)
    watcher = connect(Peer, broker.url, f"{PRESENCE}+")
    first = watcher.inbox.get(timeout=10).json
    assert (first["server"], first["state"], first["simulations"]) == (5, "ready", ["minisim"])
    assert first["capabilities"]["swarmwright"]["metrics"] == ["arrived", "caught", "steps", "distance"]
    server.signal(signal.SIGKILL)
    assert watcher.inbox.get(timeout=10).json["state"] == "lost"
    again = serve_java(broker.url, server=5)
    assert watcher.inbox.get(timeout=10).json["state"] == "ready"
    again.stop()
    assert watcher.inbox.get(timeout=10).payload == b"", again.stderr


def test_an_id_that_is_taken_and_arguments_that_are_wrong(
    embedded: BrokerProcess, serve: Serve, tmp_path: Path
) -> None:
    serve(embedded.url, first=3)
    for options, status, words in (
        (["--broker", embedded.url, "--id", "3"], 1, "the id 3 is taken by a server on"),
        (["--broker", "http://x", "--id", "4"], 2, "the scheme must be mqtt://"),
        (["--id", "one"], 2, '--id: "one" is not a number'),
        (["--colour", "red"], 2, "--colour: unknown"),
        (["--broker", "mqtt://127.0.0.1:1", "--id", "4"], 1, "no connection to the broker at"),
    ):
        command = ["java", "-jar", str(jar()), *options]
        result = subprocess.run(
            command, capture_output=True, text=True, timeout=30, cwd=tmp_path, check=False
        )
        assert (result.returncode, words in result.stderr) == (status, True), result.stderr
        assert "Exception" not in result.stderr
