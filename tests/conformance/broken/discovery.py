"""Servers that break a rule of discovery, of reservations or of the connection."""

import json
import os
import secrets
from typing import Any, ClassVar

from paho.mqtt.client import MQTTMessage

from tests.conformance.broken.base import CONNECTION, Broken
from tests.conformance.sound import Json, real

INSTANCE = secrets.token_hex(8)


class WrongEcho(Broken):
    """Answers a discovery with a hash of its own."""

    breaks: ClassVar = {"S1.2"}

    def answer(self, hash_: str) -> None:
        super().answer(hash_[::-1])


class EchoOfTheLast(Broken):
    """Answers a discovery with the hash of the one before it."""

    breaks: ClassVar = {"S1.2"}
    last = "0" * 64

    def answer(self, hash_: str) -> None:
        super().answer(self.last)
        self.last = hash_


class OffersEverything(Broken):
    """Answers discoveries of every title."""

    breaks: ClassVar = {"S1.4"}

    def fits(self, title: str, required: Json) -> bool:  # noqa: ARG002
        return super().fits(self.title, required)


class AnyDimensions(Broken):
    """Does not look at the dimensions."""

    breaks: ClassVar = {"S1.5"}

    def fits(self, title: str, required: Json) -> bool:
        return real(required["dimensions"]) > -1e9 and super().fits(title, {**required, "dimensions": 1})


class AnyCrowd(Broken):
    """Does not look at the number of agents."""

    breaks: ClassVar = {"S1.6"}

    def fits(self, title: str, required: Json) -> bool:
        return super().fits(title, {"dimensions": required["dimensions"]})


class HexadecimalOnly(Broken):
    """Takes hashes for hexadecimal numbers."""

    breaks: ClassVar = {"S1.7"}

    def answer(self, hash_: str) -> None:
        super().answer(f"{int(hash_, 16):0{len(hash_)}x}")


class AnswersAfterParameters(Broken):
    """Counts as reserved only when control has come, not from parameters on."""

    breaks: ClassVar = {"S6.1"}

    def is_free(self, tool: str | None) -> bool:
        return super().is_free(tool) or self.state == "configured"


class AnswersWhileRunning(Broken):
    """Answers discovery in the middle of an episode."""

    breaks: ClassVar = {"S6.2"}

    def is_free(self, tool: str | None) -> bool:
        return super().is_free(tool) or self.state == "running"


class WaitsForControl(Broken):
    """Never gives up waiting for control."""

    breaks: ClassVar = {"S6.5"}
    rules: ClassVar = "S1,S2,S6,-S6.9"
    died: ClassVar = False

    def patience(self) -> float:
        return 1e9 if self.state == "configured" else super().patience()


class IsNotHeld(Broken):
    """Is free for every tool as soon as an episode has ended."""

    breaks: ClassVar = {"S6.7"}

    def is_free(self, tool: str | None) -> bool:
        return super().is_free(tool) or self.state == "held"


class IsHeldForEver(Broken):
    """Never ends the reservation after an episode."""

    breaks: ClassVar = {"S6.9"}
    rules: ClassVar = "S1,S2,S6,-S6.5"

    def patience(self) -> float:
        return 1e9 if self.state == "held" else super().patience()


class AlwaysReady(Broken):
    """Announces ready while it is busy."""

    breaks: ClassVar = {"S7.4"}

    def presence(self, state: str, tool: str | None) -> str:
        return super().presence("ready" if state == "busy" else state, tool)


class RetainsEverything(Broken):
    """Sets the retain flag of every message."""

    breaks: ClassVar = {"S7.5"}

    def publish(self, topic: str, **fields: Any) -> None:
        self.client.publish(topic, json.dumps(fields), retain=True)


class HasNoLastWill(Broken):
    """Sets no last will, so that its loss is not announced."""

    breaks: ClassVar = {"S11.3"}
    rules: ClassVar = CONNECTION

    def will(self) -> None:
        pass


class TakesLeftovers(Broken):
    """Takes retained messages like others."""

    breaks: ClassVar = {"S11.4"}
    rules: ClassVar = CONNECTION

    def receive(self, message: MQTTMessage) -> None:
        message.retain = False
        super().receive(message)


class TakesLeftoverRequests(Broken):
    """Takes retained messages on its own topic like others."""

    breaks: ClassVar = {"S11.4"}
    rules: ClassVar = CONNECTION

    def receive(self, message: MQTTMessage) -> None:
        message.retain = message.retain and not message.topic.startswith("swarmwright/v1/server/")
        super().receive(message)


class KeepsItsId(Broken):
    """Announces its instance, and does not look at those of others."""

    breaks: ClassVar = {"S16.1", "S16.3", "S16.5"}
    rules: ClassVar = "S1,S2.3,S7.2,S16"

    def capabilities(self) -> Json:
        found = super().capabilities()
        found["swarmwright"] |= {"instance": INSTANCE, "host": "localhost", "pid": os.getpid()}
        return found
