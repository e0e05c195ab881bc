"""Servers that break a rule of how an episode begins, runs and ends, or of what it sends."""

import math
from typing import Any, ClassVar

from tests.conformance.broken.base import OWN_TOPIC, SCENES, Broken
from tests.conformance.sound import Json, Refused, World


class NoNumber(Broken):
    """Sends NaN as fitness."""

    breaks: ClassVar = {"S2.3"}

    def send_fitness(self, hash_: str | None, world: World) -> None:  # noqa: ARG002
        self.publish("fitness", simulation_hash=hash_, fitness=math.nan)


class ForgetsTheLastAgent(Broken):
    """Steps when all but one agent have their actuators."""

    breaks: ClassVar = {"S2.5"}

    def enough(self) -> int:
        return max(1, len(self.acting) - 1)


class SendsFitnessTwice(Broken):
    """Sends every fitness twice."""

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
    """Ignores run: false."""

    breaks: ClassVar = {"S2.9"}

    def end(self, hash_: str, tool: str | None) -> None:
        pass


class UnevenSensors(Broken):
    """Sends one sensor more for one agent."""

    breaks: ClassVar = {"S2.13"}

    def publish(self, topic: str, **fields: Any) -> None:
        if topic == "sensor" and fields["agent"] == 1:
            fields["sensor"] = [*fields["sensor"], 0.0]
        super().publish(topic, **fields)


class NeedsSimulation(Broken):
    """Requires the key simulation in control, as D6.1's schema does."""

    breaks: ClassVar = {"S2.14"}

    def on_control(self, content: Json) -> None:
        if content["simulation"] != self.title:
            raise Refused("simulation")
        super().on_control(content)


class AnybodyEndsIt(Broken):
    """Ends its episode at a run: false with any hash."""

    breaks: ClassVar = {"S6.3"}

    def end(self, hash_: str, tool: str | None) -> None:
        super().end(self.hash if self.state == "running" and self.hash else hash_, tool)


class LastControlWins(Broken):
    """Leaves one tool for another in the middle of an episode."""

    breaks: ClassVar = {"S6.4"}

    def may_start(self, tool: str | None) -> bool:
        return super().may_start(tool) or self.state == "running"


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


class SkipsTheFirstScene(Broken):
    """Shows an episode from its first step on."""

    breaks: ClassVar = {"S14.1"}
    rules: ClassVar = SCENES

    def show(self, topic: str, scene: Json) -> None:
        if scene["step"]:
            super().show(topic, scene)


class DrawsHalfABody(Broken):
    """Sends scenes with fewer values y than x."""

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


class IsMeant(Broken):
    """Takes what comes on its own topic for itself, whichever server it names."""

    breaks: ClassVar = {"S15.3"}
    rules: ClassVar = OWN_TOPIC

    def on_own_topic(self, payload: bytes) -> None:
        self.on_control({**self.read(payload), "server": self.server})


class DropsEarlyControl(Broken):
    """Starts nothing when parameters come after their control."""

    breaks: ClassVar = {"S6.14"}

    def keep(self, control: Json) -> None:
        pass


class PlaysRepetitions(Broken):
    """Starts one more episode when control comes twice."""

    breaks: ClassVar = {"S6.15"}

    def was_answered(self, content: Json) -> bool:  # noqa: ARG002
        return False


class RejectsInSilence(Broken):
    """Leaves a tool that comes too late without news."""

    breaks: ClassVar = {"S7.6"}

    def reject(self) -> None:
        pass
