"""An optimization tool that knows D6.1 and nothing else, as a script of another maker would be."""

import json
import queue
import struct
from pathlib import Path
from typing import Any

from tests.system.peer import TOOLS, Peer, Received

QUIET = 0.15
"""Seconds in which a server that would say something has said it."""
VECTORS = Path(__file__).parents[2] / "protocol" / "vectors"

Json = dict[str, Any]


def binary32(value: object) -> object:
    """Numbers as an IEEE binary32 reads them."""
    if isinstance(value, list):
        return [binary32(item) for item in value]
    return struct.unpack("f", struct.pack("f", value))[0]


class PlainTool(Peer):
    """Listens to servers; `hear` is the next thing that one says."""

    def __init__(self, url: str, version: int = 5) -> None:
        super().__init__(url, "server", "sensor", "fitness", f"{TOOLS}+", version=version)

    def hear(self, seconds: float = 10) -> tuple[str, Json]:
        """Topic and content of the next message."""
        try:
            message: Received = self.inbox.get(timeout=seconds)
        except queue.Empty:
            raise AssertionError(f"the server said nothing for {seconds} s") from None
        return message.topic, message.json

    def silence(self, why: str, seconds: float = QUIET) -> None:
        """Nothing comes."""
        try:
            message = self.inbox.get(timeout=seconds)
        except queue.Empty:
            return
        raise AssertionError(f"{why}: expected silence, heard {message}")

    def discover(self, simulation_hash: str, seconds: float = 2, **requirements: int) -> Json | None:
        """The first answer to a discovery, if one comes."""
        self.ask(simulation_hash, **requirements)
        try:
            topic, answer = self.hear(seconds)
        except AssertionError:
            return None
        assert topic == "server"
        return answer

    def ask(self, simulation_hash: str, **requirements: int) -> None:
        """Publish a discovery of Minisim."""
        needs = requirements or {"dimensions": 2}
        self.send("discovery", simulation="minisim", simulation_hash=simulation_hash, requirements=needs)

    def begin(self, server: int, simulation_hash: str, **parameters: Any) -> Json:
        """Start an episode; its first sensor message."""
        self.send("parameters", server=server, simulation_hash=simulation_hash, **parameters)
        self.send("control", server=server, simulation_hash=simulation_hash, run=True)
        topic, sensor = self.hear()
        assert topic == "sensor"
        return sensor

    def replay(self, conversation: Json) -> int:
        """Say what a vector's tools say, check what the server says; how many messages it said."""
        heard = 0
        for entry in conversation["messages"]:
            if "silence" in entry:
                self.silence(entry["why"])
            elif entry["from"] == "server":
                topic, content = self.hear()
                token = entry.get("token")
                expected = entry["topic"] if token is None else f"{TOOLS}{token}"
                assert topic == expected, f"expected {entry}, heard {topic} {content}"
                self._compare(entry["payload"], content)
                heard += 1
            elif "file" in entry:
                self.publish(entry["topic"], (VECTORS / entry["file"]).read_bytes())
            else:
                self.publish(entry["topic"], entry.get("text", json.dumps(entry.get("payload"))))
        self.silence("the conversation is over")
        return heard

    @staticmethod
    def _compare(expected: Json, content: Json) -> None:
        for key, value in expected.items():
            found = content[key]
            if key == "sensor":
                assert binary32(found) == binary32(value), content
            elif isinstance(value, dict):
                assert {inner: found[inner] for inner in value} == value, content
            else:
                assert found == value, f"{key}: {content}"
