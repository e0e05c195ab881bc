"""Sensors read from topics and actuators published on topics, according to a mapping."""

from __future__ import annotations

import secrets
from typing import Any, Callable, NamedTuple, Sequence, Union

from .fields import Reader, binary32, describe_missing_value, has_stamp, reader, writers
from .mapping import ActuatorMapping, MappingError, SensorMapping, TopicField
from .middleware import Middleware, Publisher

_Entries = Sequence[Union[SensorMapping, ActuatorMapping]]
_MASK = (1 << 64) - 1


class Missing(NamedTuple):
    """The reasons why sensors have no value."""

    silent: list[str]
    """Topics without a message for longer than the time-out."""
    unusable: list[str]
    """Descriptions of topics whose messages have no value."""

    def text(self, word: str, of_silent: str) -> str:
        """Return the message; word: its beginning; of_silent: text before silent topics."""
        if not self.silent:
            return f"{word}: {'; '.join(self.unusable)}"
        return "; ".join([f"{word}{of_silent}{', '.join(self.silent)}", *self.unusable])


class Generator:
    """Random numbers from 0 to 1, 1 excluded: the upper 24 bits of SplitMix64.

    Args:
        seed: seed; None for a random one, so that robots differ.
    """

    def __init__(self, seed: int | None) -> None:
        self._state = secrets.randbits(64) if seed is None else seed

    def next(self) -> float:
        """Return the next number, exact in binary32."""
        self._state = z = self._state + 0x9E3779B97F4A7C15 & _MASK
        z = (z ^ z >> 30) * 0xBF58476D1CE4E5B9 & _MASK
        z = (z ^ z >> 27) * 0x94D049BB133111EB & _MASK
        return ((z ^ z >> 31) >> 40) / 16777216


class Inputs:
    """The latest value of every sensor, and its time.

    Args:
        node: the node.
        sensors: sensors with resolved topics.

    Raises MappingError for an unknown type or field, or one that the topic does not have.
    """

    def __init__(self, node: Middleware, sensors: Sequence[SensorMapping]) -> None:
        self._node, self._sensors = node, list(sensors)
        self.values = [binary32(sensor.constant or 0.0) or 0.0 for sensor in self._sensors]
        """Values of the sensors, binary32; 0 before the first message."""
        self.times: list[float | None] = [None] * len(self._sensors)
        """Times of the values, on the node's clock; None before the first."""
        self._heard: list[float | None] = [None] * len(self._sensors)
        """Times of the latest messages, with or without a value."""
        drawn = [(at, sensor.seed) for at, sensor in enumerate(self._sensors) if sensor.random]
        self._generators = [(at, Generator(seed)) for at, seed in drawn]
        for topic in _topics(self._sensors):
            kind = _type_of(node, topic, self._sensors)
            reads = [
                (at, reader(sensor))
                for at, sensor in enumerate(self._sensors)
                if sensor.topic_field.topic == topic
            ]
            node.subscribe(topic, kind, self._receiver(reads))

    def _receiver(self, reads: list[tuple[int, Reader]]) -> Callable[[Any], None]:
        def receive(message: Any) -> None:
            for at, read in reads:
                value = read(message)
                self._heard[at] = self._node.now()
                # NaN and infinities are not measurements; they are ignored.
                if value is not None:
                    self.values[at], self.times[at] = value, self._node.now()

        return receive

    def missing(self) -> Missing | None:
        """Return the sensors without a value for longer than their time-out; None if all have one."""
        now = self._node.now()
        silent: dict[str, None] = {}
        unusable: dict[str, None] = {}
        for sensor, time, heard in zip(self._sensors, self.times, self._heard):
            if not sensor.topic_field.topic or _recent(time, now, sensor.timeout):
                continue
            if _recent(heard, now, sensor.timeout):
                unusable[
                    f"{sensor.topic_field.topic}: messages come, but {describe_missing_value(sensor)}"
                ] = None
            else:
                silent[sensor.topic_field.topic] = None
        return Missing(list(silent), list(unusable)) if silent or unusable else None

    def draw(self) -> None:
        """Draw the values of random sensors for the next cycle."""
        for at, generator in self._generators:
            self.values[at] = generator.next()

    def check_types(self) -> None:
        """Raise MappingError for a topic that other nodes use with another type."""
        for topic in _topics(self._sensors):
            _type_of(self._node, topic, self._sensors)


class Outputs:
    """The topics on which actuators are published.

    Args:
        node: the node.
        actuators: actuators with resolved topics.

    Raises MappingError like `Inputs`.
    """

    def __init__(self, node: Middleware, actuators: Sequence[ActuatorMapping]) -> None:
        self._node, self._actuators = node, list(actuators)
        self._topics: list[Callable[[Sequence[float] | None], None]] = []
        self.publishers: list[tuple[str, str, Publisher]] = []
        """Topic, type, and what publishes on it."""
        for topic in _topics(self._actuators):
            kind = _type_of(node, topic, self._actuators)
            write = writers([actuator for actuator in self._actuators if actuator.topic_field.topic == topic])
            publisher = node.publisher(topic, kind)
            self.publishers.append((topic, kind, publisher))
            self._topics.append(self._sender(publisher, write, has_stamp(kind)))

    def _sender(
        self,
        publisher: Publisher,
        write: Callable[[Any, Sequence[float]], None],
        stamp: bool,
    ) -> Callable[[Sequence[float] | None], None]:
        def send(values: Sequence[float] | None) -> None:
            message = publisher.new()
            if stamp:
                self._node.stamp(message.header)
            if values is not None:
                write(message, values)
            publisher.publish(message)

        return send

    def publish(self, actuators: Sequence[float]) -> None:
        """Publish one command on each topic."""
        for send in self._topics:
            send(actuators)

    def stop(self) -> None:
        """Publish zeros."""
        for send in self._topics:
            send(None)

    def check_types(self) -> None:
        """Raise MappingError for a topic that other nodes use with another type."""
        for topic in _topics(self._actuators):
            _type_of(self._node, topic, self._actuators)


def _topics(entries: _Entries) -> list[str]:
    return list(dict.fromkeys(entry.topic_field.topic for entry in entries if entry.topic_field.topic))


def _recent(time: float | None, now: float, timeout: float) -> bool:
    # What came later than now came before a simulation began anew.
    return time is not None and time <= now and now - time <= timeout


def _type_of(node: Middleware, topic: str, entries: _Entries) -> str:
    """Return the type of a topic: all its entries have it, and no other node uses it with another one."""
    places: list[TopicField] = [entry.topic_field for entry in entries if entry.topic_field.topic == topic]
    first = places[0]
    for field in places:
        if field.type != first.type:
            raise MappingError(
                field.where,
                f"{topic} has the type {first.type} at {first.where} and {field.type} here; "
                "a topic has one type",
                "type",
            )
    for other_type in node.types(topic):
        if other_type != first.type:
            raise MappingError(
                first.where, f"{topic} has the type {other_type}, but the mapping says {first.type}", "type"
            )
    return first.type
