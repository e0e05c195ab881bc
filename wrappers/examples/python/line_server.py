"""A simulation server without Swarmwright: python line_server.py mqtt://localhost:1883 4711.

Agents on a line sense their position and set their speed; the closer they end to 0, the better.
"""

import json
import math
import os
import random
import socket
import struct
import sys
import time

from paho.mqtt.client import Client
from paho.mqtt.enums import CallbackAPIVersion

BROKER, SERVER = sys.argv[1], int(sys.argv[2])
STEPS, ARRIVED = 20, 0.05
MAX_PARAMETERS = 100  # kept by their hash
HOLD, PATIENCE = 5, 60  # seconds: parameters without control, a step without actuators


# Readers of message fields. Invalid fields raise before anything has changed.


def refuse(reason):
    raise ValueError(reason)


def read(payload):
    if len(payload) > 2**20:
        refuse("it is larger than 1 MiB")
    fields = json.loads(payload, parse_constant=refuse)
    return fields if isinstance(fields, dict) else refuse("it is not a JSON object")


def text(value):
    return value if isinstance(value, str) else refuse(f"{value!r} is not text")


def number(value):
    """Return the nearest binary32."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        refuse(f"{value!r} is not a number")
    (single,) = struct.unpack("f", struct.pack("f", value))
    return single if math.isfinite(single) else refuse(f"{value!r} is not finite")


def integer(value):
    number(value)
    return int(value) if value == int(value) else refuse(f"{value!r} is not an integer")


# The simulation. Put yours in its place.


class Line:
    def __init__(self, fields):
        """Start an episode from its parameters."""
        start, agents = number(fields.get("start", 5.0)), integer(fields.get("agents", 1))
        most = Server.capabilities["max_agents"]
        if not 1 <= agents <= most:
            refuse(f"{agents} agents, expected 1 to {most}")
        numbers = random.Random(integer(fields.get("seed", 0)))  # all that is random comes from the seed
        self.x = [start + numbers.uniform(-1.0, 1.0) for _ in range(agents)]
        self.steps = 0

    def acting(self):
        """Return the agents that act next; those that have arrived drop out."""
        return [agent for agent, x in enumerate(self.x) if abs(x) > ARRIVED] if self.steps < STEPS else []

    def step(self, speeds):
        for agent, speed in speeds.items():
            self.x[agent] += speed
        self.steps += 1

    def fitness(self):
        return -sum(map(abs, self.x)) / len(self.x)


class Server:
    """The protocol. hash: of the current episode; until: when the reservation expires."""

    capabilities = {"dimensions": 1, "max_agents": 10}

    def __init__(self):
        self.parameters, self.hash, self.until = {}, None, 0.0

    def free(self):
        self.hash, self.until = None, 0.0

    def take(self, seconds):
        self.until = time.monotonic() + seconds

    def on_discovery(self, fields):
        hash_, title = text(fields["simulation_hash"]), text(fields["simulation"])
        needs = fields["requirements"]
        if not isinstance(needs, dict):
            refuse("requirements is not an object")
        agents = number(needs.get("max_agents", needs.get("max agents", 0)))
        fits = title == "line" and number(needs["dimensions"]) == 1
        if fits and agents <= self.capabilities["max_agents"] and not self.until:
            send(
                "server",
                server=SERVER,
                simulation_hash=hash_,
                simulations=["line"],
                capabilities=self.capabilities,
            )

    def on_parameters(self, fields):
        hash_ = text(fields["simulation_hash"])
        if integer(fields["server"]) == SERVER:
            Line(fields)  # refuses what it cannot simulate
            self.parameters.pop(hash_, None)
            self.parameters[hash_] = fields
            self.parameters = dict(list(self.parameters.items())[-MAX_PARAMETERS:])
            if self.hash is None:
                self.take(HOLD)

    def on_control(self, fields):
        hash_, run = text(fields["simulation_hash"]), fields.get("run", True)
        if not isinstance(run, bool):
            refuse(f"{run!r} is neither true nor false")
        if integer(fields["server"]) != SERVER or hash_ not in self.parameters:
            return
        if fields.get("simulation", "line") != "line":
            return  # meant for another server with this ID
        if run and self.hash is None:
            self.hash, self.line = hash_, Line(self.parameters[hash_])
            self.proceed()
        elif not run and hash_ == (self.hash or list(self.parameters)[-1]):
            self.free()

    def on_actuator(self, fields):
        agent, values = integer(fields["agent"]), fields["actuator"]
        if text(fields["simulation_hash"]) != self.hash:
            return
        if agent not in self.asked or agent in self.speeds:
            refuse(f"agent {agent} has not been asked, or has answered")
        if not isinstance(values, list) or len(values) != 1:
            refuse("an agent has one actuator")
        self.speeds[agent] = max(-1.0, min(1.0, number(values[0])))
        if len(self.speeds) == len(self.asked):  # now all have answered
            self.line.step(self.speeds)
            self.proceed()

    def proceed(self):
        """Ask the agents that act next, or end the episode."""
        self.show()
        self.asked, self.speeds = self.line.acting(), {}
        if self.asked:
            self.take(PATIENCE)
            for agent in self.asked:
                send("sensor", simulation_hash=self.hash, agent=agent, sensor=[self.line.x[agent]])
        else:
            hash_ = self.hash
            self.free()
            send("fitness", simulation_hash=hash_, fitness=self.line.fitness())

    def show(self):
        """Do nothing; a server with scenes publishes one here."""

    def receive(self, _client, _userdata, message):
        if message.retain:
            return  # left over from another peer
        if self.until and time.monotonic() > self.until:
            self.free()
        try:
            getattr(self, f"on_{message.topic}")(read(message.payload))
        except (ValueError, KeyError, OverflowError, RecursionError) as error:
            print(f"refused: {message.topic}: {error!r:.200}", flush=True)


def send(topic, **fields):
    client.publish(topic, json.dumps(fields))


def subscribe(client, *_):  # on every connection, also after a loss
    # Send small messages at once. Without this line, the second of two waits for an acknowledgement,
    # up to 40 ms.
    client.socket().setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    client.subscribe([(topic, 0) for topic in ("discovery", "parameters", "control", "actuator")])
    print("serving", flush=True)


client = Client(CallbackAPIVersion.VERSION2)
client.username_pw_set(os.environ.get("SWARMWRIGHT_USERNAME"), os.environ.get("SWARMWRIGHT_PASSWORD"))
client.reconnect_delay_set(1, 5)


def serve(server):
    client.on_connect, client.on_message = subscribe, server.receive
    host, port = BROKER.removeprefix("mqtt://").split(":")
    client.connect(host, int(port))
    client.loop_forever()


if __name__ == "__main__":
    serve(Server())
