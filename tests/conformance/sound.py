"""A simulation server in Python that keeps every rule, so that others can break one each.

It has presence, metrics, offloaded evaluation and control on its own topic. Its world: agents on a line that
shall meet at 0.
"""

import json
import math
import queue
import socket
import threading
import time
from collections.abc import Callable
from typing import Any

import msgpack
import numpy as np
from paho.mqtt.client import Client, MQTTMessage, MQTTv5
from paho.mqtt.enums import CallbackAPIVersion
from paho.mqtt.packettypes import PacketTypes
from paho.mqtt.properties import Properties

from swarmwright import _engine

Json = dict[str, Any]
PATIENCE = 5.0
STAMP = "2026-01-31T12:00:00Z"


class Refused(Exception):  # noqa: N818
    """A message that is not taken; says why."""


class Invalid(Refused):
    """A request that cannot be served."""


class World:
    """Agents on a line that shall meet at 0. Sensors: own place, the mean place. Actuator: a step."""

    def __init__(self, parameters: Json) -> None:
        agents = parameters.get("agents", 3)
        self.steps = parameters.get("steps", 6)
        generator = np.random.default_rng(int(parameters.get("seed", 0)))
        self.places = np.array(generator.uniform(-5, 5, agents), dtype=np.float32)
        self.step_number = 0

    def acting(self) -> list[int]:
        """Agents near 0 have arrived."""
        if self.step_number >= self.steps:
            return []
        return [agent for agent, place in enumerate(self.places) if abs(place) > 0.1]

    def sense(self, agent: int) -> list[float]:
        return [float(str(self.places[agent])), float(str(self.places.mean(dtype=np.float32)))]

    def step(self, actuators: dict[int, list[float]]) -> None:
        for agent, values in actuators.items():
            self.places[agent] += np.float32(values[0])
        self.step_number += 1

    def fitness(self) -> float:
        return -float(np.abs(self.places).astype(np.float64).sum())

    def metrics(self) -> dict[str, float]:
        arrived = float((np.abs(self.places) <= 0.1).sum())
        return {"arrived": arrived, "steps": float(self.step_number)}


class Robots(World):
    """Robots with two wheels on a line, which sense what machines of modules need."""

    def __init__(self, parameters: Json) -> None:
        super().__init__({"steps": 16, **parameters})
        self.generator = np.random.default_rng(int(parameters.get("seed", 0)))
        self.seen = self.look()

    def look(self) -> Any:
        seen = self.generator.uniform(-1, 1, (len(self.places), 9)).astype(np.float32)
        seen[:, 4] = np.floor(seen[:, 8] * 1.5 + 1.5) / 2
        seen[:, 5] = np.floor(np.abs(self.places))
        seen[:, 8] = np.abs(seen[:, 8])
        return seen

    def acting(self) -> list[int]:
        return list(range(len(self.places))) if self.step_number < self.steps else []

    def sense(self, agent: int) -> list[float]:
        return [float(str(value)) for value in self.seen[agent]]

    def step(self, actuators: dict[int, list[float]]) -> None:
        for agent, (left, right) in actuators.items():
            self.places[agent] += np.float32(0.3) * np.float32(left) - np.float32(0.2) * np.float32(right)
        self.step_number += 1
        self.seen = self.look()


def whole(value: object) -> int:
    """An integer from 0, 1.0 too."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise Refused(f"{value!r} is no integer")
    if not math.isfinite(value) or value != int(value) or not 0 <= value < 2**63:
        raise Refused(f"{value!r} is no integer from 0")
    return int(value)


def reply_of(control: Json) -> str | None:
    """The topic on which a tool wants scenes."""
    reply = str(control.get("reply"))
    wanted = isinstance(control.get("scenes"), list) and reply.startswith("swarmwright/v1/tool/")
    return reply if wanted else None


def text(value: object) -> str:
    if not isinstance(value, str):
        raise Refused(f"{value!r} is no text")
    return value


def flag(value: object) -> bool:
    if not isinstance(value, bool):
        raise Refused(f"{value!r} is neither true nor false")
    return value


def real(value: object) -> float:
    """A number that is finite as binary32."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise Refused(f"{value!r} is no number")
    with np.errstate(over="ignore"):
        number = float(np.float32(value)) if abs(value) < 1e300 else math.inf
    if not math.isfinite(number):
        raise Refused(f"{value!r} is not finite")
    return number


