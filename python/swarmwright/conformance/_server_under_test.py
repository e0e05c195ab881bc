"""The simulation server under test: requests and answers."""

import json
import secrets
import time
from collections import deque
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import msgpack

from swarmwright.common.json_text import Json, new_hash
from swarmwright.conformance._broker import Door
from swarmwright.conformance._episode import Episode
from swarmwright.conformance._process import Process
from swarmwright.conformance._trajectory import Policy, Trajectory, Wander
from swarmwright.conformance.rules import NotTried, Skip
from swarmwright.servers.broker.client import TO_SERVER, TO_TOOL, Client, Failure, Message, format_payload

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
