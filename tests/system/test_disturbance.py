"""Several tools and foreign traffic on one broker: nobody is disturbed, and each complaint is made once."""

from typing import Any

from tests.system.brokers import BrokerProcess
from tests.system.conftest import Experiment, Launch, Serve
from tests.system.noise import Noise, leave_retained
from tests.system.peer import Peer
from tests.system.plain_tool import PlainTool
from tests.system.runs import attempts, record, warnings

LONG = """\
simulation: minisim
mode: stepwise
parameters: {maxSteps: 300, speedAgents: 0.02, numDefenders: 1, speedDefenders: 0.01}
method: {kind: nnga, population: 10, generations: 10}
"""


def test_two_runs_amid_foreign_traffic(
    broker: BrokerProcess, serve: Serve, launch: Launch, connect: Any, experiment: Experiment
) -> None:
    path = experiment(LONG)
    seeds = (11, 12)
    for seed in seeds:
        assert (
            launch("optimize", path, "--seed", seed, "--servers", "local", "--out", f"quiet-{seed}").wait()
            == 0
        )
    with Peer(broker.url) as peer:
        leave_retained(peer)
    servers = serve(broker.url, count=2)
    noise: Noise = connect(Noise, broker.url)
    runs = [
        launch("optimize", path, "--seed", seed, "--broker", broker.url, "--out", f"noisy-{seed}")
        for seed in seeds
    ]
    for run in runs:
        assert run.wait(40) == 0, run.stderr
    assert noise.rounds >= 2, "a megabyte of junk went out on several topics"
    used = set()
    for seed in seeds:
        assert record(path.parent / f"noisy-{seed}") == record(path.parent / f"quiet-{seed}")
        entries = attempts(path.parent / f"noisy-{seed}")
        used |= {entry["server"] for entry in entries}
        told = warnings(path.parent / f"noisy-{seed}")
        assert len(told) == len(set(told))
        for topic in ("server", "sensor", "fitness"):
            assert any("retained" in warning and topic in warning for warning in told)
            assert any("refusing" in warning and topic in warning for warning in told)
        assert all(len(warning) < 600 for warning in told)
    assert used == {1, 2}
    for server in (1, 2):
        complaints = servers.warnings(server)
        assert len(complaints) == len(set(complaints)), "each complaint is made once"
        for topic in ("discovery", "parameters", "control", "actuator"):
            assert any("retained" in warning and topic in warning for warning in complaints), complaints
            assert any("refusing" in warning and topic in warning for warning in complaints), complaints
        assert all(len(warning) < 600 for warning in complaints)
    assert not servers.events("ended")


def test_a_server_goes_on_after_all_junk_at_rest(broker: BrokerProcess, serve: Serve, connect: Any) -> None:
    """The same junk to a server that nobody uses: it is free afterwards, and the process the same."""
    servers = serve(broker.url)
    noise: Noise = connect(Noise, broker.url)
    servers.until(lambda _: noise.rounds >= 2, "two rounds of junk", 15)
    noise.close()
    tool: PlainTool = connect(PlainTool, broker.url)
    answer = tool.discover("a" * 64)
    assert answer is not None
    assert answer["server"] == 1
    assert servers.events("ended") == servers.events("busy") == []
