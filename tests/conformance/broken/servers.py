"""Simulation servers that break one rule each, and are else as they should be.

`breaks` names the rules that must catch it, and no other may; what cannot be tried because of that does not
count.
"""

import json
import math
import os
import random
import secrets
from typing import Any, ClassVar

import numpy as np
from paho.mqtt.client import MQTTMessage

from tests.conformance import sound
from tests.conformance.broken import samples  # noqa: F401 - its servers are in SERVERS
from tests.conformance.broken.base import CONNECTION, OWN_TOPIC, SCENES, Broken
from tests.conformance.broken.offloaded import BrokenRobots
from tests.conformance.broken.steered import BrokenSteered
from tests.conformance.sound import Json, Refused, World, real

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
    """Does not look at the title."""

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


class NoNumber(Broken):
    """Sends a fitness that is no number."""

    breaks: ClassVar = {"S2.3"}

    def send_fitness(self, hash_: str | None, world: World) -> None:  # noqa: ARG002
        self.publish("fitness", simulation_hash=hash_, fitness=math.nan)


class ForgetsTheLastAgent(Broken):
    """Steps when all but one agent have their actuators."""

    breaks: ClassVar = {"S2.5"}

    def enough(self) -> int:
        return max(1, len(self.acting) - 1)


class SendsFitnessTwice(Broken):
    """To be sure."""

    breaks: ClassVar = {"S2.6"}

    def send_fitness(self, hash_: str | None, world: World) -> None:
        super().send_fitness(hash_, world)
        super().send_fitness(hash_, world)


class StaysTaken(Broken):
    """Waits for run: false after the fitness."""

    breaks: ClassVar = {"S2.7"}

    def finish(self, world: World) -> None:
        self.acting = []
        self.send_fitness(self.hash, world)


class EndsForAnybody(Broken):
    """Looks at the hash alone where an episode is to end."""

    breaks: ClassVar = {"S6.11", "S6.12"}

    def is_of(self, tool: str | None) -> bool:
        return self.state == "running" or super().is_of(tool)


class EndsUnnamedForAnybody(Broken):
    """Compares names only where the tool that began the episode has one."""

    breaks: ClassVar = {"S6.12"}

    def is_of(self, tool: str | None) -> bool:
        return not self.holder or super().is_of(tool)


class BeginsAnything(Broken):
    """Does not look at the title in control."""

    breaks: ClassVar = {"S2.15"}

    def offers(self, content: Json) -> bool:  # noqa: ARG002
        return True


class IgnoresTheEnd(Broken):
    """Does not know run: false."""

    breaks: ClassVar = {"S2.9"}

    def end(self, hash_: str, tool: str | None) -> None:
        pass


class UnevenSensors(Broken):
    """One agent has a sensor more."""

    breaks: ClassVar = {"S2.13"}

    def publish(self, topic: str, **fields: Any) -> None:
        if topic == "sensor" and fields["agent"] == 1:
            fields["sensor"] = [*fields["sensor"], 0.0]
        super().publish(topic, **fields)


class NeedsSimulation(Broken):
    """Requires simulation in control, as D6.1's schema does."""

    breaks: ClassVar = {"S2.14"}

    def on_control(self, content: Json) -> None:
        if content["simulation"] != self.title:
            raise Refused("simulation")
        super().on_control(content)


class Random(Broken):
    """Noise that no seed explains."""

    breaks: ClassVar = {"S3.1"}

    def make(self, parameters: Json) -> World:
        world = super().make(parameters)
        world.places += np.float32(random.random())
        return world


class Leaks(Broken):
    """The seed of an episode moves the agents of the next one."""

    breaks: ClassVar = {"S3.2"}
    before = 0

    def make(self, parameters: Json) -> World:
        world = super().make(parameters)
        world.places += np.float32(self.before / 128)
        self.before = parameters.get("seed", 0)
        return world


class FitnessOfTheLast(Broken):
    """Sends the fitness of the episode before, as one that is computed too late."""

    breaks: ClassVar = {"S3.2"}
    last = 0.0

    def send_fitness(self, hash_: str | None, world: World) -> None:
        last, self.last = self.last, world.fitness()
        self.publish("fitness", simulation_hash=hash_, fitness=last, metrics=self.measure(world))


