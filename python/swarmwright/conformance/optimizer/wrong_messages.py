"""O4: invalid messages of servers, one at a time, and messages of other parties on the same topics."""

import json
import time
from collections import defaultdict, deque

from swarmwright.conformance.optimizer._stage import Actor, Json, make_sensors
from swarmwright.conformance.optimizer._tool import Tool, must_go_on, rule
from swarmwright.servers.broker.client import Failure, format_payload

PAUSE_S = 0.03
"""Seconds between two wrong messages."""
Tried = defaultdict[str, int]
"""Number of wrong messages sent on each topic, by all servers of a scene."""


class WrongFirst(Actor):
    """Sends some wrong messages before each right one, until each kind has been sent once.

    tried: shared by the servers of a scene.
    """

    at_once = 3
    """Largest number of wrong messages before a right one."""

    def __init__(self, server: int, tried: Tried) -> None:
        super().__init__(server)
        self.tried = tried
        self.waits: deque[tuple[str, Json]] = deque()
        self.left = 0
        self.until = 0.0
        self.wrong = ""

    def kinds(self, topic: str, right: Json) -> list[str | bytes]:
        """Return wrong payloads to send in place of a right message."""
        raise NotImplementedError

    def says(self, topic: str, **fields: object) -> None:
        """Queue a message, to be sent after wrong ones."""
        if not self.waits:
            self.left = self.at_once
        self.waits.append((topic, fields))
        self.tick()

    def tick(self) -> None:
        """Send the next wrong message, or the right one, when it is due."""
        while self.waits and time.monotonic() >= self.until:
            topic, right = self.waits[0]
            kinds = self.kinds(topic, right)
            if self.left and self.tried[topic] < len(kinds):
                payload = kinds[self.tried[topic]]
                self.tried[topic] += 1
                self.left -= 1
                self.wrong = f"{topic} {format_payload(payload) or '(nothing)'}"
                self.stage.record.notes["last wrong"] = self.wrong
                self.stage.record.sent.append((topic, payload))
                self.stage.client.publish(topic, payload)
                self.until = time.monotonic() + PAUSE_S
                return
            self.waits.popleft()
            self.wrong, self.left = "", self.at_once
            super().says(topic, **right)

    def waits_with(self, topic: str) -> list[Json]:
        """Return the right messages on a topic that are yet to be sent."""
        return [right for name, right in self.waits if name == topic]

    def answers(self, content: Json) -> bool:
        """Return whether to answer a discovery: not before the fitness is sent."""
        return not self.waits_with("fitness") and super().answers(content)

    def actuator(self, content: Json) -> None:
        """Record an answer to a sensor message that has not been sent, since it answers a wrong message."""
        agent = content.get("agent")
        agents = [right["agent"] for right in self.waits_with("sensor")]
        if self.wrong and (agent in agents or agent not in self.waiting):
            self.note_reaction(f"actuator {json.dumps(content)}")
        else:
            super().actuator(content)

    def control(self, content: Json) -> None:
        """Record control before the right fitness is sent, since it reacts to a wrong one."""
        if self.wrong and self.waits_with("fitness"):
            self.note_reaction(f"control {json.dumps(content)}")
        else:
            super().control(content)

    def note_reaction(self, reaction: str) -> None:
        """Record the first reaction to a wrong message."""
        notes = self.stage.record.notes
        if "reaction" not in notes:
            notes |= {"reaction": reaction, "reaction to": self.wrong}


def make_actors(kind: type[WrongFirst]) -> list[Actor]:
    """Create two servers that share the wrong messages."""
    tried: Tried = defaultdict(int)
    return [kind(1, tried), kind(2, tried)]


READING = "protocol.md, Reading"


class Junk(WrongFirst):
    """Sends payloads that are not JSON objects."""

    at_once = 6

    def kinds(self, topic: str, right: Json) -> list[str | bytes]:  # noqa: ARG002
        """Return nothing, a word, a list, a number, half an object, and bytes that are not UTF-8."""
        return ["", "hello", "[]", "7", '{"simulation_hash":', b"\xff\xfe{}"]


