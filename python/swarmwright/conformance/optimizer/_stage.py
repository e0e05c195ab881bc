"""Simulated simulation servers, for an optimization tool under test."""

import json
import re
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import msgpack
import numpy as np

from swarmwright import _engine
from swarmwright.conformance._controller_kinds import KINDS
from swarmwright.conformance._extensions import decode_message
from swarmwright.servers.broker.client import TO_SERVER, TO_TOOL, Client, Failure, Message

Json = dict[str, Any]
AGENTS, STEPS = 2, 3
TOOL_TOPICS = ("discovery", "parameters", "control", "actuator")


def make_sensors(turn: int, count: int) -> list[float]:
    """Return an agent's sensors in a turn, equal in all episodes, so that leftover state is noticed."""
    return [((turn * 37 + index * 61 + 17) % 129 - 64) / 64 for index in range(count)]


@dataclass
class Played:
    """An episode of a simulated server.

    questions: (agent, turn) in order. answers: received messages by agent and turn. ended: `fitness` or
    `stopped`; empty while the episode lasts.
    """

    server: int
    hash: str
    questions: list[tuple[int, int]] = field(default_factory=list)
    answers: dict[tuple[int, int], list[Any]] = field(default_factory=dict)
    ended: str = ""

    def trajectory(self) -> str:
        """Return all answers in order, as text for comparison."""
        return json.dumps([self.answers.get(key) for key in sorted(self.questions)])


@dataclass
class Record:
    """Everything that a tool sent: messages with their topics, invalid and unexpected messages.

    requests: requests of extensions. sent: topics and payloads of the kit's wrong messages. evaluated: number
    of episodes evaluated by requests. together: largest number of simultaneous episodes.
    """

    messages: list[tuple[str, Json]] = field(default_factory=list)
    wrong: list[Failure] = field(default_factory=list)
    """Invalid messages, as failures of the rules that they violate."""
    unasked: list[str] = field(default_factory=list)
    """Unsolicited actuators and other messages, as text."""
    episodes: list[Played] = field(default_factory=list)
    """Episodes that the tool started."""
    notes: dict[str, str] = field(default_factory=dict)
    """Notes that scenes leave for rules, by name."""
    requests: list[Json] = field(default_factory=list)
    sent: list[tuple[str, str | bytes]] = field(default_factory=list)
    evaluated: int = 0
    together: int = 0
    seconds: float = 0.0
    """Duration of the scene."""
    ended: str = ""
    """Description of the end of the tool's process; empty while it runs, or if the kit did not start it."""
    status: int | None = None
    """Exit status of that process, negative for a signal; None while it runs."""

    def on(self, topic: str) -> list[Json]:
        """Return the contents of the messages on a topic."""
        return [content for name, content in self.messages if name == topic]

    @property
    def finished(self) -> list[Played]:
        """Episodes that ended with their fitness."""
        return [episode for episode in self.episodes if episode.ended == "fitness"]


