"""The protocol side of an optimization tool without Swarmwright: `evaluate` plays one episode."""

import json
import math
import os
import queue
import socket
import struct
import sys
import threading
import time
import uuid

from paho.mqtt.client import Client
from paho.mqtt.enums import CallbackAPIVersion

BROKER, SIMULATION, DIMENSIONS = sys.argv[1], sys.argv[2], int(sys.argv[3])
ASK_AGAIN, SILENCE = 1, 5  # seconds without an answer to a discovery, without a message of an episode
ATTEMPTS = 3  # episodes without fitness, until the evaluation fails

client = Client(CallbackAPIVersion.VERSION2)
client.username_pw_set(os.environ.get("SWARMWRIGHT_USERNAME"), os.environ.get("SWARMWRIGHT_PASSWORD"))
subscribed, received = threading.Event(), queue.SimpleQueue()


def subscribe(client, *_):  # on every connection, also after a loss
    # Send small messages at once. Without this line, the second of two waits for an acknowledgement,
    # up to 40 ms.
    client.socket().setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    client.subscribe([(topic, 0) for topic in ("server", "sensor", "fitness")])


def connect():
    client.on_connect, client.on_subscribe = subscribe, lambda *_: subscribed.set()
    client.on_message = lambda _client, _userdata, message: message.retain or received.put(message)
    client.reconnect_delay_set(1, 5)
    host, port = BROKER.removeprefix("mqtt://").split(":")
    client.connect(host, int(port))
    client.loop_start()
    subscribed.wait(10)


def close():
    client.disconnect()  # after all that has been sent
    client.loop_stop()


def send(topic, **fields):
    client.publish(topic, json.dumps(fields))


def number(value):
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise ValueError(f"{value!r} is not a number")
    return value


def index(value):
    if number(value) < 0 or value % 1:
        raise ValueError(f"{value!r} is not a non-negative integer")
    return int(value)


def content(topic, fields):
    """Return the content of a message; raise if it is invalid."""
    if topic == "server":
        return index(fields["server"])
    if topic == "fitness":
        return number(fields["fitness"])
    sensors = [number(value) for value in fields["sensor"]]
    if not sensors:
        raise ValueError("the sensor list is empty")
    binary32 = f"{len(sensors)}f"
    return index(fields["agent"]), struct.unpack(binary32, struct.pack(binary32, *sensors))


def receive(hash_, seconds):
    """Return topic and content of the next message with this hash, or two None after so many seconds."""
    until = time.monotonic() + seconds
    while (left := until - time.monotonic()) > 0:
        try:
            message = received.get(timeout=left)
            fields = json.loads(message.payload)
            if fields["simulation_hash"] == hash_ and fields.get("simulation", SIMULATION) == SIMULATION:
                return message.topic, content(message.topic, fields)
        except (queue.Empty, ValueError, KeyError, TypeError, OverflowError, RecursionError):
            pass  # the right message may follow
    return None, None


def discover(episode, abandoned):
    """Return the first server that answers. abandoned: messages that end episodes which may still run."""
    server = None
    while server is None:
        send("discovery", **episode, requirements={"dimensions": DIMENSIONS})
        _, server = receive(episode["simulation_hash"], ASK_AGAIN)
        if server is None:
            print("no server has answered; asking again", file=sys.stderr)
            for control in abandoned:
                send("control", **control)
    return server


def no_actuators(_agent, _sensors):
    raise RuntimeError(f"the simulation {SIMULATION!r} asks for actuators")


def evaluate(parameters, act=no_actuators):
    """Return the fitness of one episode. act(agent, sensors) returns the actuators of an agent."""
    abandoned = []
    for _ in range(ATTEMPTS):
        episode = {"simulation": SIMULATION, "simulation_hash": uuid.uuid4().hex}
        server, topic = discover(episode, abandoned), "control"
        try:
            send("parameters", **parameters, server=server, simulation_hash=episode["simulation_hash"])
            send("control", **episode, server=server, run=True)
            while topic is not None:
                topic, value = receive(episode["simulation_hash"], SILENCE)
                if topic == "fitness":
                    return value
                if topic == "sensor":
                    agent, sensors = value
                    send("actuator", **episode, agent=agent, actuator=act(agent, sensors))
        finally:  # after silence, an error and Ctrl-C
            if topic != "fitness":
                abandoned.append({**episode, "server": server, "run": False})
                send("control", **abandoned[-1])
    raise RuntimeError(f"{ATTEMPTS} episodes ended without fitness, the last one on server {server}")
