"""Peers that are killed or stopped in the middle of a step, and brokers that go and come back."""

import json
import re
import signal
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from swarmwright import InputError
from tests.system.brokers import BrokerProcess
from tests.system.conftest import Experiment, Launch, Serve
from tests.system.peer import TO_SERVER
from tests.system.plain_tool import PlainTool
from tests.system.processes import Program, Servers
from tests.system.recorder import Recorder
from tests.system.runs import attempts, record, warnings

LONG = """\
simulation: minisim
mode: stepwise
parameters: {maxSteps: 1000, speedAgents: 0.005, numDefenders: 0}
method: {kind: nnga, population: 8, generations: 3}
seed: 9
timeouts: {discovery: 10, step: 10}
"""


def undisturbed(launch: Launch, path: Path) -> dict[str, bytes]:
    """The record without servers and accidents."""
    local = launch("optimize", path, "--servers", "local", "--out", "local")
    assert local.wait() == 0, local.stderr
    return record(path.parent / "local")


def in_mid_episode(recorder: Recorder, server: int, after: int = 30) -> None:
    """Wait until the server has begun an episode and sent `after` more sensor messages in it."""
    deadline = time.monotonic() + 20
    read, hash_, sensed = 0, None, 0
    # Each message is read once: what is heard late would be over before it is looked at.
    while hash_ is None or sensed < after:
        assert time.monotonic() < deadline, f"server {server} does not begin"
        new = recorder.messages[read:]
        read += len(new)
        for message in new:
            content = message.json
            if message.topic == "parameters" and content["server"] == server:
                hash_, sensed = content["simulation_hash"], 0
            elif content.get("simulation_hash") == hash_:
                sensed += message.topic == "sensor"
                hash_ = None if message.topic == "fitness" else hash_
        time.sleep(0.01)


def failures(path: Path) -> list[dict[str, Any]]:
    """The attempts of a run, also of one under way, that failed."""
    with suppress(InputError):  # nothing is written before the first second is over
        return [entry for entry in attempts(path.parent / "result") if entry["error"]]
    return []


def first_generation(run: Program) -> None:
    run.until(lambda program: len(program.lines) >= 1, "a generation")


@pytest.mark.journey
def test_one_of_two_servers_is_killed(
    broker: BrokerProcess, serve: Serve, launch: Launch, connect: Any, experiment: Experiment
) -> None:
    path = experiment(f"{LONG}faults: {{backup: false}}\n")
    expected = undisturbed(launch, path)
    recorder: Recorder = connect(Recorder, broker.url, "parameters", "sensor", "fitness")
    serve(broker.url)
    servers = serve(broker.url, "--no-restart", first=2)
    run = launch("optimize", path, "--broker", broker.url, "--out", "result", "--json")
    in_mid_episode(recorder, 2)
    servers.signal_server(2, signal.SIGKILL)
    assert run.wait() == 0, run.stderr
    assert record(path.parent / "result") == expected
    episodes = attempts(path.parent / "result")
    failed = [entry for entry in episodes if entry["error"]]
    assert len(failed) == 1, [entry["error"] for entry in failed]
    failure = failed[0]
    assert failure["server"] == 2
    assert "server 2 was lost" in failure["error"]
    again = [
        entry
        for entry in episodes
        if not entry["error"]
        and (entry["generation"], entry["candidate"]) == (failure["generation"], failure["candidate"])
    ]
    assert [(entry["attempt"], entry["server"]) for entry in again] == [(2, 1)]


def test_the_only_server_is_killed_and_replaced(
    broker: BrokerProcess, serve: Serve, launch: Launch, connect: Any, experiment: Experiment
) -> None:
    """The tool says what it waits for and goes on when a server with the same id comes."""
    path = experiment(LONG)
    expected = undisturbed(launch, path)
    recorder: Recorder = connect(Recorder, broker.url, "parameters", "sensor", "fitness")
    servers = serve(broker.url, "--no-restart", first=6)
    run = launch("optimize", path, "--broker", broker.url, "--out", "result")
    in_mid_episode(recorder, 6)
    servers.signal_server(6, signal.SIGKILL)
    run.until(
        lambda program: any("waiting for a server" in line for line in program.lines), "word of the wait"
    )
    assert run.process.poll() is None
    serve(broker.url, first=6)
    assert run.wait() == 0, run.stderr
    assert record(path.parent / "result") == expected


def test_nobody_comes_back(
    embedded: BrokerProcess, serve: Serve, launch: Launch, experiment: Experiment
) -> None:
    """After the time-outs the run fails, names the lost server, and keeps its finished generations."""
    path = experiment(
        LONG.replace("generations: 3", "generations: 1000").replace("10}", "2}").replace("10,", "2,")
    )
    servers = serve(embedded.url, "--no-restart", first=6)
    run = launch("optimize", path, "--broker", embedded.url, "--out", "result", "--json")
    first_generation(run)
    servers.signal_server(6, signal.SIGKILL)
    assert run.wait() == 1
    assert run.stderr.count("server 6: lost") == 1, run.stderr
    assert json.loads((path.parent / "result" / "best.json").read_text())["fitness"] < 0


