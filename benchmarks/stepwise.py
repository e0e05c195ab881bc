"""Stepwise evaluation: the optimization tool's pool in this process, Minisim servers in others."""

import random
import time
from dataclasses import dataclass
from typing import Any

import numpy as np
import paho.mqtt.client as mqtt
from numpy.typing import NDArray
from paho.mqtt.enums import CallbackAPIVersion

from benchmarks.processes import PATIENCE, Broker
from swarmwright import _engine
from swarmwright.servers.rows import Journal

ARCHITECTURE: dict[str, Any] = {
    "version": 1,
    "kind": "layered",
    "sensors": 4,
    "actuators": 1,
    "hidden": [8],
    "activation": "tanh",
    "output_range": [-1, 1],
}
"""4-8-1 networks."""


@dataclass(frozen=True)
class Evaluation:
    """What a block of episodes took. episode_seconds: from its parameters message to its fitness, summed."""

    agent_steps: int
    steps: int
    episodes: int
    seconds: float
    episode_seconds: float


class Stepwise:
    """A pool on one broker, under one prefix, that is to use `servers` servers.

    agents, steps: of every episode. Nobody arrives and nobody is caught, so that each takes all its steps:
    the map is large, the agents are slow, there is no defender.
    """

    def __init__(self, broker: Broker, prefix: str, servers: int, agents: int, steps: int) -> None:
        self._agents = agents
        self._parameters = {
            "mapWidth": 10_000,
            "mapHeight": 10_000,
            "numAgents": agents,
            "numDefenders": 0,
            "speedAgents": 0.01,
            "maxSteps": steps,
        }
        self._pool = _engine.Pool(
            broker.url,
            simulation="minisim",
            parameters=self._parameters,
            requirements={"dimensions": 2},
            prefix=prefix,
            tool="bench",
            mode="stepwise",
        )
        self._servers = servers
        self._pool.wait_for_server()

    def evaluate(self, episodes: int) -> Evaluation:
        """Run a block of episodes, whose fitness must be that of the same episodes without a broker.

        A block that begins before all servers have answered discovery does not count.
        """
        deadline = time.monotonic() + PATIENCE
        while True:
            done, used = self._block(episodes)
            if used == self._servers:
                return done
            if time.monotonic() > deadline:
                raise SystemExit(f"{used} servers took part, {self._servers} were to")

    def _block(self, episodes: int) -> tuple[Evaluation, int]:
        """A block, and how many servers took part."""
        genomes = _genomes(episodes)
        start = time.perf_counter()
        fitness, _, rows, _ = self._pool.evaluate(ARCHITECTURE, genomes, [0])
        seconds = time.perf_counter() - start
        expected, _ = _engine.evaluate("minisim", self._parameters, ARCHITECTURE, genomes, [0])
        if fitness.tobytes() != expected.tobytes():
            raise SystemExit("stepwise evaluation and a rollout in this process give different fitness")
        attempts = Journal.from_fields(rows, []).attempts
        steps = sum(attempt.steps or 0 for attempt in attempts)
        done = Evaluation(
            agent_steps=steps * self._agents,
            steps=steps,
            episodes=len(attempts),
            seconds=seconds,
            episode_seconds=sum(attempt.seconds for attempt in attempts),
        )
        return done, len({attempt.server for attempt in attempts})

    def close(self) -> None:
        """Free the servers."""
        self._pool.close()


def message_sizes(broker: Broker, prefix: str) -> tuple[int, int]:
    """Mean bytes of a sensor and of an actuator message of an episode, as they cross the broker."""
    seen: dict[str, list[int]] = {"sensor": [], "actuator": []}
    client = mqtt.Client(CallbackAPIVersion.VERSION2, protocol=mqtt.MQTTv5)
    client.on_message = lambda _client, _data, message: seen[message.topic.rsplit("/", 1)[-1]].append(
        len(message.payload)
    )
    subscribed: list[bool] = []
    client.on_subscribe = lambda *_: subscribed.append(True)
    client.connect("127.0.0.1", broker.port)
    client.subscribe([(f"{prefix}/sensor", 0), (f"{prefix}/actuator", 0)])
    client.loop_start()
    while not subscribed:
        time.sleep(0.01)
    pool = Stepwise(broker, prefix, servers=1, agents=1, steps=200)
    pool.evaluate(1)
    pool.close()
    time.sleep(0.2)
    client.disconnect()
    client.loop_stop()
    sensor, actuator = (round(sum(sizes) / len(sizes)) for sizes in seen.values())
    return sensor, actuator


def _genomes(count: int) -> NDArray[np.float32]:
    """Random weights of as many networks, the same ones every time."""
    source = random.Random(1)
    weights = [[source.uniform(-2, 2) for _ in range(49)] for _ in range(count)]
    return np.array(weights, dtype=np.float32)