class SeedOf32Bits(Broken):
    """Truncates the seed."""

    breaks: ClassVar = {"S3.5"}

    def make(self, parameters: Json) -> World:
        return super().make({**parameters, "seed": parameters.get("seed", 0) & 0xFFFF_FFFF})


class SeedAsDouble(Broken):
    """Reads all numbers as JavaScript does."""

    breaks: ClassVar = {"S3.5"}

    def make(self, parameters: Json) -> World:
        return super().make({**parameters, "seed": int(float(parameters.get("seed", 0)))})


class SignedSeed(Broken):
    """Takes no seed of more than 32 bits."""

    breaks: ClassVar = {"S3.5"}

    def on_parameters(self, content: Json) -> None:
        if content.get("seed", 0) < 2**31:
            super().on_parameters(content)


class FirstParameters(Broken):
    """Keeps the first parameters of a hash."""

    breaks: ClassVar = {"S3.3"}

    def on_parameters(self, content: Json) -> None:
        known = self.parameters.get(content["simulation_hash"])
        super().on_parameters(known or content)


class OneSetOfParameters(Broken):
    """Starts with the parameters that came last, whosever."""

    breaks: ClassVar = {"S3.4"}

    def make(self, parameters: Json) -> World:  # noqa: ARG002
        return super().make(self.parameters[self.newest or ""])


class DoesNotClamp(Broken):
    """Moves as far as it is told."""

    breaks: ClassVar = {"S4.1"}

    def clamp(self, value: float) -> float:
        return value


class TheLastCounts(Broken):
    """Takes a second answer of an agent."""

    breaks: ClassVar = {"S4.3"}

    def on_actuator(self, content: Json) -> None:
        if len(self.actuators) < self.enough():
            self.actuators.pop(content["agent"], None) if content["agent"] in self.acting else None
        super().on_actuator(content)


class DiesOfJunk(Broken):
    """Does not catch what its JSON reader throws."""

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
    """Takes any number of actuators, fills up with zeros."""

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
    """Does not know that 1.0 is an integer."""

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
    """Knows max_agents alone."""

    breaks: ClassVar = {"S5.13"}

    def fits(self, title: str, required: Json) -> bool:
        return super().fits(title, {key: value for key, value in required.items() if key != "max agents"})


class AnswersAfterParameters(Broken):
    """Feels taken only once control has come."""

    breaks: ClassVar = {"S6.1"}

    def is_free(self, tool: str | None) -> bool:
        return super().is_free(tool) or self.state == "configured"


class AnswersWhileRunning(Broken):
    """Answers discovery in the middle of an episode."""

    breaks: ClassVar = {"S6.2"}

    def is_free(self, tool: str | None) -> bool:
        return super().is_free(tool) or self.state == "running"


class AnybodyEndsIt(Broken):
    """Ends its episode whoever says so."""

    breaks: ClassVar = {"S6.3"}

    def end(self, hash_: str, tool: str | None) -> None:
        super().end(self.hash if self.state == "running" and self.hash else hash_, tool)


class LastControlWins(Broken):
    """Leaves one tool for another in the middle of an episode."""

    breaks: ClassVar = {"S6.4"}

    def may_start(self, tool: str | None) -> bool:
        return super().may_start(tool) or self.state == "running"


class WaitsForControl(Broken):
    """Never gives up waiting for control."""

    breaks: ClassVar = {"S6.5"}
    rules: ClassVar = "S1,S2,S6,-S6.9"
    died: ClassVar = False

    def patience(self) -> float:
        return 1e9 if self.state == "configured" else super().patience()


class IsNotHeld(Broken):
    """Forgets who had it."""

    breaks: ClassVar = {"S6.7"}

    def is_free(self, tool: str | None) -> bool:
        return super().is_free(tool) or self.state == "held"


class IsHeldForEver(Broken):
    """Waits for its holder for ever."""

    breaks: ClassVar = {"S6.9"}
    rules: ClassVar = "S1,S2,S6,-S6.5"

    def patience(self) -> float:
        return 1e9 if self.state == "held" else super().patience()


