"""Brokers that hold small packets back until those before are acknowledged; servers that do so late."""

import sys
import threading
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest

from tests.system.brokers import BrokerProcess
from tests.system.conftest import Experiment, Launch
from tests.system.plain_server import PlainServer
from tests.system.runs import warnings

EXPERIMENT = """\
simulation: toy
requirements: {dimensions: 1}
parameters: {starts: [4.0, -2.5, 6.25], steps: 8}
sensors: 2
actuators: 1
controller: {kind: layered, hidden: []}
method: {kind: nnga, population: 6, generations: 2}
seed: 5
timeouts: {discovery: 4, step: 10}
"""

HOLDS_BACK = "holds small packets back"


class RealTime(PlainServer):
    """Each of its steps takes as long as a late acknowledgement."""

    def sense(self) -> None:
        threading.Event().wait(0.043)
        super().sense()


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux acknowledges late when asked to")
@pytest.mark.parametrize(
    ("collecting", "server", "told"),
    [(True, PlainServer, 1), (False, PlainServer, 0), (False, RealTime, 0)],
    ids=["as-it-comes", "nodelay", "real-time"],
)
def test_it_is_told_what_makes_steps_slow(
    collecting: bool,
    server: type[PlainServer],
    told: int,
    tmp_path: Path,
    cleanup: ExitStack,
    connect: Any,
    launch: Launch,
    experiment: Experiment,
) -> None:
    broker = BrokerProcess("mosquitto", tmp_path / "broker", collecting=collecting).start()
    cleanup.callback(broker.stop)
    connect(server, broker.url, 4711)
    path = experiment(EXPERIMENT)
    program = launch("optimize", path, "--broker", broker.url, "--out", "result")
    assert program.wait() == 0, program.stderr
    found = [text for text in warnings(path.parent / "result") if HOLDS_BACK in text]
    assert len(found) == program.stderr.count(HOLDS_BACK) == told, program.stderr
    for text in found:
        assert f"the broker at {broker.url}" in text
        assert "answers of server 4711 took 4" in text, text
        assert "`set_tcp_nodelay true`" in text
