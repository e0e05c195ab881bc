"""A single-threaded MQTT client (paho), and the discovery of servers."""

import json
import os
import socket
import ssl
import time
from collections import deque
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Self
from urllib.parse import urlsplit

from swarmwright import _engine
from swarmwright.common.errors import InputError, RunError, engine_errors
from swarmwright.common.json_text import is_number, new_hash

try:
    from paho.mqtt.client import Client as Paho
    from paho.mqtt.client import MQTTMessage, MQTTv5
    from paho.mqtt.enums import CallbackAPIVersion, MQTTErrorCode
    from paho.mqtt.packettypes import PacketTypes
    from paho.mqtt.properties import Properties
except ImportError:
    raise InputError("this needs paho-mqtt: pip install 'swarmwright[conformance]'") from None

TOPICS = ("discovery", "server", "parameters", "control", "sensor", "actuator", "fitness")
PRESENCE = "swarmwright/v1/presence/"
TO_SERVER = "swarmwright/v1/server/"
TO_TOOL = "swarmwright/v1/tool/"
MAX_SHOWN_CHARACTERS = 240
"""Characters of a message to show."""


class Failure(Exception):  # noqa: N818 - of the peer, not of this program
    """The peer broke the rule.

    Args:
        came: observed behaviour.
        expected: behaviour that the rule demands.
        sent: message sent before; empty if irrelevant.
    """

    def __init__(self, came: str, expected: str, sent: str = "") -> None:
        super().__init__(f"expected {expected}, but {came}")
        self.came = came
        self.expected = expected
        self.sent = sent


class Overdue(Exception):  # noqa: N818 - the rule's time is over
    """The check of a rule has exceeded its time limit."""


def format_payload(payload: bytes | str) -> str:
    """Format a payload as text, shortened."""
    text = payload if isinstance(payload, str) else payload.decode("utf-8", "backslashreplace")
    return (
        text
        if len(text) <= MAX_SHOWN_CHARACTERS
        else f"{text[:MAX_SHOWN_CHARACTERS]}... ({len(payload)} bytes)"
    )


def _refuse(word: str) -> float:
    raise ValueError(f"{word} is not valid JSON")


@dataclass(frozen=True)
class Message:
    """A received message; `topic` lacks the prefix, `at` is in monotonic seconds."""

    topic: str
    payload: bytes
    retained: bool
    at: float
    correlation: bytes | None = None
    content_type: str | None = None

    @property
    def json(self) -> dict[str, Any]:
        """The payload as a JSON object. Raises Failure for other payloads."""
        try:
            value = json.loads(self.payload, parse_constant=_refuse)
        except (ValueError, RecursionError) as error:
            raise Failure(f"{self} came, which cannot be read: {error}", "a JSON object in UTF-8") from None
        if not isinstance(value, dict):
            raise Failure(f"{self} came", "a JSON object")
        return value

    @property
    def maybe(self) -> Mapping[str, Any]:
        """The payload as a JSON object, empty for other payloads."""
        try:
            return self.json
        except Failure:
            return {}

    def __str__(self) -> str:
        """Return topic and payload, shortened."""
        return f"{self.topic} {format_payload(self.payload)}"


def _send_at_once(_client: Paho, _data: object, opened: object) -> None:
    if isinstance(opened, socket.socket) and opened.family != getattr(socket, "AF_UNIX", None):
        opened.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)


class Client:
    """A connection to the broker.

    Args:
        url: URL of the broker; user and password come from the environment.
        prefix: prefix of all topics, or empty.
        subscriptions: topics without prefix.

    Raises RunError if the broker cannot be reached.
    """

    def __init__(self, url: str, prefix: str, subscriptions: Collection[str]) -> None:
        self.url = url
        self.deadline = float("inf")
        self.waiting: deque[Message] = deque()
        self._prefix = f"{prefix}/" if prefix else ""
        self._subscribed = False
        self._make_paho = _make_paho(url)
        self._make_paho.on_socket_open = _send_at_once
        self._make_paho.on_message = self._on_message
        self._make_paho.on_subscribe = self._on_subscribe
        self._make_paho.on_connect = self._on_connect
        self._refused = ""
        address = urlsplit(url)
        secure = address.scheme in {"mqtts", "wss"}
        host = address.path if address.scheme == "unix" else address.hostname
        assert host is not None
        try:
            self._make_paho.connect(host, address.port or (8883 if secure else 1883), keepalive=600)
        except OSError as error:
            raise RunError(f"broker {url}: cannot be reached: {error.strerror or error}") from None
        self._make_paho.subscribe([(self._prefix + topic, 1) for topic in subscriptions])
        limit = time.monotonic() + 10
        while not self._subscribed:
            if time.monotonic() > limit or self._refused:
                why = self._refused or "does not answer"
                raise RunError(f"broker {url}: {why}")
            self._run_loop(0.1)

    def _on_message(self, _client: Paho, _data: object, message: MQTTMessage) -> None:
        properties = message.properties
        self.waiting.append(
            Message(
                message.topic.removeprefix(self._prefix),
                bytes(message.payload),
                message.retain,
                time.monotonic(),
                getattr(properties, "CorrelationData", None),
                getattr(properties, "ContentType", None),
            )
        )

    def _on_subscribe(self, *_: object) -> None:
        self._subscribed = True

    def _on_connect(self, _client: Paho, _data: object, _flags: object, reason: Any, _: object) -> None:  # noqa: ANN401 - paho's
        if reason.is_failure:
            self._refused = f"refuses the connection: {reason}"

    def _run_loop(self, seconds: float) -> None:
        status = self._make_paho.loop(max(0.0, seconds))
        if status != MQTTErrorCode.MQTT_ERR_SUCCESS:
            raise RunError(f"broker {self.url}: {self._refused or 'the connection broke'}")

    def publish(
        self,
        topic: str,
        payload: bytes | str,
        *,
        retain: bool = False,
        correlation: bytes | None = None,
        response: str | None = None,
    ) -> None:
        """Publish with QoS 0. correlation, response: of MQTT 5, for MessagePack payloads."""
        properties = None
        if correlation is not None:
            properties = Properties(PacketTypes.PUBLISH)  # type: ignore[no-untyped-call]
            properties.CorrelationData = correlation
            properties.ContentType = "application/msgpack"
            if response is not None:
                properties.ResponseTopic = self._prefix + response
        self._make_paho.publish(self._prefix + topic, payload, retain=retain, properties=properties)
        while self._make_paho.want_write():
            self._run_loop(0.01)

    def send(self, topic: str, **fields: Any) -> str:  # noqa: ANN401 - JSON
        """Publish a JSON object; return topic and payload as text."""
        text = json.dumps(fields)
        self.publish(topic, text)
        return f"{topic} {format_payload(text)}"

    def next(self, matches: Callable[[Message], bool], seconds: float) -> Message | None:
        """Return the next matching message, None after `seconds`; other messages stay queued.

        Raises Overdue after the rule's deadline.
        """
        limit = time.monotonic() + seconds
        index = 0
        while True:
            while index < len(self.waiting):
                message = self.waiting[index]
                if matches(message):
                    del self.waiting[index]
                    return message
                index += 1
            now = time.monotonic()
            if now >= self.deadline:
                raise Overdue
            if now >= limit:
                return None
            self._run_loop(min(limit, self.deadline) - now)

    def drain(self, seconds: float = 0.0) -> list[Message]:
        """Return all queued messages and those that arrive within `seconds`."""
        limit = time.monotonic() + seconds
        while True:
            self._run_loop(min(limit, self.deadline) - time.monotonic())
            if time.monotonic() >= min(limit, self.deadline):
                break
        messages = list(self.waiting)
        self.waiting.clear()
        return messages

    def close(self) -> None:
        """Leave the broker."""
        self._make_paho.disconnect()
        self._make_paho.loop(0)

    def __enter__(self) -> Self:
        """Return the client."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close."""
        self.close()


