"""An MQTT client of another make (paho), on which the plain peers and the recorder stand."""

import json
import queue
import socket
import threading
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self
from urllib.parse import urlsplit

import msgpack
from paho.mqtt.client import Client, MQTTMessage, MQTTv5, MQTTv311
from paho.mqtt.enums import CallbackAPIVersion

TOPICS = ("discovery", "server", "parameters", "control", "sensor", "actuator", "fitness")
PRESENCE = "swarmwright/v1/presence/"
STATUS = "swarmwright/v1/status/"
TOOLS = "swarmwright/v1/tool/"
TO_SERVER = "swarmwright/v1/server/"


@dataclass(frozen=True)
class Received:
    """A message as it came: topic, payload, whether it was retained, when (monotonic seconds)."""

    topic: str
    payload: bytes
    retained: bool
    at: float

    @property
    def json(self) -> dict[str, Any]:
        """The content; of an extension's message the decoded form."""
        read = msgpack.unpackb if self.topic.startswith(TOOLS) else json.loads
        value: dict[str, Any] = read(self.payload)
        return value


def _send_at_once(_client: Client, _data: object, opened: object) -> None:
    if isinstance(opened, socket.socket):
        opened.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)


class Peer:
    """A connected client with subscriptions; what comes waits in `inbox`.

    login: user and password. authority: whose certificates count, for `mqtts://`.
    again: connect again when the connection is lost.
    """

    def __init__(
        self,
        url: str,
        *subscriptions: str,
        version: int = 5,
        login: tuple[str, str] | None = None,
        authority: Path | None = None,
        again: bool = True,
    ) -> None:
        self.inbox: queue.SimpleQueue[Received] = queue.SimpleQueue()
        self._subscribed = threading.Event()
        self._client = Client(
            CallbackAPIVersion.VERSION2,
            protocol=MQTTv5 if version == 5 else MQTTv311,
            reconnect_on_failure=again,
        )
        self._client.max_inflight_messages_set(1000)
        self._client.on_socket_open = _send_at_once
        self._client.on_message = self._on_message
        self._client.on_subscribe = lambda *_: self._subscribed.set()
        if login:
            self._client.username_pw_set(*login)
        if authority:
            self._client.tls_set(ca_certs=str(authority))
        address = urlsplit(url)
        assert address.hostname is not None
        assert address.port is not None
        self._client.connect(address.hostname, address.port)
        self._client.loop_start()
        if subscriptions:
            self._client.subscribe([(topic, 0) for topic in subscriptions])
            assert self._subscribed.wait(10), "the broker does not acknowledge the subscription"

    def _on_message(self, _client: Client, _data: object, message: MQTTMessage) -> None:
        received = Received(message.topic, bytes(message.payload), message.retain, time.monotonic())
        self.received(received)

    def received(self, message: Received) -> None:
        """Take a message, in the client's thread."""
        self.inbox.put(message)

    def publish(self, topic: str, payload: bytes | str, *, retain: bool = False, qos: int = 0) -> None:
        self._client.publish(topic, payload, qos=qos, retain=retain).wait_for_publish(10)

    def send(self, topic: str, **fields: Any) -> None:
        self._client.publish(topic, json.dumps(fields))

    def close(self) -> None:
        self._client.disconnect()
        self._client.loop_stop()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
