"""An optimization tool that keeps every rule, and others that break one each.

`python -m tests.conformance.broken.tools NAME BROKER`. `breaks` names the rules that must catch it, and no
other. It evaluates four candidates, each in two episodes, on all servers that answer, and names itself.
"""

import json
import math
import signal
import sys
import time
from dataclasses import dataclass, field
from typing import Any, ClassVar

import msgpack
import numpy as np
from paho.mqtt.client import Client, MQTTMessage, MQTTv5
from paho.mqtt.enums import CallbackAPIVersion

from swarmwright import _engine

Json = dict[str, Any]
TOOL = "a tool of the tests"
CONTROLLER = {"version": 1, "kind": "fully_meshed", "hidden": 1, "activation": "tanh", "iterations": 2}
TITLE = "conformance"
PATIENCE = 1.0


class Refused(Exception):  # noqa: N818
    """A message that is not taken."""


@dataclass
class Running:
    """An episode under way."""

    server: int
    candidate: int
    episode: int
    controllers: dict[int, Any] = field(default_factory=dict)
    since: float = field(default_factory=time.monotonic)


class SoundTool:
    """See above. What others break are methods of one purpose each."""

    breaks: ClassVar[set[str]] = set()

    def __init__(self, url: str) -> None:
        self.work = [(candidate, episode) for candidate in range(4) for episode in range(2)]
        self.running: dict[str, Running] = {}
        self.known: dict[int, Json] = {}
        self.used: dict[int, str] = {}
        self.count = 0
        self.over = False
        self.listening = False
        self.asked = ""
        self.next_question = 0.0
        self.client = Client(CallbackAPIVersion.VERSION2, protocol=MQTTv5)
        self.client.reconnect_delay_set(1, 1)
        self.client.on_message = self._on_message
        self.client.on_connect = self._on_connect
        self.client.on_subscribe = self._on_subscribe
        host, _, port = url.removeprefix("mqtt://").rpartition(":")
        self.client.connect(host, int(port))

    def _on_connect(self, client: Client, *_: object) -> None:
        client.subscribe([(topic, 0) for topic in ("server", "sensor", "fitness")])

    def _on_subscribe(self, *_: object) -> None:
        self.listening = True

    def _on_message(self, _client: Client, _data: object, message: MQTTMessage) -> None:
        try:
            content = self.read(message)
            getattr(self, f"on_{message.topic}")(content)
        except (Refused, KeyError, TypeError):
            pass

    def read(self, message: MQTTMessage) -> Json:
        try:
            content = json.loads(message.payload)
        except (ValueError, RecursionError):
            raise Refused from None
        if not isinstance(content, dict) or message.retain or not self.is_right(content):
            raise Refused
        return content

    def is_right(self, content: Json) -> bool:
        return bool(content.get("simulation", TITLE) == TITLE)

    def send(self, topic: str, **fields: Any) -> None:
        self.client.publish(topic, json.dumps(fields))

    # The run.

    def run(self) -> None:
        """Until everything has been evaluated, or SIGINT."""
        signal.signal(signal.SIGINT, lambda *_: setattr(self, "over", True))
        while not self.over and (self.work or self.running):
            if self.client.loop(0.02):
                time.sleep(0.1)
                self.client.reconnect()
            now = time.monotonic()
            for hash_, running in list(self.running.items()):
                if now > running.since + PATIENCE:
                    self.give_up(hash_)
            # An answer that comes before the subscription is lost, and some ask only once.
            if self.listening and now > self.next_question and self.work:
                self.ask()
            self.start()
        self.give_back()
        deadline = time.monotonic() + 0.1
        while time.monotonic() < deadline:
            self.client.loop(0.02)

    def ask(self) -> None:
        """Look for servers, again every half second."""
        self.next_question = time.monotonic() + 0.5
        self.asked = self.new_hash()
        self.send(
            "discovery", simulation=TITLE, simulation_hash=self.asked, requirements=self.needs(), tool=TOOL
        )

    def needs(self) -> Json:
        return {"dimensions": 2}

    def new_hash(self) -> str:
        self.count += 1
        return f"episode {self.count} of {TOOL}"

    def on_server(self, content: Json) -> None:
        if self.is_answer(content):
            self.known[content["server"]] = content["capabilities"]["swarmwright"]

    def is_answer(self, content: Json) -> bool:
        return bool(content["simulation_hash"] == self.asked)

    def start(self) -> None:
        """Give work to all servers that have none."""
        busy = {running.server for running in self.running.values()}
        for server in self.known.keys() - busy:
            if not self.work:
                return
            candidate, episode = self.work.pop(0)
            hash_ = self.new_hash()
            self.running[hash_] = Running(server, candidate, episode)
            self.used[server] = hash_
            self.begin(server, hash_)

    def begin(self, server: int, hash_: str) -> None:
        self.send("parameters", server=server, simulation_hash=hash_)
        self.send("control", server=server, simulation_hash=hash_, run=True, tool=TOOL)

    def give_up(self, hash_: str) -> None:
        """The server is gone: somebody else gets the episode, as soon as it answers again."""
        running = self.running.pop(hash_)
        self.known.pop(running.server, None)
        self.work.insert(0, (running.candidate, running.episode))
        self.send("control", server=running.server, simulation_hash=hash_, run=False, tool=TOOL)
        self.next_question = 0.0

    def give_back(self) -> None:
        for server, hash_ in self.used.items():
            self.send("control", server=server, simulation_hash=hash_, run=False, tool=TOOL)

    # Steps.

    def on_sensor(self, content: Json) -> None:
        hash_ = content["simulation_hash"]
        running = self.running[hash_]
        agent, sensors = self.checked(content, running)
        running.since = time.monotonic()
        values = self.act(running, agent, np.array(sensors, dtype=np.float32))
        self.answer(hash_, agent, values)

    def checked(self, content: Json, running: Running) -> tuple[int, list[float]]:
        agent, sensors = content["agent"], content["sensor"]
        if type(agent) is not int or agent < 0 or not isinstance(sensors, list):
            raise Refused
        if len(sensors) != self.known[running.server]["sensors"]:
            raise Refused
        if not all(type(value) in (int, float) and math.isfinite(value) for value in sensors):
            raise Refused
        return agent, sensors

    def act(self, running: Running, agent: int, sensors: np.ndarray) -> list[float]:
        controller = self.controller(running, agent)
        return [float(str(value)) for value in controller.step(sensors)]

    def controller(self, running: Running, agent: int) -> Any:
        if agent not in running.controllers:
            running.controllers[agent] = self.make(running)
        return running.controllers[agent]

    def make(self, running: Running) -> Any:
        sizes = {key: self.known[running.server][key] for key in ("sensors", "actuators")}
        specification = {**CONTROLLER, **sizes, "output_range": [-1, 1]}
        size = _engine.genome_size(specification)
        weights = np.random.default_rng(running.candidate).uniform(-2, 2, size)
        return _engine.Controller(json.dumps({**specification, "weights": weights.tolist()}))

    def answer(self, hash_: str, agent: int, values: list[float]) -> None:
        self.send("actuator", simulation_hash=hash_, agent=agent, actuator=values)

    def on_fitness(self, content: Json) -> None:
        hash_ = content["simulation_hash"]
        self.result(content["fitness"])
        del self.running[hash_]

    def result(self, value: object) -> None:
        if type(value) not in (int, float) or not math.isfinite(value):  # type: ignore[arg-type]
            raise Refused


