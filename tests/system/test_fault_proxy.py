"""Everybody's connection is cut, delayed and doubled all the time: the record is as if nothing had been."""

from collections import Counter
from contextlib import ExitStack

import pytest

from swarmwright import Run
from tests.system.brokers import BrokerProcess
from tests.system.conftest import Experiment, Launch
from tests.system.fault_proxy import FaultProxy
from tests.system.runs import record, warnings

EXPERIMENT = """\
simulation: minisim
parameters: {{maxSteps: {steps}, speedAgents: 0.001, numDefenders: 2, speedDefenders: 0}}
method: {{kind: nnga, population: 8, generations: {generations}}}
ranking: {{episodes: 2}}
seed: 9
timeouts: {{discovery: 20, step: 3}}
faults: {{attempts: 20, quarantine: 20}}
"""
"""Agents do not get far, so that no episode ends early."""
SERVERS = (1, 2, 3)


@pytest.mark.parametrize(
    ("mode", "steps", "generations"), [("stepwise", 60, 5), ("batched", 120, 3), ("offloaded", 20_000, 30)]
)
def test_through_bad_networks(
    broker: BrokerProcess,
    launch: Launch,
    experiment: Experiment,
    cleanup: ExitStack,
    mode: str,
    steps: int,
    generations: int,
) -> None:
    path = experiment(EXPERIMENT.format(steps=steps, generations=generations))
    local = launch("optimize", path, "--servers", "local", "--out", "local")
    assert local.wait(30) == 0, local.stderr

    proxies = [cleanup.enter_context(FaultProxy(broker.port, seed)) for seed in (0, *SERVERS)]
    for server, proxy in zip(SERVERS, proxies[1:], strict=True):
        arguments = ["serve", "minisim", "--broker", proxy.url, "--id", server, "--count", 1]
        launch(*arguments, "--step-timeout", "3", "--wait", "30")
    path.write_text(f"{path.read_text()}mode: {mode}\n")
    run = launch("optimize", path, "--broker", proxies[0].url, "--out", "result", "--wait", "30")
    assert run.wait(50) == 0, run.stderr

    faults = sum((proxy.faults for proxy in proxies), Counter[str]())
    assert record(path.parent / "result") == record(path.parent / "local"), faults
    assert all(faults[kind] for kind in ("cut", "delayed", "doubled")), faults
    folder = path.parent / "result"
    told = sum("lost the broker" in text for text in warnings(folder))
    counts = [event.text for event in Run.open(folder).events() if event.kind == "incidents"]
    assert f"broker losses: {told}" in counts[-1] if told else counts, (told, counts, faults)
