"""Tools and servers that start before their broker: they wait for it, where they are told to."""

import time
from contextlib import ExitStack
from pathlib import Path

import pytest

from tests.system.brokers import BrokerProcess, Kind
from tests.system.conftest import Experiment, Launch
from tests.system.runs import generations, record


@pytest.fixture
def later(kind: Kind, tmp_path: Path, cleanup: ExitStack) -> BrokerProcess:
    """A broker of each kind that is not started yet."""
    process = BrokerProcess(kind, tmp_path / "broker")
    cleanup.callback(process.stop)
    return process


def test_everybody_waits_for_the_broker(later: BrokerProcess, launch: Launch, experiment: Experiment) -> None:
    """Server and tool are there first; killed in the middle, the run is resumed before the broker is back."""
    path = experiment(
        "simulation: minisim\nmethod: {kind: nnga, population: 12, generations: 2000}\nseed: 3\n"
    )
    server = launch("serve", "minisim", "--broker", later.url, "--id", 5, "--wait", 60, "--json")
    waiting = server.until_event("waiting")
    assert waiting["message"].startswith(f"no broker answers at {later.url} (Connection refused")
    assert waiting["message"].endswith(", for at most 60 s")
    tool = launch("optimize", path, "--broker", later.url, "--out", "result", "--wait", 60)
    line = tool.until_error("waiting since ")
    assert line.startswith(f"swarmwright: no broker answers at {later.url} (Connection refused"), line
    later.start()
    server.until_event("ready")
    tool.until_error("the broker answers after ")
    tool.until(lambda _: generations(path.parent / "result") >= 3, "three generations")
    tool.process.kill()
    tool.process.wait(10)
    later.kill()
    again = launch("resume", "result", "--broker", later.url, "--wait", 60)
    again.until_error("waiting since ")
    later.start()
    assert again.wait(60) == 0, again.stderr
    local = launch("optimize", path, "--servers", "local", "--out", "local")
    assert local.wait(60) == 0, local.stderr
    assert record(path.parent / "result") == record(path.parent / "local")


def test_the_experiment_can_say_how_long(launch: Launch, experiment: Experiment, tmp_path: Path) -> None:
    """And when the time is over, it is said for how long; the option goes before the key."""
    broker = BrokerProcess("embedded", tmp_path / "never")
    path = experiment(f"simulation: minisim\nbroker: {broker.url}\ntimeouts: {{connect: 0.5}}\n")
    tool = launch("optimize", path)
    assert tool.wait() == 1
    assert "; waited since " in tool.stderr
    assert tool.stderr.endswith(", for 0.5 s")
    at_once = launch("optimize", path, "--wait", 0)
    assert at_once.wait() == 1
    assert "wait" not in at_once.stderr


@pytest.mark.parametrize("command", ["optimize", "serve"])
def test_wrong_credentials_are_nothing_to_wait_for(
    kind: Kind, tmp_path: Path, launch: Launch, experiment: Experiment, cleanup: ExitStack, command: str
) -> None:
    """Nobody changes them meanwhile."""
    broker = BrokerProcess(kind, tmp_path / "broker", {"lab": "right"})
    cleanup.callback(broker.stop)
    broker.start()
    what = [experiment()] if command == "optimize" else ["minisim"]
    wrong = {"SWARMWRIGHT_USERNAME": "lab", "SWARMWRIGHT_PASSWORD": "wrong"}
    began = time.monotonic()
    program = launch(command, *what, "--broker", broker.url, "--wait", 600, env=wrong)
    assert program.wait() == 1
    assert time.monotonic() - began < 20
    assert f"the broker at {broker.url} refuses" in program.stderr
    assert "waiting" not in program.stderr
