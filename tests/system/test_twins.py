"""A server that was away comes back to an id that another one has: the record is an undisturbed run's."""

import json
import signal
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from swarmwright import InputError
from tests.java import JavaServer
from tests.system.brokers import BrokerProcess
from tests.system.conftest import Experiment, Launch, Serve
from tests.system.fault_proxy import FaultProxy
from tests.system.peer import PRESENCE, Peer
from tests.system.processes import Program, Servers
from tests.system.runs import attempts, record

LONG = """\
simulation: minisim
mode: {mode}
parameters: {{maxSteps: 300, speedAgents: 0.02, numDefenders: 1, speedDefenders: 0.01}}
method: {{kind: nnga, population: 10, generations: {generations}}}
"""


@pytest.fixture
def way(broker: BrokerProcess) -> Iterator[FaultProxy]:
    """To the broker, for the one that is to be cut off."""
    with FaultProxy(broker.port, 1, delayed=0, doubled=0, lifetime=1e9) as proxy:
        yield proxy


def until_further(run: Program, count: int) -> None:
    """Wait until a run has so many more generations."""

    def generations() -> int:
        return sum("best_so_far" in event for event in run.events())

    before = generations()
    run.until(lambda _: generations() >= before + count, "next generation", 60)


def until_used(run: Program, folder: Path, server: int) -> None:
    """Wait until a server has evaluated something for a run; on a busy machine another may do so at first."""

    def is_used(_: Program) -> bool:
        with suppress(InputError):  # nothing is written before the first second is over
            return any(one["server"] == server and one["error"] is None for one in attempts(folder))
        return False

    run.until(is_used, f"an evaluation by server {server}")


@pytest.mark.timeout(180)
@pytest.mark.parametrize("mode", ["stepwise", "batched"])
@pytest.mark.parametrize("title", ["minisim", "emergency_exit"])
def test_a_server_that_slept_finds_its_id_in_use(
    broker: BrokerProcess,
    way: FaultProxy,
    serve: Serve,
    launch: Launch,
    experiment: Experiment,
    mode: str,
    title: str,
) -> None:
    path = experiment(LONG.format(mode=mode, generations=80 if mode == "stepwise" else 400))
    assert launch("optimize", path, "--servers", "local", "--out", "quiet").wait(120) == 0
    sleeper = Servers(way.url, cwd=path.parent)
    serve(broker.url, first=2)
    heir = None
    try:
        run = launch("optimize", path, "--broker", broker.url, "--out", "noisy", "--json")
        until_used(run, path.parent / "noisy", 1)
        sleeper.signal_server(1, signal.SIGSTOP)
        way.cut()
        # Until the broker has said the last will.
        time.sleep(0.3)
        heir = launch("serve", title, "--broker", broker.url, "--id", 1, "--json")
        heir.until_event("ready")
        until_further(run, 2)
        sleeper.signal_server(1, signal.SIGCONT)
        assert sleeper.wait(60) == 1, "the one that was away leaves, and is not started again"
        assert "another server has the id 1 too" in sleeper.stderr
        assert run.wait(120) == 0, run.stderr
        assert heir.process.poll() is None
        assert heir.events("ended") == []
    finally:
        sleeper.stop()
    assert record(path.parent / "noisy") == record(path.parent / "quiet")
    used = [entry for entry in attempts(path.parent / "noisy") if entry["error"] is None]
    assert {entry["server"] for entry in used} == {1, 2}


@pytest.mark.timeout(180)
def test_a_java_server_that_slept_leaves(
    embedded: BrokerProcess, launch: Launch, serve: Serve, experiment: Experiment
) -> None:
    """The same, once: its machine's decisions are tested beside it."""
    path = experiment(LONG.format(mode="stepwise", generations=60))
    assert launch("optimize", path, "--servers", "local", "--out", "quiet").wait(120) == 0
    with FaultProxy(embedded.port, 1, delayed=0, doubled=0, lifetime=1e9) as way:
        sleeper = JavaServer(way.url, cwd=path.parent)
        try:
            serve(embedded.url, first=2)
            run = launch("optimize", path, "--broker", embedded.url, "--out", "noisy", "--json")
            until_further(run, 1)
            sleeper.signal(signal.SIGSTOP)
            way.cut()
            time.sleep(0.3)
            heir = serve(embedded.url)
            sleeper.signal(signal.SIGCONT)
            assert sleeper.wait(60) == 1
            assert "another server has the id 1 too" in sleeper.stderr
            assert run.wait(120) == 0, run.stderr
            assert heir.events("ended") == []
        finally:
            sleeper.stop()
    assert record(path.parent / "noisy") == record(path.parent / "quiet")


@pytest.mark.parametrize("language", ["rust", "java"])
def test_a_server_does_not_leave_for_one_that_only_the_broker_remembers(
    embedded: BrokerProcess, tmp_path: Path, language: str
) -> None:
    """As after a restart of a broker that stores what is retained now and then."""
    ghost = {
        "version": 1,
        "server": 1,
        "state": "ready",
        "simulations": ["minisim"],
        "since": "2026-01-01T00:00:00Z",
        "capabilities": {
            "dimensions": 2,
            "swarmwright": {"version": 1, "host": "far", "pid": 3, "instance": "!"},
        },
    }
    topic = f"{PRESENCE}1"
    with (
        FaultProxy(embedded.port, 1, delayed=0, doubled=0, lifetime=1e9) as way,
        Peer(embedded.url, topic) as peer,
    ):
        server = (Servers if language == "rust" else JavaServer)(way.url, cwd=tmp_path)
        try:
            own = until_state(peer, "ready")["capabilities"]
            if isinstance(server, Servers):
                server.signal_server(1, signal.SIGSTOP)
            else:
                server.signal(signal.SIGSTOP)
            way.cut()
            until_state(peer, "lost")
            peer.publish(topic, json.dumps(ghost), retain=True, qos=1)
            assert until_state(peer, "ready")["capabilities"] != own
            if isinstance(server, Servers):
                server.signal_server(1, signal.SIGCONT)
            else:
                server.signal(signal.SIGCONT)
            assert until_state(peer, "ready")["capabilities"] == own
            assert server.process.poll() is None
        finally:
            server.stop()


def until_state(peer: Peer, state: str) -> dict[str, Any]:
    """Wait for presence in this state."""
    while True:
        said = peer.inbox.get(timeout=30).json
        if said["state"] == state:
            return said
