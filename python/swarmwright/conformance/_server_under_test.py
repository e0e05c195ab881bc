"""The simulation server under test: requests, answers, and episodes that the kit plays with it."""

import json
import secrets
import time
from collections import defaultdict, deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import msgpack
import numpy as np
from numpy.typing import NDArray

from swarmwright import _engine
from swarmwright.common.json_text import Json, is_number, new_hash
from swarmwright.conformance._peers import Door, Process
from swarmwright.conformance.rules import NotTried, Rule, Skip, WentOn
from swarmwright.servers.broker.client import (
    TO_SERVER,
    TO_TOOL,
    Client,
    Failure,
    Message,
    Overdue,
    format_payload,
)

if TYPE_CHECKING:
    pass

Numbers = NDArray[np.float32]


Policy = Callable[[int, int, Numbers], Sequence[float]]
"""Function of agent, number of its earlier messages in the episode, and sensors; returns actuators."""


@dataclass(frozen=True)
class Wander:
    """Actuators that vary only with agent and turn: multiples of 1/64 in -1..+1.

    seed: selects one of many sequences.
    """

    actuators: int
    seed: int = 0

    def __call__(self, agent: int, turn: int, _sensors: Numbers) -> list[float]:
        """Return the actuators of an agent."""
        rows = []
        for index in range(self.actuators):
            number = (self.seed * 40503 + agent * 69069 + turn * 30011 + index * 7919 + 12345) & 0xFFFFFFFF
            number = (number ^ (number >> 15)) * 0x2C1B3C6D & 0xFFFFFFFF
            number ^= number >> 12
            rows.append(((number % 129) - 64) / 64)
        return rows


@dataclass(frozen=True)
class Always:
    """Constant actuators."""

    values: tuple[float, ...]

    def __call__(self, _agent: int, _turn: int, _sensors: Numbers) -> Sequence[float]:
        """Return the actuators of an agent."""
        return self.values


class Steer:
    """A controller for each agent, computed with Swarmwright's arithmetic.

    specification: with weights, see protocol/schemas/controller.schema.json.
    """

    def __init__(self, specification: Mapping[str, Any]) -> None:
        self._text = json.dumps(specification)
        self._agents: dict[int, _engine.Controller] = {}

    def __call__(self, agent: int, turn: int, sensors: Numbers) -> Sequence[float]:
        """Return the actuators of an agent."""
        if turn == 0 or agent not in self._agents:
            self._agents[agent] = _engine.Controller(self._text)
        # Send the shortest decimals that read back as these numbers.
        return [float(str(value)) for value in self._agents[agent].step(sensors)]


@dataclass
class Trajectory:
    """The sensors of each agent in order, and the end of the episode.

    fitness: None if the episode was not played to its end. messages: sensor messages. seconds: from control
    to fitness. sensors_only: fitness and metrics are not compared with those of other trajectories.
    """

    readings: dict[int, list[Numbers]] = field(default_factory=lambda: defaultdict(list))
    fitness: float | None = None
    metrics: dict[str, float] = field(default_factory=dict)
    messages: int = 0
    seconds: float = 0.0
    sensors_only: bool = False

    def difference(self, other: "Trajectory") -> str:
        """Describe the first difference from another trajectory; empty if all bits are the same."""
        sensed = self.find_sensor_difference(other)
        if sensed or self.sensors_only or other.sensors_only:
            return sensed
        return self._result_difference(other)

    def find_sensor_difference(self, other: "Trajectory") -> str:
        """Describe the first difference in sensors; empty if all bits are the same."""
        for agent in sorted({*self.readings, *other.readings}):
            mine, theirs = self.readings.get(agent, []), other.readings.get(agent, [])
            for turn, (first, second) in enumerate(zip(mine, theirs, strict=False)):
                if first.tobytes() != second.tobytes():
                    values = f"{format_numbers(first)} and {format_numbers(second)}"
                    return f"agent {agent} senses {values} in its message {turn}"
            if len(mine) != len(theirs):
                return f"agent {agent} gets {len(mine)} and {len(theirs)} sensor messages"
        return ""

    def _result_difference(self, other: "Trajectory") -> str:
        if not is_same_fitness(self.fitness, other.fitness):
            return f"the fitness is {self.fitness!r} and {other.fitness!r}"
        for name in sorted({*self.metrics, *other.metrics}):
            if not is_same_fitness(self.metrics.get(name), other.metrics.get(name)):
                return f"metric {name} is {self.metrics.get(name)!r} and {other.metrics.get(name)!r}"
        return ""


