"""Limits of brokers: what is announced is kept, what is not is learnt, and results stay the same."""

import json
import re
from contextlib import ExitStack
from pathlib import Path

import pytest

from tests.conftest import free_port
from tests.system.brokers import BrokerProcess
from tests.system.conftest import Experiment, Launch, Serve
from tests.system.runs import record

WIDE = """\
simulation: minisim
mode: {mode}
controller: {{kind: layered, hidden: [{hidden}]}}
method: {{kind: random_search, population: 40, generations: 2}}
seed: 3
"""
LARGEST = 20_000


@pytest.fixture
def narrow(tmp_path: Path, cleanup: ExitStack) -> BrokerProcess:
    """A Mosquitto that takes small packets only, and says so."""
    process = BrokerProcess("mosquitto", tmp_path / "narrow")
    with (tmp_path / "narrow" / "mosquitto.conf").open("a") as file:
        file.write(f"max_packet_size {LARGEST}\n")
    cleanup.callback(process.stop)
    return process.start()


@pytest.mark.parametrize("mode", ["offloaded", "batched"])
def test_requests_are_kept_below_what_the_broker_announces(
    narrow: BrokerProcess, serve: Serve, launch: Launch, experiment: Experiment, tmp_path: Path, mode: str
) -> None:
    """A candidate has 4.8 kB: all of a generation would be ten times too much."""
    serve(narrow.url, count=2)
    path = experiment(WIDE.format(mode=mode, hidden=200))
    tool = launch("optimize", path, "--broker", narrow.url, "--out", "narrow-run")
    assert tool.wait() == 0, tool.stderr
    assert launch("optimize", path, "--servers", "local", "--out", "local").wait() == 0
    assert record(tmp_path / "narrow-run") == record(tmp_path / "local")


def test_a_candidate_that_is_larger_than_the_broker_takes_fails_with_the_reason(
    narrow: BrokerProcess, serve: Serve, launch: Launch, experiment: Experiment
) -> None:
    serve(narrow.url)
    path = experiment(WIDE.format(mode="offloaded", hidden=2000))
    tool = launch("optimize", path, "--broker", narrow.url, "--out", "run")
    assert tool.wait() == 1
    assert f"is larger than the {LARGEST} that the broker accepts" in tool.stderr


SILENT = """\
simulation: minisim
parameters: {{numAgents: {agents}}}
mode: {mode}
controller: {{kind: layered, hidden: {hidden}}}
method: {{kind: nnga, population: 200, generations: 2}}
seed: 3
"""


@pytest.mark.parametrize(
    ("mode", "agents", "hidden", "told"),
    [
        ("offloaded", 1, [64, 64], "this tool's connection on a packet of"),
        ("batched", 120, [8], "servers' connections on a step of"),
    ],
)
def test_a_limit_that_the_broker_does_not_announce_is_learnt(
    narrow: BrokerProcess,
    serve: Serve,
    launch: Launch,
    experiment: Experiment,
    tmp_path: Path,
    mode: str,
    agents: int,
    hidden: list[int],
    told: str,
) -> None:
    """MQTT 3.1.1 cannot announce it: Mosquitto breaks the connection, of the tool or of a server."""
    url = f"{narrow.url}?mqtt=3"
    serve(url, count=2)
    path = experiment(SILENT.format(mode=mode, agents=agents, hidden=hidden))
    tool = launch("optimize", path, "--broker", url, "--out", "silent")
    assert tool.wait(50) == 0, tool.stderr
    assert tool.stderr.count("repeatedly ended") == 1, tool.stderr
    assert told in tool.stderr
    assert launch("optimize", path, "--servers", "local", "--out", "local").wait() == 0
    assert record(tmp_path / "silent") == record(tmp_path / "local")
    shown = launch("runs", "show", "silent", "--json")
    assert shown.wait() == 0
    told_of = [one["text"] for one in json.loads(shown.lines[0])["warnings"] if one["kind"] == "incidents"]
    losses = re.findall(r"(?:broker losses|server failures): (\d+)", " ".join(told_of))
    assert 2 <= sum(map(int, losses)) <= 12, told_of


def test_a_candidate_that_is_larger_than_a_limit_that_is_not_announced_ends_the_run(
    narrow: BrokerProcess, serve: Serve, launch: Launch, experiment: Experiment
) -> None:
    """It does not try again for ever; the run can be resumed."""
    url = f"{narrow.url}?mqtt=3"
    serve(url)
    path = experiment(WIDE.format(mode="offloaded", hidden=2000))
    tool = launch("optimize", path, "--broker", url, "--out", "run")
    assert tool.wait(50) == 1
    assert "max_packet_size" in tool.stderr
    assert "an evaluation needs that much" in tool.stderr
    assert "Traceback" not in tool.stderr
    assert launch("resume", "run", "--servers", "local").wait(50) == 0


def test_a_broker_that_slows_its_clients_down_changes_no_result(
    launch: Launch, serve: Serve, experiment: Experiment, tmp_path: Path
) -> None:
    port = free_port()
    broker = launch("broker", "--port", port, "--rate", 500, "--json")
    broker.until_event("listening")
    url = f"mqtt://127.0.0.1:{port}"
    serve(url)
    path = experiment(WIDE.format(mode="stepwise", hidden=4))
    tool = launch("optimize", path, "--broker", url, "--out", "slow")
    assert tool.wait(50) == 0, tool.stderr
    assert launch("optimize", path, "--servers", "local", "--out", "local").wait() == 0
    assert record(tmp_path / "slow") == record(tmp_path / "local")