class Actor:
    """A simulation server that follows all rules; the base class of faulty ones.

    in_turn: asks one agent after the other. drops: each agent drops out a step earlier than the one before.
    """

    def __init__(self, server: int, *, in_turn: bool = False, drops: bool = False) -> None:
        self.server = server
        self.in_turn = in_turn
        self.drops = drops
        self.parameters: dict[str, Json] = {}
        self.episode: Played | None = None
        self.waiting: list[int] = []
        self.turns = [0] * AGENTS
        self.answered: set[str] = set()
        self.title: object = None
        self.stage: Stage

    def says(self, topic: str, **fields: Any) -> None:  # noqa: ANN401 - JSON
        """Publish a message."""
        self.stage.client.send(topic, **fields)

    def answers(self, content: Json) -> bool:
        """Return whether to answer a discovery."""
        return self.episode is None and content.get("simulation") == self.stage.title_for(content)

    def discovery(self, content: Json) -> None:
        """Handle a discovery."""
        if self.answers(content):
            self.offer(content)

    def offer(self, content: Json) -> None:
        """Answer a discovery."""
        self.answered.add(str(content.get("simulation_hash")))
        self.title = content.get("simulation")
        needs = content.get("requirements")
        dimensions = needs.get("dimensions", 2) if isinstance(needs, dict) else 2
        extension = {"version": 1, "sensors": self.stage.sensors, "actuators": self.stage.actuators}
        extension |= self.describe_capabilities()
        self.says(
            "server",
            server=self.server,
            simulation_hash=content.get("simulation_hash"),
            simulations=[content.get("simulation")],
            capabilities={"dimensions": dimensions, "swarmwright": extension},
        )

    def describe_capabilities(self) -> Json:
        """Return announced capabilities beyond those of D6.1."""
        return {"modes": ["stepwise"]}

    def control(self, content: Json) -> None:
        """Handle a control message for this server."""
        hash_ = str(content.get("simulation_hash"))
        if content.get("run", True) is False:
            if self.episode is not None and self.episode.hash == hash_:
                self.episode.ended = "stopped"
                self.episode = None
        elif self.episode is None and hash_ in self.parameters:
            self.begin(hash_)

    def begin(self, hash_: str) -> None:
        """Start an episode."""
        self.episode = Played(self.server, hash_)
        self.stage.record.episodes.append(self.episode)
        self.turns = [0] * AGENTS
        self.ask()

    def next(self) -> list[int]:
        """Return the next agents: all, or the first of those with the fewest turns."""
        acting = [agent for agent in range(AGENTS) if self.turns[agent] < STEPS - agent * self.drops]
        if not self.in_turn:
            return acting
        return sorted(acting, key=lambda agent: (self.turns[agent], agent))[:1]

    def ask(self) -> None:
        """Begin a step, or end the episode."""
        assert self.episode is not None
        self.waiting = self.next()
        if not self.waiting:
            self.finish()
            return
        for agent in self.waiting:
            self.episode.questions.append((agent, self.turns[agent]))
            self.sense(agent)

    def sense(self, agent: int) -> None:
        """Publish a sensor message."""
        assert self.episode is not None
        values = make_sensors(self.turns[agent], self.stage.sensors)
        about = {"simulation": self.title, "simulation_hash": self.episode.hash}
        self.says("sensor", **about, agent=agent, sensor=values)

    def actuator(self, content: Json) -> None:
        """Handle an actuator message of the current episode."""
        assert self.episode is not None
        agent, values = content.get("agent"), content.get("actuator")
        if agent not in self.waiting or not isinstance(agent, int):
            self.stage.record.unasked.append(f"actuator {json.dumps(content)}")
            return
        self.waiting.remove(agent)
        self.episode.answers[agent, self.turns[agent]] = values if isinstance(values, list) else [values]
        self.turns[agent] += 1
        if not self.waiting:
            self.ask()

    def finish(self) -> None:
        """Publish the fitness."""
        assert self.episode is not None
        episode, self.episode = self.episode, None
        episode.ended = "fitness"
        about = {"simulation": self.title, "simulation_hash": episode.hash}
        self.says("fitness", **about, fitness=fitness_of(episode))

    def on_request(self, message: Message) -> None:
        """Record a request of an extension that is not announced."""
        self.stage.record.unasked.append(str(message))

    def tick(self) -> None:
        """Handle the passing of time."""


def fitness_of(episode: Played) -> float:
    """Return the fitness to optimize: the mean of all actuators."""
    values = [
        value for answer in episode.answers.values() for value in answer if isinstance(value, int | float)
    ]
    return sum(values) / max(1, len(values))