def is_same_fitness(first: float | None, other: float | None) -> bool:
    """Return whether two values have the same bits, or both are None."""
    if first is None or other is None:
        return first is other
    return np.float64(first).tobytes() == np.float64(other).tobytes()


def format_numbers(numbers: Numbers) -> str:
    """Format numbers as text."""
    texts = [str(value) for value in numbers[:6]]
    return f"[{', '.join(texts)}{', ...' if len(numbers) > 6 else ''}]"


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


QUIET_S = 0.05
"""Seconds within which a fast server would send a message."""


@dataclass
class Settings:
    """Properties of the server that are known in advance.

    parameters: parameters of every episode. sensors, actuators: their numbers, if the server does not
    announce them. timeout: time limit of an answer in seconds. step_timeout: seconds after which the server
    aborts an episode; None if unknown. vary: parameters that change an episode, for simulations in which the
    seed changes nothing.
    """

    server: int
    title: str
    dimensions: float
    parameters: Json = field(default_factory=dict)
    sensors: int | None = None
    actuators: int | None = None
    timeout: float = 5.0
    step_timeout: float | None = None
    vary: Json = field(default_factory=dict)


class Server:
    """The server under test, for the rules."""

    def __init__(
        self,
        client: Client,
        settings: Settings,
        *,
        door: Door | None = None,
        process: Process | None = None,
        own_broker: str | None = None,
        prefix: str = "",
    ) -> None:
        self.client = client
        self.settings = settings
        self.door = door
        self.process = process
        self.own_broker = own_broker
        self.prefix = prefix
        self.left = False
        self.id = settings.server
        self.token = secrets.token_hex(8)
        self.capabilities: Json = {}
        self.trajectory: Trajectory | None = None
        self.quiet = QUIET_S
        self.deterministic: bool | None = None
        self.repeats: bool | None = None
        self.carries_over = False
        """Whether sensors depend on the previous episode."""
        self.sensors_only = False
        """Whether only sensors can be compared, because fitness or metrics depend on the previous episode."""
        self.seen_metrics: set[str] = set()
        self.wrong_metrics: Json = {}
        """Metrics that were not finite numbers, with their values."""
        self.episodes: list[Episode] = []
        self.question_hashes: set[str] = set()
        """Hashes of all discoveries, since answers to earlier ones may be late."""
        self.tools: set[str] = set()

    # What it announces.

    def note_capabilities(self, answer: Mapping[str, Any]) -> None:
        """Store the capabilities in an answer to a discovery, if they are an object."""
        capabilities = answer.get("capabilities")
        self.capabilities = capabilities if isinstance(capabilities, dict) else {}

    @property
    def announced(self) -> Json:
        """`capabilities.swarmwright`, empty if missing."""
        extension = self.capabilities.get("swarmwright")
        return extension if isinstance(extension, dict) else {}

    @property
    def instance(self) -> str:
        """The instance of the server; empty if not announced."""
        instance = self.announced.get("instance")
        return instance if isinstance(instance, str) else ""

    def announces(self, *, mode: str | None = None) -> None:
        """Skip the rule unless extensions, or this mode, are announced."""
        if not self.capabilities:
            raise NotTried("the server's announcement is unknown: rule S1.1 determines it")
        if "version" not in self.announced:
            raise Skip("not announced: no capabilities.swarmwright")
        if mode is not None and mode not in self.announced.get("modes", []):
            raise Skip(f"not announced: capabilities.swarmwright.modes lacks {mode!r}")

    @property
    def max_agents(self) -> float | None:
        """Largest number of agents; None if there is no limit."""
        limit = self.capabilities.get("max_agents", self.capabilities.get("max agents"))
        return limit if isinstance(limit, int | float) else None

    @property
    def sensors(self) -> int:
        """Numbers in a sensor message."""
        count = self.settings.sensors or self.announced.get("sensors")
        if isinstance(count, int):
            return count
        for readings in (self.trajectory or Trajectory()).readings.values():
            return len(readings[0])
        raise Skip("the simulation controls its agents itself and asks none")

    @property
    def actuators(self) -> int:
        """Numbers in an actuator message."""
        count = self.settings.actuators or self.announced.get("actuators")
        if isinstance(count, int):
            return count
        raise Skip(
            "the server does not announce how many actuators an agent has; give --actuators",
            "Many rules were skipped because the number of actuators is not known: give --actuators N.",
        )

    @property
    def undisturbed(self) -> Trajectory:
        """The trajectory of an undisturbed episode, whoever controls the agents."""
        if self.trajectory is None:
            # Without the number of actuators there is no such episode; otherwise S2.3 was excluded or failed.
            _ = self.actuators
            raise NotTried("there is no undisturbed episode to compare with: rule S2.3 plays it")
        return self.trajectory

    @property
    def steers_itself(self) -> bool:
        """Whether the simulation controls its agents itself, so that no agent is asked."""
        return not self.undisturbed.messages

    @property
    def reference(self) -> Trajectory:
        """The undisturbed trajectory of `self.policy`; skips the rule when no agent is asked."""
        if self.steers_itself:
            raise Skip("the simulation controls its agents itself, no agent is asked")
        return self.undisturbed

    @property
    def policy(self) -> Policy:
        """The policy for rules in which actuators do not matter."""
        return Wander(self.actuators)

    def listen_for(self, seconds: float) -> None:
        """Set the time to listen for an unexpected message.

        At most half of the time limit of an answer, and a quarter of the server's time-out of an episode.
        """
        most = min(self.settings.timeout / 2, (self.settings.step_timeout or 60.0) / 4)
        self.quiet = min(most, max(QUIET_S, seconds))

    @property
    def repeatable(self) -> bool:
        """Whether an episode can be compared with the reference.

        Plays an episode if that is unknown; the server must be free.
        """
        if self.deterministic is not None:
            return self.deterministic
        if self.repeats is None:
            self.repeats = not self.reference.difference(self.play())
        return self.repeats

    def comparable(self) -> None:
        """Skip the rule if trajectories cannot be compared."""
        if self.deterministic is False:
            raise Skip("episodes cannot be compared: the server declares that it is not deterministic")
        if self.carries_over:
            raise NotTried("needs S3.2: an episode depends on the one before it")

    # Discovery.

    def discovery(self, **changes: Any) -> Json:  # noqa: ANN401 - JSON
        """A discovery that the server should answer, with a new hash."""
        question = {
            "simulation": self.settings.title,
            "simulation_hash": new_hash(),
            "requirements": {"dimensions": self.settings.dimensions},
        } | changes
        if isinstance(question["simulation_hash"], str):
            self.question_hashes.add(question["simulation_hash"])
        return question

    def discover(self, *, within: float | None = None, **changes: Any) -> Json | None:  # noqa: ANN401 - JSON
        """Send a discovery; return the answer, or None after a time-out."""
        question = self.discovery(**changes)
        self.client.send("discovery", **question)
        answer = self.client.next(
            lambda message: self.is_answer(message, question["simulation_hash"]),
            self.settings.timeout if within is None else within,
        )
        return None if answer is None else answer.json

    def is_answer(self, message: Message, hash_: str | None = None) -> bool:
        """Return whether a message is this server's answer to a discovery (with this hash)."""
        content = message.maybe
        return (
            message.topic == "server"
            and content.get("server") == self.id
            and hash_ in {None, content.get("simulation_hash")}
        )

    def must_answer(self, expected: str, sent: str = "", **changes: Any) -> Json:  # noqa: ANN401 - JSON
        """Send a discovery and return the answer. Raises Failure if none arrives."""
        answer = self.discover(**changes)
        if answer is None:
            raise Failure(f"nothing arrived within {self.settings.timeout:g} s", expected, sent)
        return answer

    def must_come_free(self, expected: str, sent: str = "") -> None:
        """Repeat the discovery until the server answers. Raises Failure after the time-out."""
        limit = time.monotonic() + self.settings.timeout
        while not self.is_free(within=min(0.25, self.settings.timeout)):
            if time.monotonic() > limit:
                raise Failure(f"it answered no discovery within {self.settings.timeout:g} s", expected, sent)

    def is_free(self, *, within: float) -> bool:
        """Send a discovery; return whether it answers in time. Late answers to earlier ones are ignored."""
        free = self.discover(within=within) is not None
        if free:
            others = [message for message in self.client.waiting if not self.is_answer(message)]
            self.client.waiting = deque(others)
        return free

    def must_not_answer(self, questions: Iterable[Json], why: str) -> None:
        """Send discoveries that it must not answer, then one that it must. Raises Failure for wrong answers.

        The server must be free.
        """
        discoveries = list(questions)
        for question in discoveries:
            self.client.send("discovery", **question)
        last = self.discovery()
        self.client.send("discovery", **last)
        wrong: list[Message] = []
        hashes = [question["simulation_hash"] for question in discoveries]

        def is_answer(message: Message) -> bool:
            if any(self.is_answer(message, hash_) for hash_ in hashes):
                wrong.append(message)
            return self.is_answer(message, last["simulation_hash"])

        answer = self.client.next(is_answer, self.settings.timeout)
        if wrong:
            index = hashes.index(wrong[0].json["simulation_hash"])
            raise Failure(
                f"it answered: {wrong[0]}",
                f"silence: {why}",
                f"discovery {format_payload(json.dumps(discoveries[index]))}",
            )
        if answer is None:
            raise Failure(
                f"nothing arrived within {self.settings.timeout:g} s",
                "silence at first, then an answer to a discovery that fits",
                f"discovery {format_payload(json.dumps(discoveries[-1]))}",
            )

    def must_be_silent(
        self, why: str, sent: str = "", *, but: Episode | None = None, seconds: float | None = None
    ) -> None:
        """Raise Failure if the server publishes on the seven topics with a hash of the kit, or its ID.

        but: an episode in progress, whose messages are kept. seconds: how long to listen.
        """
        hashes = {episode.hash for episode in self.episodes if episode is not but}
        for message in self.client.drain(self.quiet if seconds is None else seconds):
            if but is not None and but.is_mine(message):
                but.take(message)
                continue
            content = message.maybe
            if message.topic in {"sensor", "fitness"} and (
                content.get("simulation_hash") in hashes or not content
            ):
                raise Failure(f"{message} arrived", f"silence: {why}", sent)
            if self.is_answer(message):
                raise Failure(f"{message} arrived", f"silence: {why}", sent)

    # Episodes.

    def episode(self, parameters: Mapping[str, Any] | None = None, **options: Any) -> Episode:  # noqa: ANN401
        """Create an episode, by default with the parameters of the settings; nothing is sent yet."""
        episode = Episode(
            self, self.settings.parameters if parameters is None else dict(parameters), **options
        )
        self.episodes.append(episode)
        if episode.tool:
            self.tools.add(episode.tool)
        return episode

    def play(self, policy: Policy | None = None, parameters: Mapping[str, Any] | None = None) -> Trajectory:
        """Play a whole episode and wait until the server is free again."""
        episode = self.episode(parameters)
        episode.configure()
        episode.start()
        return episode.play(policy)

    # Requests.

    def mark_printed(self) -> None:
        """Make `printed` start at the present end of the output."""
        if self.process is not None:
            self.process.mark()

    @property
    def printed(self) -> str:
        """The end of the output since the start of the last episode or request, to append to a sentence."""
        return "" if self.process is None else self.process.new_words

    @property
    def own_topic(self) -> str:
        """The topic of requests to this server."""
        return f"{TO_SERVER}{self.id}"

    def request(self, message: Json) -> str:
        """Publish a MessagePack request with MQTT 5 properties; return its description."""
        payload: bytes = msgpack.packb(message)
        number = message.get("request")
        correlation = number.to_bytes(8, "big") if isinstance(number, int) else b""
        reply = message.get("reply")
        self.mark_printed()
        self.client.publish(
            self.own_topic,
            payload,
            correlation=correlation,
            response=reply if isinstance(reply, str) else TO_TOOL + self.token,
        )
        if isinstance(message.get("tool"), str):
            self.tools.add(message["tool"])
        brief = {
            key: f"<{len(value)} bytes>" if isinstance(value, bytes) else value
            for key, value in message.items()
        }
        return f"{self.own_topic} {format_payload(json.dumps(brief, default=str))}"


