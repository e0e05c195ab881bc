"""A simulation server that does what D6.1 demands, and in all else what Swarmwright's own servers do not.

`python tests/conformance/least.py BROKER ID`. It fulfils requirements of any dimensions, says what its agents
sense again and again until they are answered, starts without parameters, requires `simulation` as the schemas
do, numbers its agents below 0, has more sensors for one of them, begins by chance, takes actuators of any
number and size and the last ones of a step, answers discovery after parameters, lets every tool end its
episode or begin another, is busy for a moment after the fitness, and minds no retain flag.
"""

import json
import random
import sys
import threading
import time
from typing import Any

from paho.mqtt.client import Client, MQTTMessage
from paho.mqtt.enums import CallbackAPIVersion

Json = dict[str, Any]
AGENTS, STEPS, CLEARING = (-1, -2), 4, 0.3
TYPES: dict[str, dict[str, type | tuple[type, ...]]] = {
    "discovery": {"simulation": str, "simulation_hash": str, "requirements": dict},
    "parameters": {"server": int, "simulation_hash": str},
    "control": {"server": int, "simulation": str, "simulation_hash": str},
    "actuator": {"simulation": str, "simulation_hash": str, "agent": int, "actuator": list},
}


def fits(value: object, kind: type | tuple[type, ...]) -> bool:
    return isinstance(value, kind) and (kind is bool or not isinstance(value, bool))


class Least:
    def __init__(self, broker: str, server: int) -> None:
        self.server = server
        self.hash = ""
        self.busy_until = 0.0
        self.places: dict[int, float] = {}
        self.answers: dict[int, list[float]] = {}
        self.steps = 0
        self.lock = threading.RLock()
        self.client = Client(CallbackAPIVersion.VERSION2)
        self.client.on_connect = lambda client, *_: client.subscribe([(topic, 0) for topic in TYPES])
        self.client.on_message = self.receive
        host, _, port = broker.removeprefix("mqtt://").rpartition(":")
        self.client.connect(host, int(port))

    def run(self) -> None:
        threading.Thread(target=self.client.loop_forever, daemon=True).start()
        while True:
            time.sleep(0.03)
            with self.lock:
                self.sense()

    def receive(self, _client: Client, _data: object, message: MQTTMessage) -> None:
        with self.lock:
            self.take(message)
            # Not by the clock alone: what can be seen of it must not depend on how busy the machine is.
            self.sense()

    def take(self, message: MQTTMessage) -> None:
        try:
            fields = json.loads(message.payload)
        except (ValueError, RecursionError):
            return
        if not isinstance(fields, dict):
            return
        if not all(key in fields and fits(fields[key], kind) for key, kind in TYPES[message.topic].items()):
            return
        if fields.get("server", self.server) == self.server:
            getattr(self, message.topic)(fields)

    def say(self, topic: str, **fields: Any) -> None:
        self.client.publish(topic, json.dumps(fields))

    def discovery(self, fields: Json) -> None:
        needs = fields["requirements"]
        agents = needs.get("max_agents", 0)
        if not fits(needs.get("dimensions"), (int, float)) or not fits(agents, (int, float)):
            return
        if self.hash or time.monotonic() < self.busy_until or fields["simulation"] != "least" or agents > 2:
            return
        offer = {"simulations": ["least"], "capabilities": {"dimensions": 3, "max agents": 2}}
        self.say("server", server=self.server, simulation_hash=fields["simulation_hash"], **offer)

    def parameters(self, fields: Json) -> None:
        """It has none."""

    def control(self, fields: Json) -> None:
        run = fields.get("run", True)
        if not fits(run, bool) or not fits(fields.get("visual", False), bool):
            return
        if run:
            self.hash, self.steps, self.answers = fields["simulation_hash"], 0, {}
            self.places = {agent: random.uniform(-5, 5) for agent in AGENTS}
        else:
            self.hash = ""

    def sense(self) -> None:
        """Whoever has not been answered."""
        for agent in AGENTS:
            if self.hash and agent not in self.answers:
                values = [self.places[agent]] * abs(agent)
                self.say("sensor", simulation_hash=self.hash, agent=agent, sensor=values)

    def actuator(self, fields: Json) -> None:
        agent, values = fields["agent"], fields["actuator"]
        if fields["simulation_hash"] != self.hash or agent not in AGENTS:
            return
        if not all(fits(value, (int, float)) for value in values):
            return
        self.answers[agent] = values
        if len(self.answers) == len(AGENTS):
            for each, (value, *_) in self.answers.items():
                self.places[each] += value
            self.answers, self.steps = {}, self.steps + 1
            if self.steps == STEPS:
                hash_, self.hash = self.hash, ""
                self.busy_until = time.monotonic() + CLEARING
                self.say("fitness", simulation_hash=hash_, fitness=-sum(map(abs, self.places.values())))


if __name__ == "__main__":
    Least(sys.argv[1], int(sys.argv[2])).run()
