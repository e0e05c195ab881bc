"""A plain script plays the optimization tool against our server: the contract's conversations."""

import json
import math
import time
from typing import Any

import pytest

from tests.system.brokers import BrokerProcess
from tests.system.conftest import Experiment, Launch, Serve
from tests.system.peer import Peer
from tests.system.plain_tool import VECTORS, PlainTool

CONVERSATIONS = {
    path.stem: json.loads(path.read_text(encoding="utf-8"))
    for path in sorted((VECTORS / "conversations").glob("*.json"))
}


@pytest.mark.parametrize("version", [3, 5], ids=["mqtt3", "mqtt5"])
def test_conversations(broker: BrokerProcess, serve: Serve, version: int) -> None:
    """Every conversation with a server of its own: one may leave the server reserved."""
    assert len(CONVERSATIONS) >= 8
    servers = serve(broker.url)
    for name, conversation in CONVERSATIONS.items():
        with PlainTool(broker.url, version) as tool:
            heard = tool.replay(conversation)
            said = [entry for entry in conversation["messages"] if entry.get("from") == "server"]
            assert heard == len(said), name
            if name == "reserved":  # the named tool says good-bye; else nobody gets an answer for 5 s
                bye = {"server": 1, "simulation_hash": "d" * 64, "run": False, "tool": "ada@lab-3/4711"}
                tool.send("control", **bye)
    assert servers.process.poll() is None


@pytest.mark.journey
def test_a_plain_tool_steers_agents_to_the_goal(broker: BrokerProcess, serve: Serve, connect: Any) -> None:
    """A controller written by hand: head for the goal. Two agents, no hash but a word, no `simulation`."""
    serve(broker.url, first=7)
    tool: PlainTool = connect(PlainTool, broker.url)
    answer = tool.discover("any text", dimensions=2, max_agents=2)
    assert answer is not None
    assert answer["server"] == 7
    parameters = {
        "mapWidth": 10,
        "mapHeight": 8,
        "agents": [[1, 1], [2, 7]],
        "numDefenders": 0,
        "maxSteps": 30,
    }
    message: dict[str, Any] = tool.begin(7, "any text", **parameters)
    topic = "sensor"
    while topic == "sensor":
        dx, dy = message["sensor"][0] * 10, message["sensor"][1] * 8
        heading = math.atan2(dy, dx) / math.pi
        tool.send("actuator", simulation_hash="any text", agent=message["agent"], actuator=[heading])
        topic, message = tool.hear()
    assert topic == "fitness"
    assert message["fitness"] == 0
    assert message["simulation_hash"] == "any text"


LONG = """\
simulation: minisim
controller: {kind: layered, hidden: [8]}
method: {kind: nnga, population: 200, generations: 1000000}
ranking: {episodes: 100}
"""


class Deaf(PlainTool):
    """Knows nothing of extensions, and passes over what is said to others."""

    def __init__(self, url: str) -> None:
        Peer.__init__(self, url, "server", "sensor", "fitness")

    def hear_of(self, word: str, seconds: float = 10) -> tuple[str, dict[str, Any]]:
        """Topic and content of the next message with a hash."""
        end = time.monotonic() + seconds
        while True:
            topic, content = self.hear(end - time.monotonic())
            if content["simulation_hash"] == word:
                return topic, content


def test_a_plain_tool_that_asks_once_has_its_turn_beside_a_run(
    broker: BrokerProcess, serve: Serve, launch: Launch, experiment: Experiment, connect: Any
) -> None:
    """The run evaluates block after block on the only server, and goes on after the plain tool's turn."""
    serve(broker.url)
    run = launch("optimize", experiment(LONG), "--broker", broker.url, "--out", "long", "--json")
    run.until(lambda one: len(one.lines) > 0, "first generation")
    tool: Deaf = connect(Deaf, broker.url)
    for word in ("first", "second"):
        tool.ask(word)
        topic, message = tool.hear_of(word, 15)
        assert topic == "server"
        tool.send("parameters", server=1, simulation_hash=word, maxSteps=3)
        tool.send("control", server=1, simulation_hash=word, run=True)
        topic, message = tool.hear_of(word)
        while topic == "sensor":
            tool.send("actuator", simulation_hash=word, agent=message["agent"], actuator=[0.0])
            topic, message = tool.hear_of(word)
        assert topic == "fitness"
    before = len(run.lines)
    run.until(lambda one: len(one.lines) > before + 1, "further generations")
    assert "failed" not in run.stderr