MOST_EPISODES = 40
"""Largest number of episodes in a rule; their duration extends its deadline."""
FREE_AFTER_S = 8.0
"""Seconds after which a reserved server becomes free on its own, with a margin."""


WATCH_S = 2.0
"""Seconds within which a server that does not wait for actuators asks agents again."""


class ServerPeer(Server):
    """The server under test as a `Peer`."""

    _waits: bool | None = None

    def ready(self, rule: Rule) -> None:
        """Discard earlier messages; set the deadline of the rule."""
        self.client.deadline = float("inf")
        self.client.drain()
        self.episodes, self.tools = [], set()
        self._allow(rule.seconds + self.settings.timeout)

    def _allow(self, seconds: float) -> None:
        """Set the deadline, with extra time for episodes."""
        episode = self.trajectory.seconds if self.trajectory else self.settings.timeout
        self.client.deadline = time.monotonic() + seconds + MOST_EPISODES * episode

    def recover(self) -> str:
        """Make the server free; return why it does not answer discovery, empty if it does."""
        if self.left:
            return ""
        self.client.deadline = time.monotonic() + FREE_AFTER_S + 4 * self.settings.timeout
        try:
            return self._free_server()
        except Overdue:
            return "it no longer answered discoveries"

    def _free_server(self) -> str:
        if self.door is not None:
            self.door.open()
        for episode in self.episodes:
            episode.stop()
        for tool in self.tools:
            self._end_episode(tool)
        limit = time.monotonic() + FREE_AFTER_S
        while not self.describe_exit():
            if self._is_free(min(1.0, self.settings.timeout)):
                return ""
            if time.monotonic() > limit:
                return f"it answered no discovery for {FREE_AFTER_S:g} s"
            for episode in self.episodes:
                self._play_out(episode)
            for tool in self.tools:
                self._end_episode(tool)
        return self.describe_exit()

    def _is_free(self, seconds: float) -> bool:
        """Return whether the server answers with its ID; another rule checks the hash."""

        def is_answer(message: Message) -> bool:
            for episode in self.episodes:
                if message.topic == "sensor" and message.maybe.get("simulation_hash") == episode.hash:
                    with suppress(Failure):
                        episode.take(message)
            return self.is_answer(message)

        self.client.send("discovery", **self.discovery())
        free = self.client.next(is_answer, seconds) is not None
        self.client.waiting.clear()
        return free

    def _end_episode(self, tool: str) -> None:
        fields = {"server": self.id, "simulation_hash": tool, "run": False, "tool": tool}
        self.client.send("control", simulation=self.settings.title, **fields)

    def _play_out(self, episode: Episode) -> None:
        """Play an episode that could not be aborted to its end."""
        episode.over = not episode.pending
        with suppress(Failure):
            episode.play()
        episode.over = True

    def revive(self) -> bool:
        """Restart its process if the kit started it; return whether it answers."""
        if self.process is None:
            return False
        self.process.start()
        answer = await_answer(self, 30.0)
        if answer is None:
            return False
        # A restarted server has another instance.
        self.note_capabilities(answer)
        return True

    def prepare_retry(self) -> bool:
        """Prepare for another try within a rule; return whether that was possible."""
        if self.recover() and not self.revive():
            return False
        self.client.drain()
        self._allow(10 + 4 * self.settings.timeout)
        return True

    def waits(self) -> bool:
        """Return whether the server sends nothing until agents are answered; tested once."""
        if self._waits is None:
            self.client.deadline = time.monotonic() + WATCH_S + 2 * self.settings.timeout
            episode = self.episode()
            episode.configure()
            episode.start()
            with suppress(Failure, Overdue):
                episode.gather()
                limit = time.monotonic() + WATCH_S
                while time.monotonic() < limit and not (episode.repeated or episode.over):
                    for message in self.client.drain(0.1):
                        if episode.is_mine(message):
                            episode.take(message)
            self._waits = not (episode.repeated or episode.over)
        return self._waits

    def describe_exit(self) -> str:
        """Describe how the process ended; empty while it runs, or if the kit did not start it."""
        return "" if self.process is None else self.process.ended


def await_answer(server: Server, seconds: float) -> Json | None:
    """Repeat the discovery until the server answers; return the answer, None after a time-out."""
    client: Client = server.client
    client.deadline = float("inf")
    limit = time.monotonic() + seconds
    while time.monotonic() < limit:
        client.send("discovery", **server.discovery())
        answer = client.next(server.is_answer, 0.2)
        if answer is not None:
            return dict(answer.maybe)
        if server.process is not None and server.process.ended:
            return None
    return None
