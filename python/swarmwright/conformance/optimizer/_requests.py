"""Simulated servers that accept requests: offloaded evaluation and batches."""

import re
from typing import Any

import msgpack
import numpy as np

from swarmwright import _engine
from swarmwright.conformance._extensions import KINDS, decode_message
from swarmwright.conformance.optimizer._stage import AGENTS, STEPS, Actor, Json, make_sensors
from swarmwright.servers.broker.client import TO_TOOL, Failure, Message

REPLY = re.compile(f"{re.escape(TO_TOOL)}[A-Za-z0-9_-]{{1,200}}")


class Offloading(Actor):
    """Evaluates controllers; the fitness of each is the mean of its weights."""

    modes = ("stepwise", "offloaded")

    def describe_capabilities(self) -> Json:
        """Announce offloaded evaluation and batches of four."""
        return {"modes": list(self.modes), "controllers": list(KINDS), "batch": 4}

    def on_request(self, message: Message) -> None:
        """Check a request and answer it."""
        try:
            request = decode_message(message)
            self.stage.record.requests.append(request)
            self.serve(request)
        except Failure as failure:
            self.stage.record.wrong.append(failure)

    def serve(self, request: Json) -> None:
        """Evaluate the request's controllers."""
        if request.get("kind") == "evaluate":
            weights, seeds = check_request(request, self.stage.title_for(request))
            self.stage.record.evaluated += len(weights) * len(seeds)
            fitness = np.repeat(weights.astype(np.float64).mean(axis=1), len(seeds))
            self.reply(request, fitness=fitness.tobytes(), seconds=0.0)

    def reply(self, request: Json, **fields: Any) -> None:  # noqa: ANN401 - MessagePack
        """Publish the answer to a request."""
        kind = "evaluated" if request["kind"] == "evaluate" else "sensors"
        message = {"kind": kind, "version": 1, "request": request["request"], "server": self.server, **fields}
        payload = msgpack.packb(message)
        correlation = request["request"].to_bytes(8, "big")
        self.stage.client.publish(request["reply"], payload, correlation=correlation)


def check_request(request: Json, title: object) -> tuple[np.ndarray, np.ndarray]:
    """Return the weights (candidates, weights) and seeds of a request. Raises Failure if it is invalid."""
    envelope(request, title)
    brief = str({key: value for key, value in request.items() if not isinstance(value, bytes)})
    controller = request.get("controller")
    if not isinstance(controller, dict) or "weights" in controller:
        raise Failure(brief, '"controller" is a specification without weights')
    try:
        size = _engine.genome_size(controller)
    except _engine.InputError as error:
        raise Failure(f"controller {controller}: {error}", "a specification of protocol/schemas") from None
    numbers = array(request, "genomes", "<f4")
    if len(numbers) % size or not len(numbers) or not np.isfinite(numbers).all():
        came = f"{len(numbers)} numbers in genomes, finite or not, for a controller of {size} weights"
        raise Failure(came, f"finite numbers, a multiple of {size}")
    for key, least in (("attempt", 0), ("lease", 0)):
        if not isinstance(request.get(key), int | float) or request[key] < least:
            raise Failure(brief, f'"{key}" is a number from {least}')
    return numbers.reshape(-1, size), array(request, "seeds", "<u8")


def envelope(request: Json, title: object) -> None:
    """Check the fields that all requests share. Raises Failure if one is wrong."""
    brief = str({key: value for key, value in request.items() if not isinstance(value, bytes)})
    if request.get("version") != 1 or not isinstance(request.get("request"), int):
        raise Failure(brief, '"version" is 1, "request" a number')
    if not isinstance(request.get("tool"), str) or not REPLY.fullmatch(str(request.get("reply"))):
        raise Failure(brief, f'"tool" is text, "reply" {TO_TOOL} and letters, digits, - or _')
    if request.get("simulation") != title or not isinstance(request.get("parameters"), dict):
        raise Failure(brief, f'"simulation" is {title!r}, "parameters" an object')
    if not len(array(request, "seeds", "<u8")):
        raise Failure(brief, "one seed at least")


def array(request: Json, key: str, kind: str) -> np.ndarray:
    """Return a binary array of a request. Raises Failure if it is invalid."""
    value = request.get(key)
    if not isinstance(value, bytes) or len(value) % np.dtype(kind).itemsize:
        raise Failure(f'"{key}" is {value!r}', f"MessagePack binary of {np.dtype(kind).name}")
    return np.frombuffer(value, dtype=kind)


class Batching(Offloading):
    """Steps batches of up to four episodes."""

    modes = ("stepwise", "batched")

    def __init__(self, server: int) -> None:
        super().__init__(server)
        self.batch: Json | None = None
        self.step = 0

    def serve(self, request: Json) -> None:
        """Start a batch, or advance it by a step."""
        if request.get("kind") == "start":
            envelope(request, self.stage.title_for(request))
            if len(array(request, "seeds", "<u8")) > 4:
                raise Failure(f"{len(request['seeds']) // 8} episodes", "4 at most, as announced")
            self.batch, self.step = request, 0
            self.tell()
        elif request.get("kind") == "actuators" and self.batch is not None:
            self.take(request, self.batch)

    def take(self, request: Json, batch: Json) -> None:
        """Check actuators and continue the batch."""
        values = array(request, "actuators", "<f4")
        if not len(values):
            self.batch = None
            return
        rows = len(batch["seeds"]) // 8 * AGENTS
        if request.get("request") != batch["request"] or request.get("step") != self.step:
            raise Failure(
                f"request {request.get('request')}, step {request.get('step')}",
                f"{batch['request']}, {self.step}",
            )
        if len(values) != rows * self.stage.actuators or not (np.abs(values) <= 1).all():
            came = f"{len(values)} actuators up to {np.abs(values).max()}"
            raise Failure(came, f"{rows} rows of {self.stage.actuators}, from -1 to +1")
        self.step += 1
        self.tell()

    def tell(self) -> None:
        """Send the sensors of the step, or the fitness of all episodes."""
        assert self.batch is not None
        episodes = np.arange(len(self.batch["seeds"]) // 8, dtype="<u4")
        over = self.step == STEPS
        rows = np.empty(0, dtype="<u4") if over else np.repeat(episodes, AGENTS)
        values = np.array(make_sensors(self.step, self.stage.sensors), dtype="<f4")
        self.reply(
            self.batch,
            step=self.step,
            episodes=rows.tobytes(),
            agents=np.tile(np.arange(AGENTS, dtype="<u4"), len(rows) // AGENTS).tobytes(),
            sensors=np.tile(values, len(rows)).astype("<f4").tobytes(),
            ended=episodes.tobytes() if over else b"",
            fitness=np.zeros(len(episodes)).tobytes() if over else b"",
        )
        if over:
            self.stage.record.evaluated += len(episodes)
            self.batch = None


OTHER_MODES: dict[str, type[Offloading]] = {"offloaded": Offloading, "batched": Batching}
"""The simulated server that offers each mode; the mode is also the scene's name."""
