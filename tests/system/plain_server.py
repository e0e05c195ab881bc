"""A simulation server that knows D6.1 and nothing else: agents on a line that shall meet at 0."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from tests.system.peer import Peer, Received

Json = dict[str, Any]
TITLE = "toy"


@dataclass
class Toy:
    """Agents on a line. Sensors: own place, the others' mean place, each / 10. Actuator: a step of -1..1.

    Fitness: minus the sum of the distances to 0. An agent within 0.5 of 0 has arrived and acts no more.
    """

    starts: list[float]
    steps: int
    places: list[float] = field(init=False)
    step: int = 0

    def __post_init__(self) -> None:
        self.places = list(self.starts)

    @property
    def acting(self) -> list[int]:
        if self.step >= self.steps:
            return []
        return [agent for agent, place in enumerate(self.places) if abs(place) > 0.5]

    def sense(self, agent: int) -> list[float]:
        mean = sum(self.places) / len(self.places)
        return [float(np.float32(self.places[agent] / 10)), float(np.float32(mean / 10))]

    def move(self, actuators: dict[int, float]) -> None:
        for agent, actuator in actuators.items():
            self.places[agent] += float(np.float32(min(1.0, max(-1.0, actuator))))
        self.step += 1

    @property
    def fitness(self) -> float:
        return -sum(abs(place) for place in self.places)

    @property
    def metrics(self) -> Json:
        """How many agents have arrived, after how many steps; the mean place, null unless above 0."""
        mean = sum(self.places) / len(self.places)
        return {
            "met": sum(abs(place) <= 0.5 for place in self.places),
            "steps": self.step,
            "mean": mean if mean > 0 else None,
        }


class PlainServer(Peer):
    """Offers the toy. `title`, `capabilities` are what it announces; subclasses misbehave."""

    def __init__(
        self,
        url: str,
        server: int = 4711,
        *,
        title: str = TITLE,
        capabilities: Json | None = None,
        version: int = 5,
    ) -> None:
        self.server = server
        self.title = title
        self.capabilities = {"dimensions": 1} if capabilities is None else capabilities
        self.episodes = 0
        self.controls: list[Json] = []
        self._hash: str | None = None
        self._parameters: Json = {}
        self._toy: Toy | None = None
        self._actuators: dict[int, float] = {}
        super().__init__(url, "discovery", "parameters", "control", "actuator", version=version)

    def received(self, message: Received) -> None:
        """Answer, in the client's thread."""
        content = message.json
        if message.topic == "discovery":
            self.discovered(content)
        elif message.topic == "parameters" and content["server"] == self.server:
            self._hash, self._parameters = content["simulation_hash"], content
        elif message.topic == "control" and content["server"] == self.server:
            self.controls.append(content)
            self.controlled(content)
        elif message.topic == "actuator" and content["simulation_hash"] == self._hash:
            self.actuated(content)

    def discovered(self, content: Json) -> None:
        if content["simulation"] == self.title and self._hash is None:
            answer = {"simulations": [self.title], "capabilities": self.capabilities}
            self.send("server", server=self.server, simulation_hash=content["simulation_hash"], **answer)

    def controlled(self, content: Json) -> None:
        if content["simulation_hash"] != self._hash:
            return
        if not content.get("run", True):
            self._hash = self._toy = None
            return
        self._toy, self._actuators = Toy(self._parameters["starts"], self._parameters["steps"]), {}
        self.sense()

    def actuated(self, content: Json) -> None:
        assert self._toy is not None
        self._actuators[content["agent"]] = content["actuator"][0]
        if len(self._actuators) == len(self._toy.acting):
            self._toy.move(self._actuators)
            self._actuators = {}
            self.sense()

    def sense(self) -> None:
        """Send the sensors of all acting agents, or the fitness."""
        assert self._toy is not None
        for agent in self._toy.acting:
            self.send("sensor", simulation_hash=self._hash, agent=agent, sensor=self._toy.sense(agent))
        if not self._toy.acting:
            self.finish(self._toy.fitness)

    def finish(self, fitness: float) -> None:
        """Send the fitness; free again."""
        self.episodes += 1
        hash_, self._hash = self._hash, None
        self.send("fitness", simulation_hash=hash_, fitness=fitness, **self.extras())

    def extras(self) -> Json:
        """What goes with the fitness, beyond D6.1."""
        return {}


class MeasuringServer(PlainServer):
    """Steps only, as D6.1 has it, and announces and sends metrics besides."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        announcement = {"version": 1, "metrics": ["met", "steps", "mean"]}
        super().__init__(*arguments, **options, capabilities={"dimensions": 1, "swarmwright": announcement})

    def extras(self) -> Json:
        assert self._toy is not None
        return {"metrics": self._toy.metrics}