class Stage:
    """Simulated servers on a broker, and the record of a tool's messages."""

    def __init__(
        self, client: Client, actors: Sequence[Actor], *, title: str | None, sensors: int, actuators: int
    ) -> None:
        self.client = client
        self.actors = list(actors)
        self.title = title
        self.sensors = sensors
        self.actuators = actuators
        self.record = Record()
        for actor in self.actors:
            actor.stage = self

    def title_for(self, content: Json) -> object:
        """Return the offered title: the configured one, or the requested one."""
        return content.get("simulation") if self.title is None else self.title

    def play(self, over: Callable[[], bool], seconds: float) -> Record:
        """Simulate the servers until `over`, for at most this many seconds."""
        start = time.monotonic()
        while not over() and time.monotonic() < start + seconds:
            message = self.client.next(lambda _: True, 0.02)
            if message is not None:
                self.receive(message)
            for actor in self.actors:
                actor.tick()
        for message in self.client.drain(0.05):
            self.receive(message)
        self.record.seconds = time.monotonic() - start
        return self.record

    def receive(self, message: Message) -> None:
        """Record a message and pass it to the simulated servers."""
        if message.topic.startswith(TO_SERVER):
            for actor in self.actors:
                if message.topic == f"{TO_SERVER}{actor.server}":
                    actor.on_request(message)
            return
        if message.topic not in TOOL_TOPICS or message.retained:
            return
        try:
            content = message.json
        except Failure as failure:
            self.record.wrong.append(failure)
            return
        self.record.messages.append((message.topic, content))
        hash_, server = content.get("simulation_hash"), content.get("server")
        for actor in self.actors:
            if message.topic == "discovery":
                actor.discovery(content)
            elif message.topic == "parameters" and server == actor.server:
                actor.parameters[str(hash_)] = content
            elif message.topic == "control" and server == actor.server:
                actor.control(content)
            elif message.topic == "actuator" and actor.episode is not None and actor.episode.hash == hash_:
                actor.actuator(content)
        running = [actor.episode.hash for actor in self.actors if actor.episode is not None]
        self.record.together = max(self.record.together, len(running))
        if len(set(running)) < len(running):
            self.record.notes["same hash"] = f"{running[0]} at {len(running)} servers at once"


REPLY = re.compile(f"{re.escape(TO_TOOL)}[A-Za-z0-9_-]{{1,200}}")


class Offloading(Actor):
    """Evaluates controllers; the fitness of each is the mean of its weights."""

    modes = ("stepwise", "offloaded")

    def describe_capabilities(self) -> Json:
        """Announce offloaded evaluation and batches of four."""
        return {"modes": list(self.modes), "controllers": list(KINDS), "batch": 4}

    def on_request(self, message: Message) -> None:
        """Check a request and answer it."""
        try:
            request = decode_message(message)
            self.stage.record.requests.append(request)
            self.serve(request)
        except Failure as failure:
            self.stage.record.wrong.append(failure)

    def serve(self, request: Json) -> None:
        """Evaluate the request's controllers."""
        if request.get("kind") == "evaluate":
            weights, seeds = check_request(request, self.stage.title_for(request))
            self.stage.record.evaluated += len(weights) * len(seeds)
            fitness = np.repeat(weights.astype(np.float64).mean(axis=1), len(seeds))
            self.reply(request, fitness=fitness.tobytes(), seconds=0.0)

    def reply(self, request: Json, **fields: Any) -> None:  # noqa: ANN401 - MessagePack
        """Publish the answer to a request."""
        kind = "evaluated" if request["kind"] == "evaluate" else "sensors"
        message = {"kind": kind, "version": 1, "request": request["request"], "server": self.server, **fields}
        payload = msgpack.packb(message)
        correlation = request["request"].to_bytes(8, "big")
        self.stage.client.publish(request["reply"], payload, correlation=correlation)


def check_request(request: Json, title: object) -> tuple[np.ndarray, np.ndarray]:
    """Return the weights (candidates, weights) and seeds of a request. Raises Failure if it is invalid."""
    envelope(request, title)
    brief = str({key: value for key, value in request.items() if not isinstance(value, bytes)})
    controller = request.get("controller")
    if not isinstance(controller, dict) or "weights" in controller:
        raise Failure(brief, '"controller" is a specification without weights')
    try:
        size = _engine.genome_size(controller)
    except _engine.InputError as error:
        raise Failure(f"controller {controller}: {error}", "a specification of protocol/schemas") from None
    numbers = array(request, "genomes", "<f4")
    if len(numbers) % size or not len(numbers) or not np.isfinite(numbers).all():
        came = f"{len(numbers)} numbers in genomes, finite or not, for a controller of {size} weights"
        raise Failure(came, f"finite numbers, a multiple of {size}")
    for key, least in (("attempt", 0), ("lease", 0)):
        if not isinstance(request.get(key), int | float) or request[key] < least:
            raise Failure(brief, f'"{key}" is a number from {least}')
    return numbers.reshape(-1, size), array(request, "seeds", "<u8")