class NoDimensions(SoundTool):
    """Requires nothing."""

    breaks: ClassVar = {"O1.1"}

    def needs(self) -> Json:
        return {"dimensions": "2"}


class AsksEverybody(SoundTool):
    """Takes servers that have answered others."""

    breaks: ClassVar = {"O4.3"}

    def is_answer(self, content: Json) -> bool:
        return bool(content["simulation_hash"])


class AsksOnce(SoundTool):
    """Does not ask again."""

    breaks: ClassVar = {"O1.3"}

    def ask(self) -> None:
        super().ask()
        self.next_question = 1e12


class ControlFirst(SoundTool):
    """Starts, then configures, then starts again."""

    breaks: ClassVar = {"O2.1"}

    def begin(self, server: int, hash_: str) -> None:
        self.send("control", server=server, simulation_hash=hash_, run=True, tool=TOOL)
        super().begin(server, hash_)


class RunsText(SoundTool):
    """Puts truth in quotes."""

    breaks: ClassVar = {"O2.2"}

    def begin(self, server: int, hash_: str) -> None:
        self.send("parameters", server=server, simulation_hash=hash_)
        self.send("control", server=server, simulation_hash=hash_, run="true", tool=TOOL)


class Retains(SoundTool):
    """Sets the retain flag of control."""

    breaks: ClassVar = {"O2.4"}

    def begin(self, server: int, hash_: str) -> None:
        fields = {"server": server, "simulation_hash": hash_, "run": True, "tool": TOOL}
        self.send("parameters", server=server, simulation_hash=hash_)
        self.client.publish("control", json.dumps(fields), retain=True)


class AnswersTwice(SoundTool):
    """To be sure."""

    breaks: ClassVar = {"O3.1"}

    def answer(self, hash_: str, agent: int, values: list[float]) -> None:
        super().answer(hash_, agent, values)
        super().answer(hash_, agent, values)


class OneTooMany(SoundTool):
    """Adds an actuator."""

    breaks: ClassVar = {"O3.2"}

    def answer(self, hash_: str, agent: int, values: list[float]) -> None:
        super().answer(hash_, agent, [*values, 0.0])


