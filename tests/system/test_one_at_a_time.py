"""A server serves one optimization tool at a time; `swarmwright servers` says whom."""

import json
import re
import signal
import threading
import time
from typing import Any

import pytest

from tests.system.brokers import BrokerProcess
from tests.system.conftest import Experiment, Launch, Serve
from tests.system.plain_tool import PlainTool
from tests.system.runs import attempts, record

ENDLESS = "simulation: minisim\nmode: stepwise\nmethod: {population: 10, generations: 1000000}\n"
WAITING = ENDLESS.replace("1000000", "2") + "timeouts: {discovery: 2}\n"


def listed(launch: Launch, url: str) -> dict[int, dict[str, Any]]:
    """What `swarmwright servers --json` says, by id."""
    program = launch("servers", "--broker", url, "--json", "--wait", "0.3")
    assert program.wait() == 0, program.stderr
    found = [json.loads(line) for line in program.lines]
    return {server["server"]: server for server in found}


def test_a_plain_tool_holds_its_server(
    broker: BrokerProcess, serve: Serve, launch: Launch, connect: Any, experiment: Experiment
) -> None:
    """Ours waits, longer than its discovery time-out, for the server is there and busy; then it gets it."""
    servers = serve(broker.url)
    tool: PlainTool = connect(PlainTool, broker.url)
    assert tool.discover("a" * 64) is not None
    sensor = tool.begin(1, "a" * 64, maxSteps=2, numDefenders=0)
    servers.until_event("busy")
    state = listed(launch, broker.url)[1]
    assert (state["state"], state["tool"]) == ("busy", None)
    path = experiment(WAITING)
    run = launch("optimize", path, "--broker", broker.url, "--out", "result")
    time.sleep(4)
    assert run.process.poll() is None, run.stderr
    assert not (path.parent / "result").exists()
    for _ in range(2):
        tool.send("actuator", simulation_hash="a" * 64, agent=sensor["agent"], actuator=[0])
    assert [tool.hear()[0], tool.hear()[0]] == ["sensor", "fitness"]
    assert run.wait() == 0, run.stderr
    assert all(entry["attempt"] == 1 for entry in attempts(path.parent / "result"))
    assert listed(launch, broker.url)[1]["state"] == "ready"


def test_nobody_else_is_answered_while_a_run_lasts(
    broker: BrokerProcess, serve: Serve, launch: Launch, connect: Any, experiment: Experiment
) -> None:
    """Also between episodes and generations; and at once when the run ends."""
    serve(broker.url, count=2)
    run = launch("optimize", experiment(ENDLESS), "--broker", broker.url, "--out", "result", "--json")
    run.until(lambda r: len(r.lines) >= 3, "three generations")
    tool: PlainTool = connect(PlainTool, broker.url)
    stop = time.monotonic() + 2
    while time.monotonic() < stop:
        tool.ask("b" * 64)
        tool.ask("b" * 64, dimensions=2, max_agents=1)
        time.sleep(0.02)
    heard = [tool.inbox.get() for _ in range(tool.inbox.qsize())]
    assert not any(
        message.topic == "server" and message.json["simulation_hash"] == "b" * 64 for message in heard
    )
    assert any(message.topic == "fitness" for message in heard), "the run went on meanwhile"
    states = listed(launch, broker.url)
    assert {state["state"] for state in states.values()} == {"busy"}
    holders = {state["tool"] for state in states.values()}
    assert len(holders) == 1
    assert re.fullmatch(rf"swarmwright@[^@/]+/{run.pid}/[0-9a-f]{{4}}", holders.pop())
    run.signal(signal.SIGINT)
    assert run.wait() == 130
    ended = time.monotonic()
    answered: set[int] = set()
    while len(answered) < 2 and time.monotonic() < ended + 3:
        tool.ask("c" * 64)
        time.sleep(0.05)
        while tool.inbox.qsize():
            message = tool.inbox.get()
            if message.topic == "server" and message.json["simulation_hash"] == "c" * 64:
                answered.add(message.json["server"])
    assert answered == {1, 2}


def test_two_tools_and_one_server(
    broker: BrokerProcess, serve: Serve, launch: Launch, experiment: Experiment
) -> None:
    """Both begin at the same time; one gets the server, the other waits; both records are as they should."""
    serve(broker.url)
    text = "simulation: minisim\nmode: stepwise\nmethod: {population: 12, generations: 10}\n"
    path = experiment(text)
    barrier = threading.Barrier(2)

    def begin(seed: int) -> None:
        barrier.wait(10)
        runs[seed] = launch("optimize", path, "--seed", seed, "--broker", broker.url, "--out", f"run-{seed}")

    runs: dict[int, Any] = {}
    threads = [threading.Thread(target=begin, args=(seed,)) for seed in (1, 2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(20)
    for seed, run in runs.items():
        assert run.wait() == 0, run.stderr
        local = launch("optimize", path, "--seed", seed, "--servers", "local", "--out", f"local-{seed}")
        assert local.wait() == 0
        assert record(path.parent / f"run-{seed}") == record(path.parent / f"local-{seed}")


@pytest.mark.journey
def test_states_of_servers(broker: BrokerProcess, serve: Serve, launch: Launch, connect: Any) -> None:
    """Ready, busy and lost beside each other, on the page and as JSON."""
    servers = serve(broker.url, "--no-restart", first=10, count=3)
    tool: PlainTool = connect(PlainTool, broker.url)
    tool.begin(11, "a" * 64)
    servers.until_event("busy", server=11)
    servers.signal_server(12, signal.SIGKILL)
    servers.until_event("ended", server=12)
    states = listed(launch, broker.url)
    assert {number: state["state"] for number, state in states.items()} == {
        10: "ready",
        11: "busy",
        12: "lost",
    }
    assert states[12]["pid"] == servers.pids[12]
    page = launch("servers", "--broker", broker.url)
    assert page.wait() == 0
    rows = {line.split()[0]: line for line in page.lines}
    for number, word in ((10, "ready"), (11, "busy"), (12, "lost")):
        assert word in rows[str(number)]
        assert "minisim" in rows[str(number)]