def _no_constant(word: str) -> float:
    raise ValueError(word)


class SoundServer:
    """See above. What others break are methods of one purpose each."""

    title = "toy"
    controllers: tuple[str, ...] = (
        "layered", "fully_meshed", "mealy_fsm", "evostick", "hebbian", "neat", "growing",
    )  # fmt: skip
    sensors, actuators_of_an_agent = 2, 1

    def __init__(self, url: str, server: int = 1) -> None:
        self.server = server
        self.state = "free"  # configured, running, working, held
        self.until = 0.0
        self.holder: str | None = None
        self.hash: str | None = None
        self.world: World | None = None
        self.acting: list[int] = []
        self.actuators: dict[int, list[float]] = {}
        self.parameters: dict[str, Json] = {}
        self.newest: str | None = None
        self.early: tuple[Json, float] | None = None
        self.answered: set[str] = set()
        self.topic: str | None = None
        self.told: tuple[str, str | None] | None = None
        self.changed = 0.0
        self.over = False
        self.lock = threading.RLock()
        self.requests: queue.SimpleQueue[tuple[Json, float] | None] = queue.SimpleQueue()
        self.client = Client(CallbackAPIVersion.VERSION2, protocol=MQTTv5)
        self.client.reconnect_delay_set(1, 1)
        self.client.max_inflight_messages_set(1000)
        self.client.on_connect = self._on_connect
        self.client.on_message = self._on_message
        self.presence_topic = f"swarmwright/v1/presence/{server}"
        self.will()
        host, _, port = url.removeprefix("mqtt://").rpartition(":")
        self.client.connect(host, int(port))
        self.client.loop_start()
        self.threads = [threading.Thread(target=run, daemon=True) for run in (self._work, self._watch)]
        for thread in self.threads:
            thread.start()

    def close(self) -> None:
        self.over = True
        self.requests.put(None)
        self.client.disconnect()
        self.client.loop_stop()
        for thread in self.threads:
            thread.join(5)

    # Connection.

    def will(self) -> None:
        self.client.will_set(self.presence_topic, self.presence("lost", None), qos=1, retain=True)

    def prompt(self, client: Client) -> None:
        """Small messages need not wait for each other."""
        opened = client.socket()
        assert isinstance(opened, socket.socket)
        opened.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def _on_connect(self, client: Client, *_: object) -> None:
        self.prompt(client)
        topics = ["discovery", "parameters", "control", "actuator", f"swarmwright/v1/server/{self.server}"]
        client.subscribe([(topic, 0) for topic in topics])
        with self.lock:
            self.enter("free")
            self.told = None
            self.changed = 0.0
            self.tell()

    def _on_message(self, _client: Client, _data: object, message: MQTTMessage) -> None:
        with self.lock:
            try:
                self.receive(message)
            except (Refused, ValueError, KeyError, TypeError, RecursionError):
                self.refused()

    def refused(self) -> None:
        """What was refused changes nothing."""

    def receive(self, message: MQTTMessage) -> None:
        self.tick()
        if message.retain:
            raise Refused("retained")
        if message.topic.startswith("swarmwright/"):
            self.on_own_topic(bytes(message.payload))
            return
        content = self.read(bytes(message.payload))
        getattr(self, f"on_{message.topic}")(content)

    def on_own_topic(self, payload: bytes) -> None:
        if payload.startswith(b"{"):
            self.on_control(self.read(payload))
        else:
            self.requested(payload)

    def read(self, payload: bytes) -> Json:
        if len(payload) > 1 << 20:
            raise Refused("too large")
        value = json.loads(payload, parse_constant=_no_constant)
        if not isinstance(value, dict):
            raise Refused("no object")
        return value

    def publish(self, topic: str, **fields: Any) -> None:
        self.client.publish(topic, json.dumps(fields))

    # Who has it.

    def enter(self, state: str, holder: str | None = None) -> None:
        self.state, self.holder = state, holder
        self.until = time.monotonic() + self.patience()
        if state in {"free", "held"}:
            self.hash, self.world = None, None
        if not self.changed:
            self.changed = time.monotonic() + 0.15

    def patience(self) -> float:
        return PATIENCE

    def tick(self) -> None:
        if self.state in {"configured", "held"} and time.monotonic() >= self.until:
            self.enter("free")
        if self.changed and time.monotonic() >= self.changed:
            self.changed = 0.0
            self.tell()

    def _watch(self) -> None:
        while not self.over:
            time.sleep(0.02)
            with self.lock:
                self.tick()

    def is_free(self, tool: str | None) -> bool:
        return self.state == "free" or (self.state == "held" and tool == self.holder)

    def capabilities(self) -> Json:
        announcement = {
            "version": 1,
            "modes": ["stepwise", "offloaded"],
            "controllers": self.controllers,
            "sensors": self.sensors,
            "actuators": self.actuators_of_an_agent,
            "metrics": ["arrived", "steps"],
            "scenes": True,
            "control": True,
        }
        return {"dimensions": 1, "max_agents": 100, "swarmwright": announcement}

    def presence(self, state: str, tool: str | None) -> str:
        fields = {"version": 1, "server": self.server, "state": state, "since": STAMP}
        named = {"tool": tool} if tool else {}
        offer = {"simulations": [self.title], "capabilities": self.capabilities()}
        return json.dumps({**fields, **offer, **named})

    def tell(self) -> None:
        now = ("ready" if self.state == "free" else "busy", self.holder)
        if now != self.told:
            self.told = now
            self.client.publish(self.presence_topic, self.presence(*now), qos=1, retain=True)

    # Discovery, parameters, control.

    def on_discovery(self, content: Json) -> None:
        title, hash_ = text(content["simulation"]), text(content["simulation_hash"])
        required = content["requirements"]
        if not isinstance(required, dict):
            raise Refused("requirements")
        if self.is_free(content.get("tool")) and self.fits(title, required):
            self.answer(hash_)

    def fits(self, title: str, required: Json) -> bool:
        agents = required.get("max_agents", required.get("max agents", 0))
        return title == self.title and real(required["dimensions"]) == 1 and real(agents) <= 100

    def answer(self, hash_: str) -> None:
        fields = {"simulations": [self.title], "capabilities": self.capabilities()}
        self.publish("server", server=self.server, simulation_hash=hash_, **fields)

    def is_for_me(self, content: Json) -> bool:
        return whole(content["server"]) == self.server

    def on_parameters(self, content: Json) -> None:
        hash_ = text(content["simulation_hash"])
        if not self.is_for_me(content):
            return
        self.parameters[hash_] = content
        self.newest = hash_
        if self.state in {"free", "configured"}:
            self.enter("configured")
        if self.early and self.early[0]["simulation_hash"] == hash_ and time.monotonic() < self.early[1]:
            (control, _), self.early = self.early, None
            self.on_control(control)

    def keep(self, control: Json) -> None:
        """Control whose parameters have not come yet."""
        self.early = control, time.monotonic() + 1

    def on_control(self, content: Json) -> None:
        hash_, run = text(content["simulation_hash"]), flag(content.get("run", True))
        if not self.is_for_me(content):
            return
        tool = content.get("tool")
        if not run:
            self.early = None
            self.end(hash_, tool)
        elif not self.may_start(tool):
            self.reject()
        elif not self.offers(content) or self.was_answered(content):
            raise Refused("another title, or a repetition")
        elif hash_ not in self.parameters:
            self.keep(content)
        else:
            self.topic = reply_of(content)
            self.start(hash_, tool)

    def was_answered(self, content: Json) -> bool:
        """Tools that give reply use a hash once."""
        hash_ = content["simulation_hash"]
        known = hash_ in self.answered
        if "reply" in content and hash_ in self.parameters:
            self.answered.add(hash_)
        return known and "reply" in content

    def reject(self) -> None:
        """Another tool has it: it says so once more."""
        self.told = None
        self.tell()

    def offers(self, content: Json) -> bool:
        return bool(content.get("simulation", self.title) == self.title)

    def may_start(self, tool: str | None) -> bool:
        return self.state in {"free", "configured"} or (self.state == "held" and tool == self.holder)

    def start(self, hash_: str, tool: str | None) -> None:
        self.enter("running", tool)
        self.hash, self.world = hash_, self.make(self.parameters[hash_])
        self.sense()

    def make(self, parameters: Json) -> World:
        return World(parameters)

    def end(self, hash_: str, tool: str | None) -> None:
        ours = {
            "running": hash_ == self.hash and self.is_of(tool),
            "configured": hash_ == self.newest,
            "held": self.is_of(tool),
            "working": tool is not None and tool == self.holder,
        }
        if ours.get(self.state):
            self.enter("free")

    def is_of(self, tool: str | None) -> bool:
        return tool == self.holder

    # Steps.

    def sense(self) -> None:
        assert self.world is not None
        if self.topic:
            self.show(self.topic, self.picture(self.world))
        self.acting, self.actuators = self.world.acting(), {}
        if not self.acting:
            self.finish(self.world)
        for agent in self.acting:
            self.publish("sensor", simulation_hash=self.hash, agent=agent, sensor=self.world.sense(agent))

    def picture(self, world: World) -> Json:
        """The scene before a step, or at the end."""
        places = (world.places + 20).astype("<f4")
        head = {"kind": "scene", "version": 1, "server": self.server, "simulation_hash": self.hash}
        bodies = {"looks": [["agent", ""]], "x": places.tobytes(), "y": np.ones_like(places).tobytes()}
        return {**head, "step": world.step_number, "width": 40, "height": 2, "bodies": bodies}

    def show(self, topic: str, scene: Json) -> None:
        self.client.publish(topic, msgpack.packb(scene))

    def finish(self, world: World) -> None:
        hash_ = self.hash
        self.enter("held" if self.holder else "free", self.holder)
        self.send_fitness(hash_, world)

    def send_fitness(self, hash_: str | None, world: World) -> None:
        self.publish("fitness", simulation_hash=hash_, fitness=world.fitness(), metrics=self.measure(world))

    def measure(self, world: World) -> dict[str, float]:
        return world.metrics()

    def on_actuator(self, content: Json) -> None:
        agent = whole(content["agent"])
        if not self.is_mine(text(content["simulation_hash"])) or agent not in self.acting:
            return
        values = self.actuators_of(content["actuator"])
        if agent in self.actuators:
            raise Refused("a second answer")
        self.actuators[agent] = values
        if len(self.actuators) >= self.enough():
            assert self.world is not None
            self.world.step(self.actuators)
            self.sense()

    def is_mine(self, hash_: str) -> bool:
        return self.state == "running" and hash_ == self.hash

    def actuators_of(self, values: object) -> list[float]:
        if not isinstance(values, list) or len(values) != self.actuators_of_an_agent:
            raise Refused("the wrong number of actuators")
        return [self.clamp(real(value)) for value in values]

    def clamp(self, value: float) -> float:
        return max(-1.0, min(1.0, value))

    def enough(self) -> int:
        return len(self.acting)

    # Requests.

    def requested(self, payload: bytes) -> None:
        try:
            request = msgpack.unpackb(payload)
        except Exception as error:
            raise Refused("no MessagePack") from error
        if not isinstance(request, dict) or request.get("kind") != "evaluate":
            raise Refused("no request")
        if not text(request["reply"]).startswith("swarmwright/v1/tool/"):
            raise Refused("reply")
        tool = text(request["tool"])
        if not (self.is_free(tool) or (self.state == "working" and self.holder == tool)):
            self.reply(request, error={"kind": "taken", "reason": f"taken by {self.holder}"})
            return
        try:
            self.check(request)
        except (Refused, KeyError, ValueError, TypeError, _engine.InputError) as error:
            self.reply(request, error={"kind": "invalid", "reason": f"invalid: {error!r}"})
            return
        self.enter("working", tool)
        self.requests.put((request, time.monotonic()))

    def check(self, request: Json) -> None:
        if request["version"] != 1 or request["simulation"] != self.title:
            raise Invalid("version or simulation")
        if not isinstance(request["parameters"], dict):
            raise Invalid("parameters")
        controller = request["controller"]
        if (controller["sensors"], controller["actuators"]) != (self.sensors, self.actuators_of_an_agent):
            raise Invalid("controller")
        size = _engine.genome_size(controller)
        genomes = np.frombuffer(request["genomes"], "<f4")
        if len(genomes) % size or not np.isfinite(genomes).all():
            raise Invalid("genomes")
        if not len(np.frombuffer(request["seeds"], "<u8")):
            raise Invalid("seeds")
        unknown = set(request.get("metrics", [])) - {"arrived", "steps"}
        if unknown:
            raise Invalid(f"metrics: {unknown}")

    def _work(self) -> None:
        while (item := self.requests.get()) is not None:
            request, since = item
            if 0 < request["lease"] < time.monotonic() - since:
                self.reply(request, error={"kind": "failed", "reason": "the lease is over"})
            else:
                fitness, metrics = self.compute(request)
                named = {"metrics": {name: np.array(values).tobytes() for name, values in metrics.items()}}
                self.reply(request, fitness=np.array(fitness).tobytes(), **(named if metrics else {}))
            with self.lock:
                if self.requests.empty() and self.state == "working":
                    self.enter("held", self.holder)

    def compute(self, request: Json) -> tuple[list[float], dict[str, list[float]]]:
        size = _engine.genome_size(request["controller"])
        rows = np.frombuffer(request["genomes"], "<f4").reshape(-1, size)
        wanted = request.get("metrics", [])
        fitness: list[float] = []
        metrics: dict[str, list[float]] = {name: [] for name in wanted}
        for row in rows:
            specification = json.dumps({**request["controller"], "weights": row.astype(float).tolist()})
            for seed in np.frombuffer(request["seeds"], "<u8"):
                world = self.rollout(specification, {**request["parameters"], "seed": int(seed)})
                fitness.append(world.fitness())
                for name in wanted:
                    metrics[name].append(world.metrics()[name])
        return fitness, metrics

    def rollout(self, specification: str, parameters: Json) -> World:
        world = self.make(parameters)
        controllers: dict[int, _engine.Controller] = {}
        while acting := world.acting():
            actuators = {}
            for agent in acting:
                controller = controllers.setdefault(agent, _engine.Controller(specification))
                sensed = np.array(world.sense(agent), np.float32)
                actuators[agent] = [float(value) for value in controller.step(sensed)]
            world.step(actuators)
        return world

    def reply(self, request: Json, **fields: Any) -> None:
        properties = Properties(PacketTypes.PUBLISH)  # type: ignore[no-untyped-call]
        properties.CorrelationData = request["request"].to_bytes(8, "big")
        properties.ContentType = "application/msgpack"
        fields.setdefault("fitness", b"")
        message = {"kind": "evaluated", "version": 1, "request": request["request"], "server": self.server}
        payload = msgpack.packb({**message, "seconds": 0.0, **fields})
        self.client.publish(request["reply"], payload, properties=properties)


Make = Callable[[str], SoundServer]


class SoundRobots(SoundServer):
    """A sound server whose agents have what machines of modules need."""

    title = "robots"
    controllers = (*SoundServer.controllers, "modules")
    sensors, actuators_of_an_agent = 9, 2

    def make(self, parameters: Json) -> World:
        return Robots(parameters)