class TooStrong(SoundTool):
    """Does not limit its actuators."""

    breaks: ClassVar = {"O3.3"}

    def answer(self, hash_: str, agent: int, values: list[float]) -> None:
        super().answer(hash_, agent, [3 * value for value in values])


class OneForAll(SoundTool):
    """Agents share a controller, and its state."""

    breaks: ClassVar = {"O3.4"}

    def controller(self, running: Running, agent: int) -> Any:
        return super().controller(running, 0 * agent)


class NeverResets(SoundTool):
    """Keeps the controllers of a candidate from one episode to the next."""

    breaks: ClassVar = {"O3.5"}
    kept: ClassVar[dict[tuple[int, int], Any]] = {}

    def start(self) -> None:
        """One episode at a time."""
        if not self.running and self.known:
            self.known = dict([min(self.known.items())])
            super().start()

    def controller(self, running: Running, agent: int) -> Any:
        key = (running.candidate, agent)
        if key not in self.kept:
            self.kept[key] = self.make(running)
        return self.kept[key]


class DiesOfJunk(SoundTool):
    """Does not catch what its JSON reader throws."""

    breaks: ClassVar = {"O4.1"}

    def read(self, message: MQTTMessage) -> Json:
        json.loads(message.payload)
        return super().read(message)


class AnswersAnything(SoundTool):
    """Takes what is no number for 0."""

    breaks: ClassVar = {"O4.2"}

    def checked(self, content: Json, running: Running) -> tuple[int, list[float]]:
        sensors = content["sensor"]
        if isinstance(sensors, list):
            sensors = [value if type(value) is float and math.isfinite(value) else 0.0 for value in sensors]
        return super().checked({**content, "sensor": sensors}, running)


class TakesNaN(SoundTool):
    """Takes any fitness."""

    breaks: ClassVar = {"O4.4"}

    def result(self, value: object) -> None:
        pass


class WaitsForEver(SoundTool):
    """Trusts that servers always answer."""

    breaks: ClassVar = {"O5.1", "O5.2", "O5.3"}

    def give_up(self, hash_: str) -> None:
        self.running[hash_].since = 1e12


class KeepsItsServers(SoundTool):
    """Just ends."""

    breaks: ClassVar = {"O7.1", "O7.2"}

    def give_back(self) -> None:
        pass


class SameHash(SoundTool):
    """Has one hash for all that it does."""

    breaks: ClassVar = {"O2.3"}

    def begin(self, server: int, hash_: str) -> None:
        others = [running for running in self.running.values() if running.server != server]
        super().begin(server, next((self.used[one.server] for one in others), hash_))


class NegativeAgents(SoundTool):
    """Takes any integer for an agent."""

    breaks: ClassVar = {"O4.6"}

    def checked(self, content: Json, running: Running) -> tuple[int, list[float]]:
        agent = content["agent"]
        found = abs(agent) if type(agent) is int else agent
        return agent, super().checked({**content, "agent": found}, running)[1]


class ReliesOnSimulation(SoundTool):
    """Wants the title in every message."""

    breaks: ClassVar = {"O4.7"}

    def checked(self, content: Json, running: Running) -> tuple[int, list[float]]:
        if content["simulation"] != TITLE:
            raise Refused
        return super().checked(content, running)


class TakesAnyTitle(SoundTool):
    """Tells episodes apart by the hash alone."""

    breaks: ClassVar = {"O4.8"}

    def is_right(self, content: Json) -> bool:  # noqa: ARG002
        return True


class ConfiguresOnce(SoundTool):
    """Sends parameters before the first episode of a server only, and keeps the hash."""

    breaks: ClassVar = {"O2.1"}

    def start(self) -> None:
        """As the model, with a hash for each server."""
        busy = {running.server for running in self.running.values()}
        for server in self.known.keys() - busy:
            if not self.work:
                return
            hash_ = f"server {server}"
            self.running[hash_] = Running(server, *self.work.pop(0))
            if server not in self.used:
                self.send("parameters", server=server, simulation_hash=hash_)
            self.used[server] = hash_
            self.send("control", server=server, simulation_hash=hash_, run=True, tool=TOOL)


class ReadsDoubles(SoundTool):
    """Computes with what agents sense as JSON has it, in binary64."""

    breaks: ClassVar = {"O3.7"}
    rest = 0.0

    def checked(self, content: Json, running: Running) -> tuple[int, list[float]]:
        agent, sensors = super().checked(content, running)
        self.rest = sum(sensors) - sum(float(np.float32(value)) for value in sensors)
        return agent, sensors

    def act(self, running: Running, agent: int, sensors: np.ndarray) -> list[float]:
        return [0.5 * value + self.rest for value in super().act(running, agent, sensors)]


TOOLS: list[type[SoundTool]] = SoundTool.__subclasses__()


