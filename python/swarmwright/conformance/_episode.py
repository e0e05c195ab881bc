"""An episode that the kit plays with the server under test."""

from collections import deque
from collections.abc import Iterable
from contextlib import suppress
from typing import TYPE_CHECKING, Any

import msgpack
import numpy as np

from swarmwright.common.json_text import Json, is_number, new_hash
from swarmwright.conformance._trajectory import Numbers, Policy, Trajectory
from swarmwright.conformance.rules import WentOn
from swarmwright.servers.broker.client import Failure, Message, format_payload

if TYPE_CHECKING:
    from swarmwright.conformance._server_under_test import Server


class Episode:
    """An episode, step by step: pending agents and received messages."""

    def __init__(
        self, server: "Server", parameters: Json, *, hash_: str | None = None, tool: str | None = None
    ) -> None:
        self.server = server
        self.parameters = parameters
        self.hash = hash_ or new_hash()
        self.tool = tool
        self.trajectory = Trajectory()
        self.pending: list[tuple[int, int, Numbers]] = []
        self.repeated: list[Message] = []
        self.last_at = 0.0
        """Time of its last message (monotonic seconds)."""
        self.over = True
        self.reply: str | None = None
        """The reply topic in control, if any."""

    @property
    def _named(self) -> Json:
        return {"tool": self.tool} if self.tool else {}

    def configure(self, **changes: Any) -> str:  # noqa: ANN401 - JSON
        """Send the parameters; return the sent message."""
        self.over = False
        fields = {**self.parameters, "server": self.server.id, "simulation_hash": self.hash, **changes}
        return self.server.client.send("parameters", **fields)

    def start(self, topic: str = "control", **changes: Any) -> str:  # noqa: ANN401 - JSON
        """Send control on a topic; return the sent message."""
        self.over = False
        self.trajectory = Trajectory(sensors_only=self.server.sensors_only)
        self.pending, self.repeated = [], []
        fields: Json = {
            "server": self.server.id,
            "simulation_hash": self.hash,
            "simulation": self.server.settings.title,
            "run": True,
            "visual": False,
            **self._named,
            **changes,
        }
        self.reply = fields.get("reply")
        self.server.mark_printed()
        return self.server.client.send(topic, **fields)

    def stop(self, topic: str = "control") -> str:
        """End the episode with run: false; return the sent message."""
        self.over = True
        fields = {"server": self.server.id, "simulation_hash": self.hash, "run": False, **self._named}
        return self.server.client.send(topic, simulation=self.server.settings.title, **fields)

    def receive(self, sent: str = "") -> bool:
        """Receive the next sensor message or the fitness; return whether it was a sensor message.

        Raises Failure if no message or another message arrives. Its text has the reason that the server gives
        on the reply topic, or the output of its process since the episode began.
        """
        seconds = self.server.settings.timeout
        expected = "a sensor message, or the fitness, with the hash of the episode"
        message = self.server.client.next(
            lambda received: self.is_mine(received) or bool(self._reason(received)), seconds
        )
        if message is None:
            came = f"nothing arrived within {seconds:g} s"
            if self.trajectory.messages:
                came += f" after {self.trajectory.messages} sensor messages"
            raise Failure(came + self.server.printed, expected, sent)
        if reason := self._reason(message):
            self.over = True
            raise Failure(f"the message failed came, with the reason: {reason}", expected, sent)
        return self.take(message)

    def _reason(self, message: Message) -> str:
        """Return the reason of a failure message on the reply topic; empty for other messages."""
        # Scenes arrive there, too, and are not decoded here.
        if message.topic != self.reply or b"failed" not in message.payload:
            return ""
        with suppress(Exception):  # whatever the reader raises, it is not a failure message
            content = msgpack.unpackb(message.payload, strict_map_key=False)
            if content["kind"] == "failed" and content["simulation_hash"] == self.hash:
                return format_payload(str(content.get("reason") or "none was given"))
        return ""

    def is_mine(self, message: Message) -> bool:
        """Return whether a message belongs to this episode, or is unreadable."""
        return (
            message.topic in {"sensor", "fitness"}
            and message.maybe.get("simulation_hash", self.hash) == self.hash
        )

    def take(self, message: Message) -> bool:
        """Process a message of this episode; return whether it was a sensor message.

        Raises Failure if the message is invalid.
        """
        self.last_at = message.at
        if message.topic == "fitness":
            self._finish(message)
            return False
        self._take_sensors(message)
        return True

    def _take_sensors(self, message: Message) -> None:
        content = message.json
        named, sensors = content.get("agent"), content.get("sensor")
        if not is_number(named) or named != int(named):
            raise Failure(f"{message} arrived", '"agent" is an integer')
        agent = int(named)
        if not isinstance(sensors, list) or not sensors or not all(is_number(value) for value in sensors):
            raise Failure(f"{message} arrived", '"sensor" is a list of finite numbers, at least one')
        with np.errstate(over="ignore"):
            numbers = np.array(sensors, dtype=np.float32)
        turn = len(self.trajectory.readings[agent])
        self.trajectory.readings[agent].append(numbers)
        self.trajectory.messages += 1
        if any(pending_agent == agent for pending_agent, _, _ in self.pending):
            self.repeated.append(message)
            self.pending = [entry for entry in self.pending if entry[0] != agent]
        self.pending.append((agent, turn, numbers))

    def _finish(self, message: Message) -> None:
        self.over = True
        content = message.json
        fitness, metrics = content.get("fitness"), content.get("metrics")
        if not is_number(fitness):
            raise Failure(f"{message} arrived", '"fitness" is a finite number')
        self.trajectory.fitness = float(fitness)
        if isinstance(metrics, dict):
            values = {name: float(value) for name, value in metrics.items() if is_number(value)}
            self.trajectory.metrics = values
            self.server.seen_metrics |= values.keys()
            self.server.wrong_metrics |= {
                name: value for name, value in metrics.items() if name not in values
            }

    def answer(self, agent: int, actuators: Iterable[float], **changes: Any) -> str:  # noqa: ANN401 - JSON
        """Send an agent's actuators; return the sent message."""
        self.pending = [entry for entry in self.pending if entry[0] != agent]
        fields = {"simulation_hash": self.hash, "agent": agent, "actuator": list(actuators)}
        return self.server.client.send(
            "actuator", simulation=self.server.settings.title, **(fields | changes)
        )

    def gather(self) -> None:
        """Receive the sensor messages of a step until no more arrive."""
        if self.over or (not self.pending and not self.receive()):
            return
        for message in self.server.client.drain(self.server.quiet):
            if self.is_mine(message):
                self.take(message)

    def pass_over_late(self) -> None:
        """Discard late messages of agents that had not been asked before."""
        agents = {agent for agent, _, _ in self.pending}

        def is_late(message: Message) -> bool:
            return (
                message.topic == "sensor"
                and self.is_mine(message)
                and message.maybe.get("agent") not in agents
            )

        client = self.server.client
        client.waiting = deque(message for message in client.waiting if not is_late(message))

    def must_wait(self, agents: Iterable[int], why: str, sent: str) -> None:
        """Raise WentOn if the episode continues: a fitness arrives, or one of these agents is asked again.

        First messages of agents that had not been asked before are merely late.
        """
        expected_agents = {*agents, *(agent for agent, _, _ in self.pending)}
        for message in self.server.client.drain(self.server.quiet):
            if not self.is_mine(message):
                continue
            if message.topic == "fitness" or message.maybe.get("agent") in expected_agents:
                raise WentOn(f"{message} arrived", f"silence: {why}", sent)
            self.take(message)

    def play(self, policy: Policy | None = None) -> Trajectory:
        """Answer sensor messages until the fitness arrives; return the trajectory."""
        # A simulation that controls its agents itself needs no policy.
        chosen = policy
        sent = ""
        while not self.over:
            for agent, turn, sensors in list(self.pending):
                chosen = chosen or self.server.policy
                sent = self.answer(agent, chosen(agent, turn, sensors))
            self.receive(sent)
        return self.trajectory
