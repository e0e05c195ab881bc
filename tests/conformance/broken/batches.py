"""A sound server with batches; ones that break their rules."""

import time
from typing import Any, ClassVar

import msgpack
import numpy as np
from paho.mqtt.packettypes import PacketTypes
from paho.mqtt.properties import Properties

from tests.conformance.broken.base import Broken
from tests.conformance.sound import Json, Refused, SoundServer, World, text

BATCH = 8
BATCHED = "S1,S2.3,S3.2,S10"


class Batched(SoundServer):
    """Sound. Others break methods of one purpose."""

    batch: Json
    worlds: list[World]
    rows: list[tuple[int, int]]
    step_of_batch = 0

    def capabilities(self) -> Json:
        found = super().capabilities()
        found["swarmwright"] |= {"modes": ["stepwise", "batched", "offloaded"], "batch": BATCH}
        return found

    def requested(self, payload: bytes) -> None:
        try:
            request = msgpack.unpackb(payload)
        except ValueError:
            request = None
        kind = request.get("kind") if isinstance(request, dict) else None
        if kind == "start":
            self.start_batch(request)
        elif kind == "actuators":
            self.step_batch(request)
        else:
            super().requested(payload)

    def start_batch(self, request: Json) -> None:
        tool = text(request["tool"])
        if not self.is_free(tool):
            self.sensors_message(request, error={"kind": "taken", "reason": f"taken by {self.holder}"})
            return
        unknown = set(request.get("metrics", [])) - {"arrived", "steps"}
        count = len(request["seeds"]) // 8
        if (
            request["version"] != 1
            or request["simulation"] != self.title
            or unknown
            or not 0 < count <= BATCH
        ):
            self.sensors_message(request, error={"kind": "invalid", "reason": "a field is wrong"})
            return
        self.batch, self.step_of_batch = request, 0
        self.worlds = self.worlds_of(request, np.frombuffer(request["seeds"], "<u8").tolist())
        self.enter("stepping", tool)
        self.sense_batch(list(range(count)))

    def worlds_of(self, request: Json, seeds: list[int]) -> list[World]:
        return [self.make({**request["parameters"], "seed": seed}) for seed in seeds]

    def sense_batch(self, running: list[int]) -> None:
        """The next message, for episodes that had not ended before."""
        self.rows = [(episode, agent) for episode in running for agent in self.worlds[episode].acting()]
        self.enter("stepping" if self.rows else "held", self.holder)
        episodes, agents = (np.array(column, "<u4").tobytes() for column in np.reshape(self.rows, (-1, 2)).T)
        sensed = [self.worlds[episode].sense(agent) for episode, agent in self.rows]
        fields = {"episodes": episodes, "agents": agents, "sensors": np.array(sensed, "<f4").tobytes()}
        left = {episode for episode, _ in self.rows}
        over = self.ended(self.batch, [episode for episode in running if episode not in left])
        self.sensors_message(self.batch, step=self.step_of_batch, **fields, **over)

    def ended(self, request: Json, episodes: list[int]) -> Json:
        worlds = [self.worlds[episode] for episode in episodes]
        metrics = {
            name: np.array([world.metrics()[name] for world in worlds], "<f8").tobytes()
            for name in request.get("metrics", [])
        }
        fitness = np.array([world.fitness() for world in worlds], "<f8").tobytes()
        return {"ended": np.array(episodes, "<u4").tobytes(), "fitness": fitness, "metrics": metrics}

    def step_batch(self, message: Json) -> None:
        if self.state != "stepping" or message["request"] != self.batch["request"]:
            raise Refused("no such batch")
        numbers = np.frombuffer(message["actuators"], "<f4")
        if not len(numbers):
            self.enter("held", self.holder)
            return
        if message["step"] != self.step_of_batch or not np.isfinite(numbers).all():
            raise Refused("another step, or not finite")
        if len(numbers) != len(self.rows) * self.actuators_of_an_agent:
            raise Refused("the wrong number of actuators")
        values = numbers.reshape(len(self.rows), -1).tolist()
        running = sorted({episode for episode, _ in self.rows})
        for episode in running:
            rows = zip(self.rows, values, strict=True)
            self.worlds[episode].step({agent: row for (one, agent), row in rows if one == episode})
        self.step_of_batch += 1
        self.sense_batch(running)

    def end(self, hash_: str, tool: str | None) -> None:
        if self.state == "stepping":
            if self.is_of(tool):
                self.cancel()
        else:
            super().end(hash_, tool)

    def cancel(self) -> None:
        self.enter("free")

    def tick(self) -> None:
        if self.state == "stepping" and time.monotonic() >= self.until:
            self.give_up()
        super().tick()

    def give_up(self) -> None:
        self.sensors_message(self.batch, error={"kind": "failed", "reason": "no actuators came"})
        self.enter("free")

    def sensors_message(self, request: Json, **fields: Any) -> None:
        properties = Properties(PacketTypes.PUBLISH)  # type: ignore[no-untyped-call]
        properties.CorrelationData = request["request"].to_bytes(8, "big")
        properties.ContentType = "application/msgpack"
        message = {"kind": "sensors", "version": 1, "request": request["request"], "server": self.server}
        nothing = dict.fromkeys(("episodes", "agents", "sensors", "ended", "fitness"), b"")
        payload = msgpack.packb({**message, "step": 0, **nothing, **fields})
        self.client.publish(request["reply"], payload, properties=properties)


class BrokenBatched(Broken, Batched):
    """What these have in common; breaks none itself."""

    rules: ClassVar = BATCHED


class BatchSeedsOf32Bits(BrokenBatched):
    """Truncates the seeds of a batch."""

    breaks: ClassVar = {"S10.7"}

    def worlds_of(self, request: Json, seeds: list[int]) -> list[World]:
        return super().worlds_of(request, [seed & 0xFFFF_FFFF for seed in seeds])


class BatchSeedsAsDoubles(BrokenBatched):
    """Reads the seeds of a batch through doubles."""

    breaks: ClassVar = {"S10.7"}

    def worlds_of(self, request: Json, seeds: list[int]) -> list[World]:
        return super().worlds_of(request, [int(float(seed)) for seed in seeds])


class BatchPrefersTheSeedOfParameters(BrokenBatched):
    """Takes the seed in parameters for that of all episodes."""

    breaks: ClassVar = {"S10.7"}

    def worlds_of(self, request: Json, seeds: list[int]) -> list[World]:
        return super().worlds_of(request, [request["parameters"].get("seed", seed) for seed in seeds])


class GoesOnWithBatches(BrokenBatched):
    """Does not let a tool end its batch."""

    breaks: ClassVar = {"S10.8"}

    def cancel(self) -> None:
        pass
