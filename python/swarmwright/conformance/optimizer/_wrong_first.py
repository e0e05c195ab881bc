"""A played server that sends wrong messages, one at a time, so that it is known which of them is answered."""

import json
import time
from collections import defaultdict, deque

from swarmwright.conformance.optimizer._stage import Actor, Json
from swarmwright.servers.broker.client import shown

PAUSE_S = 0.03
"""Seconds between a wrong message and the next."""
Tried = defaultdict[str, int]
"""How many wrong messages have been sent on each topic, by all servers of a scene."""


class WrongFirst(Actor):
    """Sends some wrong messages before each right one, until each kind has been sent once.

    tried: shared by the servers of a scene.
    """

    at_once = 3
    """Wrong messages before one right one, at most."""

    def __init__(self, server: int, tried: Tried) -> None:
        super().__init__(server)
        self.tried = tried
        self.waits: deque[tuple[str, Json]] = deque()
        self.left = 0
        self.until = 0.0
        self.wrong = ""

    def kinds(self, topic: str, right: Json) -> list[str | bytes]:
        """Wrong payloads in the place of a right message."""
        raise NotImplementedError

    def says(self, topic: str, **fields: object) -> None:
        """Wrong messages first."""
        if not self.waits:
            self.left = self.at_once
        self.waits.append((topic, fields))
        self.tick()

    def tick(self) -> None:
        """The next wrong message, or the right one, when it is time."""
        while self.waits and time.monotonic() >= self.until:
            topic, right = self.waits[0]
            kinds = self.kinds(topic, right)
            if self.left and self.tried[topic] < len(kinds):
                payload = kinds[self.tried[topic]]
                self.tried[topic] += 1
                self.left -= 1
                self.wrong = f"{topic} {shown(payload) or '(nothing)'}"
                self.stage.record.notes["last wrong"] = self.wrong
                self.stage.record.sent.append((topic, payload))
                self.stage.client.publish(topic, payload)
                self.until = time.monotonic() + PAUSE_S
                return
            self.waits.popleft()
            self.wrong, self.left = "", self.at_once
            super().says(topic, **right)

    def waits_with(self, topic: str) -> list[Json]:
        """Right messages on a topic that have not been sent yet."""
        return [right for name, right in self.waits if name == topic]

    def answers(self, content: Json) -> bool:
        """Not before the fitness is out."""
        return not self.waits_with("fitness") and super().answers(content)

    def actuator(self, content: Json) -> None:
        """An answer to a sensor message that has not been sent is one to a wrong message."""
        agent = content.get("agent")
        asked = [right["agent"] for right in self.waits_with("sensor")]
        if self.wrong and (agent in asked or agent not in self.waiting):
            self.reacted(f"actuator {json.dumps(content)}")
        else:
            super().actuator(content)

    def control(self, content: Json) -> None:
        """Failure if the tool begins or ends an episode before the right fitness has come."""
        if self.wrong and self.waits_with("fitness"):
            self.reacted(f"control {json.dumps(content)}")
        else:
            super().control(content)

    def reacted(self, what: str) -> None:
        """Note what came for a wrong message; the first time."""
        notes = self.stage.record.notes
        if "reaction" not in notes:
            notes |= {"reaction": what, "reaction to": self.wrong}


def both(kind: type[WrongFirst]) -> list[Actor]:
    """Two servers that share the work."""
    tried: Tried = defaultdict(int)
    return [kind(1, tried), kind(2, tried)]
