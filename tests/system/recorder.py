"""Everything that crosses a broker, and whether it keeps to the protocol."""

import functools
import json
import re
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

from jsonschema import Draft202012Validator

from tests.system.peer import PRESENCE, STATUS, TO_SERVER, TOPICS, Peer, Received

SCHEMAS = Path(__file__).parents[2] / "protocol" / "schemas"
HASH = re.compile(r"[0-9a-f]{64}")

Json = dict[str, Any]


@functools.cache
def validator(name: str) -> Draft202012Validator:
    """The validator of a schema: `sensor`, `published/sensor`, `presence`, ..."""
    schema = json.loads((SCHEMAS / f"{name}.schema.json").read_text(encoding="utf-8"))
    return Draft202012Validator(schema)


class Recorder(Peer):
    """Subscribed to everything; `messages` are in the order in which the broker passed them on."""

    def __init__(self, url: str, *filters: str, **how: Any) -> None:
        self.messages: list[Received] = []
        super().__init__(url, *(filters or ("#",)), **how)

    def received(self, message: Received) -> None:
        if message.topic.startswith(TO_SERVER) and message.payload.startswith(b"{"):
            message = replace(message, topic="control")  # heard by one server alone
        self.messages.append(message)

    def on(self, topic: str) -> list[Json]:
        """Contents of the messages on a topic."""
        return [message.json for message in list(self.messages) if message.topic == topic]

    def settle(self, quiet: float = 0.3, seconds: float = 10) -> None:
        """Wait until nothing new comes."""
        deadline = time.monotonic() + seconds
        count = -1
        while count != len(self.messages):
            assert time.monotonic() < deadline, "messages do not end"
            count = len(self.messages)
            time.sleep(quiet)


def check_shapes(messages: list[Received]) -> None:
    """Only the topics of the protocol; all fits the schemas, printed and mended; nothing is retained."""
    for message in messages:
        if message.topic.startswith(PRESENCE):
            if message.payload:
                validator("presence").validate(message.json)
            continue
        if message.topic.startswith(STATUS):
            if message.payload:
                validator("status").validate(message.json)
            continue
        assert message.topic in TOPICS, message
        assert not message.retained, message
        validator(message.topic).validate(message.json)
        validator(f"published/{message.topic}").validate(message.json)


class Referee:
    """Follows the conversations that the recorder heard and objects to what the protocol forbids."""

    def __init__(self) -> None:
        self.asked: set[str] = set()
        self.offered: set[int] = set()
        self.configured: dict[str, int] = {}
        self.running: dict[str, int] = {}
        self.owed: dict[str, set[int]] = {}
        self.moving: dict[str, bool] = {}
        self.finished: list[str] = []
        self.most_at_once = 0

    def follow(self, messages: list[Received]) -> None:
        """Take all messages of a recording."""
        for message in messages:
            if message.topic in TOPICS:
                getattr(self, f"_{message.topic}")(message.json)
        assert not self.running, "every episode that began has ended"

    def _discovery(self, content: Json) -> None:
        assert HASH.fullmatch(content["simulation_hash"])
        self.asked.add(content["simulation_hash"])

    def _server(self, content: Json) -> None:
        assert content["simulation_hash"] in self.asked
        assert content["server"] not in self.running.values(), "a taken server does not answer"
        self.offered.add(content["server"])

    def _parameters(self, content: Json) -> None:
        assert content["server"] in self.offered
        assert HASH.fullmatch(content["simulation_hash"])
        assert content["simulation_hash"] not in self.asked | self.configured.keys(), "a hash is used once"
        self.configured[content["simulation_hash"]] = content["server"]

    def _control(self, content: Json) -> None:
        hash_, server = content["simulation_hash"], content["server"]
        assert self.configured.get(hash_) == server
        if not content["run"]:
            self.running.pop(hash_, None)
            return
        assert server not in self.running.values(), "a server serves one at a time"
        assert hash_ not in self.finished
        self.running[hash_], self.owed[hash_], self.moving[hash_] = server, set(), False
        self.most_at_once = max(self.most_at_once, len(self.running))

    def _sensor(self, content: Json) -> None:
        hash_, agent = content["simulation_hash"], content["agent"]
        assert hash_ in self.running
        if self.moving[hash_]:  # a new step: all agents of the one before have been answered
            assert not self.owed[hash_]
            self.moving[hash_] = False
        assert agent not in self.owed[hash_], "one sensor message per agent and step"
        self.owed[hash_].add(agent)

    def _actuator(self, content: Json) -> None:
        hash_ = content["simulation_hash"]
        assert hash_ in self.running
        assert content["agent"] in self.owed[hash_], "one actuator message per sensor message"
        self.owed[hash_].remove(content["agent"])
        self.moving[hash_] = not self.owed[hash_]

    def _fitness(self, content: Json) -> None:
        hash_ = content["simulation_hash"]
        assert not self.owed[hash_], "fitness comes after the last actuators"
        del self.running[hash_]
        self.finished.append(hash_)