@rule(
    "O4.1",
    "Payloads other than a JSON object in UTF-8 are refused, and the run continues.",
    where=READING,
    fix="catch errors of your JSON reader; in paho an exception in a callback ends the loop",
    d61="6.1",
    needs=["O3.1"],
    seconds=600,
)
def no_json(tool: Tool) -> None:
    """Send junk before messages on server, sensor and fitness."""
    must_go_on(tool, "junk", make_actors(Junk), "junk on server, sensor and fitness")


def _drop_key(right: Json, key: str) -> Json:
    return {name: value for name, value in right.items() if name != key}


class WrongSensors(WrongFirst):
    """Sends sensor messages that violate the schema and have other sensor values."""

    def kinds(self, topic: str, right: Json) -> list[str | bytes]:
        """Return messages with missing keys and wrong types."""
        if topic != "sensor":
            return []
        values, agent = make_sensors(7, self.stage.sensors), right["agent"]
        other = {**right, "sensor": values}
        messages: list[Json] = [
            {**other, "agent": None},
            {**other, "agent": str(agent)},
            {**other, "agent": agent + 0.5},
            {**other, "sensor": []},
            {**other, "sensor": "0.5"},
            {**other, "sensor": [None] * len(values)},
            {**other, "sensor": [str(value) for value in values]},
            *(_drop_key(other, key) for key in ("agent", "sensor", "simulation_hash")),
            {**other, "simulation_hash": 7},
        ]
        return [json.dumps(fields) for fields in messages]


@rule(
    "O4.2",
    "Sensor messages with missing keys or values of the wrong type are not answered.",
    where=READING,
    fix="check agent and sensor first; the right message is still to come",
    d61="6.2 Sensor message, Schema 5",
    needs=["O3.1"],
    seconds=600,
)
def wrong_sensors(tool: Tool) -> None:
    """Send eleven wrong messages with other sensor values, one at a time before right ones."""
    sent = "sensor messages with a wrong agent or wrong numbers before right ones"
    must_go_on(tool, "wrong sensors", make_actors(WrongSensors), sent)


class Foreign(WrongFirst):
    """Sends messages of other parties: sensors, fitness and offers with unknown hashes."""

    def kinds(self, topic: str, right: Json) -> list[str | bytes]:
        """Return the right message with two other hashes, or offers of servers that do not exist."""
        hash_ = str(right["simulation_hash"])
        changes: Json = {"server": self.server + 10} if topic == "server" else {}
        others = (hash_[::-1] + "0", hash_[:-1])
        return [json.dumps({**right, "simulation_hash": other, **changes}) for other in others]


@rule(
    "O4.3",
    "Messages with other hashes are ignored.",
    where="protocol.md, Hash",
    fix="look up the hash among your discoveries and current episodes",
    d61="6.2 Discovery message",
    needs=["O3.1"],
    seconds=600,
)
def foreign(tool: Tool) -> None:
    """Send offers, sensors and fitness with other hashes, one at a time before right ones."""
    record = must_go_on(tool, "foreign", make_actors(Foreign), "messages with other hashes")
    hashes = {episode.hash for episode in record.episodes}

    def find_sent(topic: str, key: str, value: object) -> str:
        texts = (text for name, text in record.sent if name == topic and json.loads(text)[key] == value)
        return f"{topic} {format_payload(next(texts, 'messages with other hashes'))}"

    for content in record.on("actuator"):
        hash_ = content.get("simulation_hash")
        if hash_ not in hashes:
            came = f"actuator {json.dumps(content)}"
            raise Failure(
                came, "no answer to sensors of other episodes", find_sent("sensor", "simulation_hash", hash_)
            )
    for topic in ("parameters", "control"):
        for content in record.on(topic):
            server = content.get("server")
            if server not in {1, 2}:
                raise Failure(
                    f"{topic} {json.dumps(content)}",
                    "nothing for a server whose answer has another hash",
                    find_sent("server", "server", server),
                )


class WrongFitness(WrongFirst):
    """Sends fitness messages that violate the schema."""

    at_once = 5

    def kinds(self, topic: str, right: Json) -> list[str | bytes]:
        """Return a fitness of text, null, a list, true, and a message without one."""
        if topic != "fitness":
            return []
        messages = [{**right, "fitness": value} for value in ("7", None, [1], True)]
        return [json.dumps(fields) for fields in (*messages, _drop_key(right, "fitness"))]