def _make_paho(url: str) -> Paho:
    address = urlsplit(url)
    transport = {"ws": "websockets", "wss": "websockets", "unix": "unix"}.get(address.scheme, "tcp")
    paho = Paho(CallbackAPIVersion.VERSION2, protocol=MQTTv5, transport=transport)  # type: ignore[arg-type]
    with engine_errors():
        user, password = _engine.account(url)
    if user:
        paho.username_pw_set(user, password)
    if address.scheme in {"mqtts", "wss"}:
        _secure(paho)
    return paho


def _secure(paho: Paho) -> None:
    variables = ("SWARMWRIGHT_CA_FILE", "SWARMWRIGHT_CERTIFICATE_FILE", "SWARMWRIGHT_KEY_FILE")
    authority, certificate, key = (os.environ.get(name) or None for name in variables)
    if (certificate is None) != (key is None):
        unset, present = variables[1:] if certificate is None else variables[:0:-1]
        raise InputError(f"{present} is set but {unset} is not; a client certificate needs both (PEM)")

    def ask() -> str:  # otherwise OpenSSL asks on the terminal
        raise InputError(
            f"{variables[2]}: {key} has a passphrase; use a key without one "
            "(`openssl pkey -in FILE -out FILE` removes it)"
        )

    try:
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
        if authority is None:
            context.load_default_certs()
        else:
            context.load_verify_locations(authority)
        if certificate is not None:
            context.load_cert_chain(certificate, key, password=ask)
    except (OSError, ValueError) as error:  # ssl.SSLError is an OSError
        named = ", ".join(f"{name} {os.environ[name]}" for name in variables if os.environ.get(name))
        raise InputError(f"TLS: {named or 'the authorities of the system'}: {error}") from None
    paho.tls_set_context(context)


def discover_servers(
    broker: str, simulation: str, dimensions: Sequence[float], *, prefix: str = "", wait: float = 1.0
) -> list[dict[str, Any]]:
    """Send a discovery for each number of dimensions, as D6.1 defines it.

    Returns the answers within `wait` seconds, one per server, sorted by id: `server`, `simulations`,
    `capabilities`. Reserved or unsuitable servers do not answer. Those that answer stay free, because no
    parameters follow.

    Raises RunError if the broker cannot be reached.
    """
    servers: dict[int, dict[str, Any]] = {}
    with Client(broker, prefix, ["server"]) as client:
        hashes = {new_hash(): {"dimensions": number} for number in dimensions}
        for hash_, needs in hashes.items():
            client.send("discovery", simulation=simulation, simulation_hash=hash_, requirements=needs)
        for message in client.drain(wait):
            answer = _parse_answer(message, hashes)
            if answer is not None:
                servers.setdefault(answer["server"], answer)
    return [servers[server] for server in sorted(servers)]


def _parse_answer(message: Message, hashes: Collection[str]) -> dict[str, Any] | None:
    """Parse a server's answer; None for answers to other tools and invalid ones."""
    content = message.maybe
    server, hash_ = content.get("server"), content.get("simulation_hash")
    if message.retained or not is_number(server) or server != int(server):
        return None
    if not isinstance(hash_, str) or hash_ not in hashes:
        return None
    simulations, capabilities = content.get("simulations"), content.get("capabilities")
    return {
        "server": int(server),
        "simulations": simulations if isinstance(simulations, list) else [],
        "capabilities": capabilities if isinstance(capabilities, dict) else {},
    }
