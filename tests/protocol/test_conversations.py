"""The conversations: every message fits its schema, and the order is the protocol's."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeAlias

from jsonschema import Draft202012Validator

Validators = Callable[[str], Draft202012Validator]
Value: TypeAlias = Any  # JSON of whatever shape
Json = dict[str, Any]


def topic_of(entry: Json) -> str:
    """The topic; what JSON is on a server's own one is control."""
    topic: str = entry["topic"]
    return "control" if topic.startswith("swarmwright/v1/server/") else topic


def payload(entry: Json, protocol: Path) -> Value:
    """The JSON that an entry stands for; none for text that is no JSON."""
    if "file" in entry:
        return json.loads((protocol / "vectors" / entry["file"]).read_text(encoding="utf-8"))
    if "payload" in entry:
        return entry["payload"]
    try:
        return json.loads(entry["text"])
    except ValueError:
        return None


def test_messages_fit_their_schemas(conversation: Json, protocol: Path, validators: Validators) -> None:
    assert conversation["title"].endswith(".")
    for entry in conversation["messages"]:
        if "silence" in entry:
            assert entry["why"]
            continue
        validator = validators("failed" if entry["topic"] == "to_tool" else topic_of(entry))
        if "text" in entry:
            value = payload(entry, protocol)
            assert value is None or "NaN" in entry["text"] or not validator.is_valid(value)
        else:
            value = payload(entry, protocol)
            # Nobody foresees the words in which a peer says why.
            validator.validate({"reason": "", **value} if entry["topic"] == "to_tool" else value)


class Referee:
    """Follows one server: who holds it, which hash runs, which agents are owed an actuator message."""

    def __init__(self) -> None:
        self.parameters: dict[str, str] = {}
        self.holder: str | None = None
        self.running: str | None = None
        self.owed: set[int] = set()
        self.moved = False
        self.fitness = 0

    def tool(self, party: str, topic: str, value: Json) -> None:
        known = self.parameters.get(value["simulation_hash"]) == party
        mine = value.get("server", 1) == 1 and self.holder in {None, party}
        if topic == "parameters" and mine:
            self.holder = party
            self.parameters[value["simulation_hash"]] = party
        elif topic == "control" and mine and known:
            self.running = value["simulation_hash"] if value["run"] else None
            self.holder = party if value["run"] else None
            self.owed, self.moved = set(), False
        elif topic == "actuator" and value["simulation_hash"] == self.running and len(value["actuator"]) == 1:
            self.moved = self.moved or value["agent"] in self.owed
            self.owed.discard(value["agent"])

    def server(self, topic: str, value: Json, asked: set[str]) -> None:
        if topic == "server":
            assert self.holder is None, "a taken server does not answer discovery"
            assert value["simulation_hash"] in asked
            return
        assert value["simulation_hash"] == self.running
        if topic == "to_tool":
            assert self.holder is not None
            self.running = self.holder = None
        elif topic == "sensor":
            if self.moved:
                assert not self.owed, "a step happens when all live agents have their actuators"
                self.moved = False
            assert value["agent"] not in self.owed
            self.owed.add(value["agent"])
        else:
            assert topic == "fitness"
            assert not self.owed
            self.running = self.holder = None
            self.fitness += 1


def test_the_order_is_the_protocol_s(conversation: Json, protocol: Path) -> None:
    referee = Referee()
    asked: set[str] = set()
    for entry in conversation["messages"]:
        value = payload(entry, protocol) if "topic" in entry else None
        if not isinstance(value, dict) or "text" in entry:
            continue
        if entry["topic"] == "discovery":
            asked.add(value["simulation_hash"])
        elif entry["from"] == "server":
            referee.server(entry["topic"], value, asked)
        else:
            assert entry["from"] in {"tool", "other"}
            referee.tool(entry["from"], topic_of(entry), value)
    assert referee.running is None
    has_fitness = any(entry.get("topic") == "fitness" for entry in conversation["messages"])
    assert (referee.fitness > 0) == has_fitness