class AlwaysReady(Broken):
    """Its presence does not follow."""

    breaks: ClassVar = {"S7.4"}

    def presence(self, state: str, tool: str | None) -> str:
        return super().presence("ready" if state == "busy" else state, tool)


class RetainsEverything(Broken):
    """Sets the retain flag, so that nothing is lost."""

    breaks: ClassVar = {"S7.5"}

    def publish(self, topic: str, **fields: Any) -> None:
        self.client.publish(topic, json.dumps(fields), retain=True)


class LosesAMetric(Broken):
    """Announces two metrics and sends one."""

    breaks: ClassVar = {"S8.2"}

    def measure(self, world: World) -> dict[str, float]:
        return {"arrived": world.metrics()["arrived"]}


class QuotesAMetric(Broken):
    """Sends a metric as text."""

    breaks: ClassVar = {"S8.2"}

    def send_fitness(self, hash_: str | None, world: World) -> None:
        metrics = {**world.metrics(), "steps": str(world.step_number)}
        self.publish("fitness", simulation_hash=hash_, fitness=world.fitness(), metrics=metrics)


class HasNoLastWill(Broken):
    """Says nothing when it is lost."""

    breaks: ClassVar = {"S11.3"}
    rules: ClassVar = CONNECTION

    def will(self) -> None:
        pass


class TakesLeftovers(Broken):
    """Does not look at the retain flag."""

    breaks: ClassVar = {"S11.4"}
    rules: ClassVar = CONNECTION

    def receive(self, message: MQTTMessage) -> None:
        message.retain = False
        super().receive(message)


class SkipsTheFirstScene(Broken):
    """Shows an episode from its first step on."""

    breaks: ClassVar = {"S14.1"}
    rules: ClassVar = SCENES

    def show(self, topic: str, scene: Json) -> None:
        if scene["step"]:
            super().show(topic, scene)


class DrawsHalfABody(Broken):
    """Has fewer y than x."""

    breaks: ClassVar = {"S14.2"}
    rules: ClassVar = SCENES

    def picture(self, world: World) -> Json:
        scene = super().picture(world)
        scene["bodies"]["y"] = scene["bodies"]["y"][:-4]
        return scene


class ShowsEverybody(Broken):
    """Sends scenes to tools that did not ask for them."""

    breaks: ClassVar = {"S14.3"}
    rules: ClassVar = SCENES

    def on_control(self, content: Json) -> None:
        super().on_control({**content, "scenes": []})


class HearsRequestsAlone(Broken):
    """Announces control and takes requests on its own topic, nothing else."""

    breaks: ClassVar = {"S15.1"}
    rules: ClassVar = OWN_TOPIC

    def on_own_topic(self, payload: bytes) -> None:
        self.requested(payload)


class EndsElsewhere(Broken):
    """Starts episodes on its own topic, and waits for their end on control."""

    breaks: ClassVar = {"S15.2"}
    rules: ClassVar = OWN_TOPIC

    def on_own_topic(self, payload: bytes) -> None:
        content = self.read(payload)
        if content.get("run", True) is not False:
            self.on_control(content)


class KeepsItsId(Broken):
    """Announces its instance, and does not look at those of others."""

    breaks: ClassVar = {"S16.1", "S16.3"}
    rules: ClassVar = "S1,S2.3,S7.2,S16"

    def capabilities(self) -> Json:
        found = super().capabilities()
        found["swarmwright"] |= {"instance": INSTANCE, "host": "localhost", "pid": os.getpid()}
        return found


class IsMeant(Broken):
    """Takes what comes on its own topic for a message to itself."""

    breaks: ClassVar = {"S15.3"}
    rules: ClassVar = OWN_TOPIC

    def on_own_topic(self, payload: bytes) -> None:
        self.on_control({**self.read(payload), "server": self.server})


SERVERS: list[type[Broken]] = [
    *(kind for kind in Broken.__subclasses__() if kind is not BrokenSteered),
    *BrokenRobots.__subclasses__(),
    *BrokenSteered.__subclasses__(),
]