class OnlyOffloads(SoundTool):
    """Sends controllers to servers, and plays no episode itself."""

    mode = "offloaded"
    topic = "swarmwright/v1/tool/t1"

    def __init__(self, url: str) -> None:
        self.requests: dict[int, str] = {}
        super().__init__(url)

    def _on_connect(self, client: Client, *_: object) -> None:
        client.subscribe([(topic, 0) for topic in ("server", self.topic)])

    def _on_message(self, client: Client, data: object, message: MQTTMessage) -> None:
        if message.topic == self.topic:
            self.answered(msgpack.unpackb(message.payload))
        else:
            super()._on_message(client, data, message)

    def on_server(self, content: Json) -> None:
        if self.mode in content["capabilities"]["swarmwright"]["modes"]:
            super().on_server(content)

    def begin(self, server: int, hash_: str) -> None:
        self.requests[self.count] = hash_
        self.request(server, **self.work_of(self.running[hash_], server))

    def request(self, server: int, number: int | None = None, **fields: Any) -> None:
        number = self.count if number is None else number
        head = {"version": 1, "request": number, "tool": TOOL, "reply": self.topic}
        self.client.publish(f"swarmwright/v1/server/{server}", msgpack.packb({**head, **fields}))

    def work_of(self, running: Running, server: int) -> Json:
        sizes = {key: self.known[server][key] for key in ("sensors", "actuators")}
        controller = {**CONTROLLER, **sizes, "output_range": [-1, 1]}
        weights = np.full(_engine.genome_size(controller), running.candidate, "<f4")
        more = {"controller": controller, "genomes": weights.tobytes(), "attempt": 1, "lease": 0.0}
        return {"kind": "evaluate", **self.episodes(running), **more}

    def episodes(self, running: Running) -> Json:
        seeds = np.array([running.episode], "<u8").tobytes()
        return {"simulation": TITLE, "parameters": {}, "seeds": seeds}

    def answered(self, answer: Json) -> None:
        running = self.running.pop(self.requests[answer["request"]], None)
        if running is not None and "error" in answer:
            self.refused(running)

    def refused(self, running: Running) -> None:
        self.work.insert(0, (running.candidate, running.episode))


class LosesRefusedWork(OnlyOffloads):
    """Takes what a server refuses for evaluated."""

    breaks: ClassVar = {"O6.2"}

    def refused(self, running: Running) -> None:
        pass


class FailsAtOnce(OnlyOffloads):
    """Asks, and ends with an error before anything is evaluated."""

    breaks: ClassVar = {"O6.1"}

    def request(self, server: int, number: int | None = None, **fields: Any) -> None:
        super().request(server, number, **fields)
        if number is None:
            sys.exit("no evaluation")


class OnlyBatches(OnlyOffloads):
    """Steps batches only."""

    mode = "batched"

    def work_of(self, running: Running, server: int) -> Json:  # noqa: ARG002
        return {"kind": "start", **self.episodes(running)}

    def answered(self, answer: Json) -> None:
        rows = len(answer["episodes"]) // 4
        if not rows:
            super().answered(answer)
            return
        count = self.known[answer["server"]]["actuators"]
        fields = {"kind": "actuators", "step": answer["step"], "actuators": bytes(4 * rows * count)}
        self.request(answer["server"], answer["request"], **fields)


class LeastTool(AsksOnce):
    """Does what D6.1 demands, and in all else what Swarmwright's own tool does not.

    It asks once, names itself nowhere, takes servers for what it expects, wants `simulation` in sensor
    messages, and takes NaN for a number.
    """

    breaks: ClassVar = set()

    def send(self, topic: str, **fields: Any) -> None:
        super().send(topic, **{key: value for key, value in fields.items() if key != "tool"})

    def on_server(self, content: Json) -> None:
        if self.is_answer(content):
            self.known[content["server"]] = {"sensors": 3, "actuators": 2}

    def checked(self, content: Json, running: Running) -> tuple[int, list[float]]:  # noqa: ARG002
        agent, sensors = content["agent"], content["sensor"]
        if type(agent) is not int or not isinstance(sensors, list) or content["simulation"] != TITLE:
            raise Refused
        if len(sensors) != 3 or not all(type(value) in (int, float) for value in sensors):
            raise Refused
        return agent, sensors

    def result(self, value: object) -> None:
        if type(value) not in (int, float):
            raise Refused

    def give_back(self) -> None:
        pass


if __name__ == "__main__":
    kinds: list[type[SoundTool]] = [SoundTool, *TOOLS]
    of_one_mode = (OnlyOffloads, OnlyBatches, LosesRefusedWork, FailsAtOnce)
    named = {kind.__name__: kind for kind in (*kinds, LeastTool, *of_one_mode)}
    named[sys.argv[1]](sys.argv[2]).run()
