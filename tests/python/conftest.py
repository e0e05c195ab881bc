"""What the library's tests share: a simulation server as somebody else would write it, with D6.1 alone."""

import json
import shutil
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Any

import paho.mqtt.client as mqtt
import pytest
from hypothesis import HealthCheck, settings
from paho.mqtt.enums import CallbackAPIVersion

from swarmwright import Run, optimize
from tests.python.records import EXPERIMENT

# Other work on the machine must not make an example look slow; every test has its time-out.
settings.register_profile("swarmwright", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("swarmwright")

Message = dict[str, Any]


class ForeignServer:
    """Offers `title`: 2 sensors, 1 actuator, an agent on a line that should stop at 1 after `steps` steps.

    It never heard of Swarmwright's extensions. `trouble` may change or withhold what it publishes; `noise` is
    published before every message, on the same topic. With `runs_itself` it asks nobody: the agent moves
    `speed` in each of `steps` steps, to the `turn`, all of them parameters. Of several agents, each pulls the
    other way than the one before.
    """

    def __init__(
        self,
        title: str,
        steps: int = 4,
        server: int = 77,
        trouble: Callable[[str, Message], Message | str | None] = lambda _, message: message,
        noise: Sequence[str] = (),
        runs_itself: bool = False,
        agents: int = 1,
    ) -> None:
        self.runs_itself = runs_itself
        self.agents = agents
        self.title, self.steps, self.server, self.trouble, self.noise = title, steps, server, trouble, noise
        self.parameters: list[Message] = []
        self.episodes = 0
        self._hash = ""
        self._position, self._left = 0.0, 0
        self._actions: dict[int, float] = {}
        self.client = mqtt.Client(CallbackAPIVersion.VERSION2)
        self.client.on_message = self._on_message

    def publish(self, topic: str, message: Message) -> None:
        for payload in self.noise:
            self.client.publish(topic, payload)
        changed = self.trouble(topic, message)
        if changed is not None:
            self.client.publish(topic, changed if isinstance(changed, str) else json.dumps(changed))

    def _on_message(self, client: mqtt.Client, userdata: Any, received: mqtt.MQTTMessage) -> None:  # noqa: ARG002
        message = json.loads(received.payload)
        if received.topic == "discovery":
            if message["simulation"] == self.title and message["requirements"]["dimensions"] == 1:
                answer = {
                    "server": self.server,
                    "simulation_hash": message["simulation_hash"],
                    "simulations": [self.title],
                    "capabilities": {"dimensions": 1},
                }
                self.publish("server", answer)
        elif received.topic == "parameters" and message["server"] == self.server:
            self.parameters.append(message)
        elif received.topic == "control" and message["server"] == self.server and message.get("run", True):
            self._hash, self._position, self._left = message["simulation_hash"], 0.0, self.steps
            self._actions = {}
            if self.runs_itself:
                self._run(self.parameters[-1])
            else:
                self._sense()
        elif received.topic == "actuator" and message["simulation_hash"] == self._hash and self._left:
            self._actions[message["agent"]] = message["actuator"][0]
            if len(self._actions) < self.agents:
                return
            self._position += sum(action * (-1) ** agent for agent, action in self._actions.items())
            self._actions = {}
            self._left -= 1
            if self._left:
                self._sense()
            else:
                self._end()

    def _run(self, parameters: Message) -> None:
        assert parameters["simulation_hash"] == self._hash
        way = 1 if parameters["turn"] == "right" else -1
        self._position = parameters["speed"] * parameters["steps"] * way
        self._left = 0
        self._end()

    def _end(self) -> None:
        self.episodes += 1
        self.publish("fitness", {"simulation_hash": self._hash, "fitness": -abs(self._position - 1)})

    def _sense(self) -> None:
        for agent in range(self.agents):
            self.publish(
                "sensor",
                {
                    "simulation_hash": self._hash,
                    "agent": agent,
                    "sensor": [1 - self._position, self._left / self.steps],
                },
            )


@contextmanager
def _serving(broker: str, title: str, **options: Any) -> Iterator[ForeignServer]:
    server = ForeignServer(title, **options)
    host, _, port = broker.removeprefix("mqtt://").rpartition(":")
    server.client.connect(host, int(port))
    for topic in ("discovery", "parameters", "control", "actuator"):
        server.client.subscribe(topic)
    server.client.loop_start()
    try:
        yield server
    finally:
        server.client.disconnect()
        server.client.loop_stop()


@pytest.fixture
def foreign() -> Callable[..., AbstractContextManager[ForeignServer]]:
    """Runs a `ForeignServer` for the time of a `with` block: `foreign(broker, title, **options)`."""
    return _serving


@pytest.fixture(scope="session")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """A run of `EXPERIMENT`, not to be changed."""
    return optimize(EXPERIMENT, out=tmp_path_factory.mktemp("runs") / "run")


@pytest.fixture
def copy(finished: Run, tmp_path: Path) -> Path:
    """A run folder to break."""
    shutil.copytree(finished.path, tmp_path / "copy")
    return tmp_path / "copy"