@rule(
    "O4.4",
    "A fitness that is not a number is refused; the right one counts.",
    where=READING,
    fix="check that fitness is a number before you end the episode",
    d61="6.2 Fitness message, Schema 7",
    needs=["O3.1"],
    seconds=600,
)
def wrong_fitness(tool: Tool) -> None:
    """Send five wrong messages, each with a pause, and then the fitness."""
    must_go_on(
        tool, "wrong fitness", make_actors(WrongFitness), "fitness as text, null, a list, true, and missing"
    )


NOTE = {"deep": [1, {"run": None}]}


class Chatty(Actor):
    """Adds an unknown key to each message."""

    def says(self, topic: str, **fields: object) -> None:
        """Publish a message with one more key."""
        super().says(topic, **fields, note=NOTE)


@rule(
    "O4.5",
    "Unknown keys are ignored.",
    where=READING,
    fix="read the keys that you know, ignore the others",
    d61="6.2, Schemas 2, 5 and 7",
    needs=["O3.1"],
    seconds=600,
)
def unknown_keys(tool: Tool) -> None:
    """Play servers that add a key to every message."""
    sent = f'server, sensor and fitness messages with "note": {json.dumps(NOTE)}'
    must_go_on(tool, "chatty", [Chatty(1), Chatty(2)], sent)


class BeyondNumbers(WrongFirst):
    """Sends numbers beyond JSON or binary numbers, invalid agents, and deep nesting."""

    at_once = 4

    def kinds(self, topic: str, right: Json) -> list[str | bytes]:
        """Return messages with NaN, infinities, an agent below 0, and 10,000 levels of nesting."""
        words = ("NaN", "Infinity", "1e999")
        if topic == "fitness":
            head = json.dumps(_drop_key(right, "fitness"))[:-1]
            return [f'{head}, "fitness": {word}}}' for word in words]
        if topic != "sensor":
            return []
        values = make_sensors(7, self.stage.sensors)
        head, rest = json.dumps(_drop_key(right, "sensor"))[:-1], ", 0.5" * (len(values) - 1)
        return [
            json.dumps({**right, "agent": -1, "sensor": values}),
            *(f'{head}, "sensor": [{word}{rest}]}}' for word in words),
            "[" * 10_000,
        ]


@rule(
    "O4.6",
    "Numbers that are not finite, agents below 0 and more than 127 levels of nesting are refused.",
    where=READING,
    fix="check numbers after reading; limit the depth in your JSON reader",
    needs=["O4.2", "O4.4"],
    seconds=600,
)
def beyond_numbers(tool: Tool) -> None:
    """Send eight wrong messages, one at a time before right ones."""
    must_go_on(tool, "beyond numbers", make_actors(BeyondNumbers), "NaN, infinities, agent -1, 10,000 levels")


class Untitled(Actor):
    """Omits simulation from messages."""

    def says(self, topic: str, **fields: object) -> None:
        """Publish a message without simulation."""
        fields.pop("simulation", None)
        super().says(topic, **fields)


@rule(
    "O4.7",
    "Sensor and fitness messages may omit simulation.",
    where=READING,
    fix="distinguish episodes by hash alone: D6.1's schemas have simulation, its examples do not",
    needs=["O3.1"],
    seconds=600,
)
def accepts_untitled(tool: Tool) -> None:
    """Play two servers that omit simulation."""
    sent = 'sensor and fitness messages without "simulation"'
    must_go_on(tool, "untitled", [Untitled(1), Untitled(2)], sent)


class AnotherTitle(WrongFirst):
    """Sends messages with its hash for another simulation, with other sensors and an early end."""

    def kinds(self, topic: str, right: Json) -> list[str | bytes]:
        """Return the message with another title."""
        if topic == "server":
            return []
        wrong = {**right, "simulation": "another simulation"}
        if topic == "sensor":
            wrong["sensor"] = make_sensors(7, self.stage.sensors)
        return [json.dumps(wrong)]


@rule(
    "O4.8",
    "Sensor and fitness messages that name another simulation are refused; the right ones count.",
    where=READING,
    fix="compare simulation, if present, with yours: another server may have the same ID",
    needs=["O4.7"],
    seconds=600,
)
def another_title(tool: Tool) -> None:
    """Send a sensor message and a fitness with another title before right ones."""
    sent = 'sensor and fitness messages with "simulation": "another simulation" before right ones'
    must_go_on(tool, "another title", make_actors(AnotherTitle), sent)
