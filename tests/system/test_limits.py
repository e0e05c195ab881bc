"""Limits of brokers: what they announce is kept, who is too fast waits, and results stay the same."""

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
    assert f"is larger than the {LARGEST} that the broker takes" in tool.stderr


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
