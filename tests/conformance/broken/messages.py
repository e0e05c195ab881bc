"""Servers that read messages in a way that a rule forbids."""

import json
from typing import ClassVar

from tests.conformance import sound
from tests.conformance.broken.base import Broken
from tests.conformance.sound import Json, Refused


class DoesNotClamp(Broken):
    """Does not limit actuators to their range."""

    breaks: ClassVar = {"S4.1"}

    def clamp(self, value: float) -> float:
        return value


class TheLastCounts(Broken):
    """Takes the second actuators of an agent in a step, instead of the first."""

    breaks: ClassVar = {"S4.3"}

    def on_actuator(self, content: Json) -> None:
        if content["agent"] in self.acting and len(self.actuators) < self.enough():
            self.actuators.pop(content["agent"], None)
        super().on_actuator(content)


class DiesOfJunk(Broken):
    """Does not catch the errors of its JSON reader."""

    breaks: ClassVar = {"S5.1"}
    died: ClassVar = True

    def read(self, payload: bytes) -> Json:
        try:
            return super().read(payload)
        except ValueError:
            self.client.disconnect()
            raise


class ConvertsText(Broken):
    """Takes numbers in quotes."""

    breaks: ClassVar = {"S5.3"}

    def is_for_me(self, content: Json) -> bool:
        return super().is_for_me({"server": int(content["server"])})


class TakesNan(Broken):
    """Takes whatever its JSON reader takes for a number."""

    breaks: ClassVar = {"S5.4"}

    def read(self, payload: bytes) -> Json:
        return json.loads(payload) if b'"actuator": [' in payload[:200] else super().read(payload)

    def actuators_of(self, values: object) -> list[float]:
        if not isinstance(values, list) or not all(isinstance(value, float) for value in values):
            return super().actuators_of(values)
        if len(values) != self.actuators_of_an_agent:
            raise Refused("the wrong number of actuators")
        return [self.clamp(value) for value in values]


class FillsUp(Broken):
    """Takes any number of actuators: fills up with zeros, or leaves out the rest."""

    breaks: ClassVar = {"S5.5"}

    def actuators_of(self, values: object) -> list[float]:
        filled = [*values, *[0.0] * self.actuators_of_an_agent] if isinstance(values, list) else values
        return super().actuators_of(
            filled[: self.actuators_of_an_agent] if isinstance(filled, list) else filled
        )


class CountsAnybody(Broken):
    """Counts the actuators of agents that it did not ask."""

    breaks: ClassVar = {"S5.6"}

    def on_actuator(self, content: Json) -> None:
        agent = sound.whole(content["agent"])
        if agent not in self.acting and self.state == "running":
            self.actuators[self.acting[agent % len(self.acting)]] = self.actuators_of(content["actuator"])
        super().on_actuator(content)


class AnyHash(Broken):
    """Takes actuators of every episode for its own."""

    breaks: ClassVar = {"S5.7"}

    def is_mine(self, hash_: str) -> bool:
        return bool(hash_) and self.state == "running"


class AnyServer(Broken):
    """Does not look at the ID in parameters and control."""

    breaks: ClassVar = {"S5.8"}

    def is_for_me(self, content: Json) -> bool:
        sound.whole(content["server"])
        return True


class AnySize(Broken):
    """Reads messages of any length."""

    breaks: ClassVar = {"S5.10"}

    def read(self, payload: bytes) -> Json:
        if len(payload) > 1 << 20:
            value: Json = json.loads(payload)
            return value
        return super().read(payload)


class NoDecimals(Broken):
    """Refuses 1.0 where an integer is expected."""

    breaks: ClassVar = {"S5.11"}

    def is_for_me(self, content: Json) -> bool:
        if isinstance(content["server"], float):
            raise Refused("no integer")
        return super().is_for_me(content)


class FirstKeyCounts(Broken):
    """Keeps the first of repeated keys."""

    breaks: ClassVar = {"S5.12"}

    def read(self, payload: bytes) -> Json:
        super().read(payload)
        found = json.loads(payload, object_pairs_hook=lambda pairs: dict(reversed(pairs)))
        assert isinstance(found, dict)
        return found


class OneSpelling(Broken):
    """Knows the key max_agents, but not `max agents`."""

    breaks: ClassVar = {"S5.13"}

    def fits(self, title: str, required: Json) -> bool:
        return super().fits(title, {key: value for key, value in required.items() if key != "max agents"})