def test_a_server_that_stops_for_a_while(
    broker: BrokerProcess, serve: Serve, launch: Launch, connect: Any, experiment: Experiment
) -> None:
    """Its episode goes to the other server after the step time-out; woken, it is of use again."""
    path = experiment(LONG.replace("step: 10", "step: 1").replace("generations: 3", "generations: 12"))
    expected = undisturbed(launch, path)
    recorder: Recorder = connect(Recorder, broker.url, "parameters", "sensor", "fitness")
    servers = serve(broker.url, count=2)
    run = launch("optimize", path, "--broker", broker.url, "--out", "result", "--json")
    in_mid_episode(recorder, 2)
    servers.signal_server(2, signal.SIGSTOP)
    run.until(lambda _: any(entry["server"] == 2 for entry in failures(path)), "a step that is not answered")
    servers.signal_server(2, signal.SIGCONT)
    assert run.wait(40) == 0, run.stderr
    assert record(path.parent / "result") == expected
    # The other server may have had a copy, and be faster than the time-out.
    failed = [entry for entry in failures(path) if entry["server"] == 2]
    reasons = ("has not answered the actuators of agent 0 in step", "server 1 was faster")
    assert any(reason in failed[0]["error"] for reason in reasons)
    episodes = attempts(path.parent / "result")
    after = [entry for entry in episodes if entry["server"] == 2 and entry["started"] > failed[0]["started"]]
    assert any(entry["error"] is None for entry in after), "it was used again"


def test_the_tool_is_killed_in_the_middle_of_a_step(
    broker: BrokerProcess, serve: Serve, launch: Launch, connect: Any, experiment: Experiment
) -> None:
    """The server says who is missing and for how long, gets free, and serves the next."""
    path = experiment(LONG.replace("generations: 3", "generations: 1000"))
    recorder: Recorder = connect(Recorder, broker.url, "parameters", "sensor", "fitness")
    servers = serve(broker.url, "--step-timeout", "1")
    run = launch("optimize", path, "--broker", broker.url, "--out", "killed", "--json")
    in_mid_episode(recorder, 1)
    run.signal(signal.SIGKILL)
    killed = time.monotonic()
    servers.until_event("warning")
    assert time.monotonic() - killed < 5
    (warning,) = servers.warnings()
    assert "agent 0" in warning
    assert re.search(r" for [1-4]\.\d s; the run is given up", warning), warning
    assert "free again" in warning
    assert f"/{run.pid}" in warning, "it names the tool"
    servers.until(lambda program: program.events()[-1]["event"] == "ready", "a free server")
    again = launch("optimize", experiment(LONG, "again.yaml"), "--broker", broker.url, "--out", "again")
    assert again.wait() == 0, again.stderr


def test_interrupted_runs_free_their_servers_at_once(
    broker: BrokerProcess, serve: Serve, launch: Launch, connect: Any, experiment: Experiment
) -> None:
    path = experiment(LONG.replace("generations: 3", "generations: 1000"))
    recorder: Recorder = connect(Recorder, broker.url, "parameters", f"{TO_SERVER}+", "sensor", "fitness")
    serve(broker.url, count=2)
    run = launch("optimize", path, "--broker", broker.url, "--out", "result", "--json")
    first_generation(run)
    in_mid_episode(recorder, 1)
    run.signal(signal.SIGINT)
    assert run.wait(10) == 130
    tool: PlainTool = connect(PlainTool, broker.url)
    tool.ask("c" * 64)
    answers = {tool.hear(2)[1]["server"], tool.hear(2)[1]["server"]}
    assert answers == {1, 2}
    recorder.settle()  # it may hear of all this later than the servers
    assert {content["server"] for content in recorder.on("control") if not content["run"]} == {1, 2}
    last = json.loads(run.lines[-1])
    assert last["generations"] >= 1
    assert (
        last["best"]["fitness"] == json.loads((path.parent / "result" / "best.json").read_text())["fitness"]
    )


@pytest.mark.journey
def test_the_broker_is_killed_and_comes_back(
    broker: BrokerProcess, serve: Serve, launch: Launch, experiment: Experiment
) -> None:
    """Servers and tool connect again; no episode counts as failed; the record is the same."""
    path = experiment(LONG)
    expected = undisturbed(launch, path)
    servers: Servers = serve(broker.url, count=2)
    with Recorder(broker.url, "parameters", "sensor", "fitness") as recorder:
        run = launch("optimize", path, "--broker", broker.url, "--out", "result", "--json")
        in_mid_episode(recorder, 1)
    broker.kill()
    for server in (1, 2):
        servers.until_event("lost", server=server)
    broker.start()
    assert run.wait() == 0, run.stderr
    assert record(path.parent / "result") == expected
    broken = [entry for entry in attempts(path.parent / "result") if entry["error"]]
    assert broken
    reasons = ("the connection to the broker broke", "was faster")
    assert all(any(reason in entry["error"] for reason in reasons) for entry in broken)
    told = warnings(path.parent / "result")
    assert any("lost the broker" in warning for warning in told)
    assert any("the broker is back" in warning for warning in told)
    for server in (1, 2):
        assert len(servers.events("ready", server)) >= 2
