"""A ping-pong between two Python programs with the usual MQTT library, for orientation."""

import multiprocessing
import socket
import time
from multiprocessing.synchronize import Event

import paho.mqtt.client as mqtt
from paho.mqtt.enums import CallbackAPIVersion

from benchmarks.processes import Broker

THERE, BACK = "paho/there", "paho/back"


def pingpong(broker: Broker, count: int, sizes: tuple[int, int]) -> float:
    """Mean time of a round trip in us. sizes: bytes there and back."""
    context = multiprocessing.get_context("spawn")
    ready, done = context.Event(), context.Event()
    echo = context.Process(target=_echo, args=(broker.port, sizes[1], ready, done))
    echo.start()
    try:
        if not ready.wait(20):
            raise SystemExit("the echoing paho client did not start")
        return _play(broker.port, count, b"x" * sizes[0])
    finally:
        done.set()
        echo.join(20)


def _without_delay(_client: mqtt.Client, _data: object, connection: object) -> None:
    if isinstance(connection, socket.socket):
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)


def _client(port: int, topic: str) -> mqtt.Client:
    """A client, subscribed, with TCP_NODELAY."""
    client = mqtt.Client(CallbackAPIVersion.VERSION2, protocol=mqtt.MQTTv5)
    client.on_socket_open = _without_delay
    subscribed: list[bool] = []
    client.on_subscribe = lambda *_: subscribed.append(True)
    client.connect("127.0.0.1", port)
    client.subscribe(topic)
    while not subscribed:
        client.loop(0.1)
    return client


def _echo(port: int, size: int, ready: Event, done: Event) -> None:
    client = _client(port, THERE)
    payload = b"x" * size

    def answer(client: mqtt.Client, _data: object, _message: mqtt.MQTTMessage) -> None:
        client.publish(BACK, payload)

    client.on_message = answer
    ready.set()
    while not done.is_set():
        client.loop(0.05)
    client.disconnect()


def _play(port: int, count: int, payload: bytes) -> float:
    client = _client(port, BACK)
    warm_up = count // 20 + 1
    arrived = 0
    start = 0.0

    def again(client: mqtt.Client, _data: object, _message: mqtt.MQTTMessage) -> None:
        nonlocal arrived, start
        arrived += 1
        if arrived == warm_up:
            start = time.perf_counter()
        client.publish(THERE, payload)

    client.on_message = again
    client.publish(THERE, payload)
    while arrived < count + warm_up:
        client.loop(1)
    seconds = time.perf_counter() - start
    client.disconnect()
    return seconds / (arrived - warm_up) * 1e6