def envelope(request: Json, title: object) -> None:
    """Check the fields that all requests share. Raises Failure if one is wrong."""
    brief = str({key: value for key, value in request.items() if not isinstance(value, bytes)})
    if request.get("version") != 1 or not isinstance(request.get("request"), int):
        raise Failure(brief, '"version" is 1, "request" a number')
    if not isinstance(request.get("tool"), str) or not REPLY.fullmatch(str(request.get("reply"))):
        raise Failure(brief, f'"tool" is text, "reply" {TO_TOOL} and letters, digits, - or _')
    if request.get("simulation") != title or not isinstance(request.get("parameters"), dict):
        raise Failure(brief, f'"simulation" is {title!r}, "parameters" an object')
    if not len(array(request, "seeds", "<u8")):
        raise Failure(brief, "one seed at least")


def array(request: Json, key: str, kind: str) -> np.ndarray:
    """Return a binary array of a request. Raises Failure if it is invalid."""
    value = request.get(key)
    if not isinstance(value, bytes) or len(value) % np.dtype(kind).itemsize:
        raise Failure(f'"{key}" is {value!r}', f"MessagePack binary of {np.dtype(kind).name}")
    return np.frombuffer(value, dtype=kind)


class Batching(Offloading):
    """Steps batches of up to four episodes."""

    modes = ("stepwise", "batched")

    def __init__(self, server: int) -> None:
        super().__init__(server)
        self.batch: Json | None = None
        self.step = 0

    def serve(self, request: Json) -> None:
        """Start a batch, or advance it by a step."""
        if request.get("kind") == "start":
            envelope(request, self.stage.title_for(request))
            if len(array(request, "seeds", "<u8")) > 4:
                raise Failure(f"{len(request['seeds']) // 8} episodes", "4 at most, as announced")
            self.batch, self.step = request, 0
            self.tell()
        elif request.get("kind") == "actuators" and self.batch is not None:
            self.take(request, self.batch)

    def take(self, request: Json, batch: Json) -> None:
        """Check actuators and continue the batch."""
        values = array(request, "actuators", "<f4")
        if not len(values):
            self.batch = None
            return
        rows = len(batch["seeds"]) // 8 * AGENTS
        if request.get("request") != batch["request"] or request.get("step") != self.step:
            raise Failure(
                f"request {request.get('request')}, step {request.get('step')}",
                f"{batch['request']}, {self.step}",
            )
        if len(values) != rows * self.stage.actuators or not (np.abs(values) <= 1).all():
            came = f"{len(values)} actuators up to {np.abs(values).max()}"
            raise Failure(came, f"{rows} rows of {self.stage.actuators}, from -1 to +1")
        self.step += 1
        self.tell()

    def tell(self) -> None:
        """Send the sensors of the step, or the fitness of all episodes."""
        assert self.batch is not None
        episodes = np.arange(len(self.batch["seeds"]) // 8, dtype="<u4")
        over = self.step == STEPS
        rows = np.empty(0, dtype="<u4") if over else np.repeat(episodes, AGENTS)
        values = np.array(make_sensors(self.step, self.stage.sensors), dtype="<f4")
        self.reply(
            self.batch,
            step=self.step,
            episodes=rows.tobytes(),
            agents=np.tile(np.arange(AGENTS, dtype="<u4"), len(rows) // AGENTS).tobytes(),
            sensors=np.tile(values, len(rows)).astype("<f4").tobytes(),
            ended=episodes.tobytes() if over else b"",
            fitness=np.zeros(len(episodes)).tobytes() if over else b"",
        )
        if over:
            self.stage.record.evaluated += len(episodes)
            self.batch = None


OTHER_MODES: dict[str, type[Offloading]] = {"offloaded": Offloading, "batched": Batching}
"""The simulated server that offers each mode; the mode is also the scene's name."""
