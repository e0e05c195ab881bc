"""Sensors from topics, actuators to topics, as a mapping says."""

from __future__ import annotations

import secrets
from typing import Any, Callable, NamedTuple, Sequence, Union

from .fields import Reader, binary32, no_value, reader, stamped, writers
from .mapping import ActuatorMapping, MappingError, Place, SensorMapping
from .middleware import Middleware, Publisher

_Entries = Sequence[Union[SensorMapping, ActuatorMapping]]
_MASK = (1 << 64) - 1


class Missing(NamedTuple):
    """Why sensors have no value."""

    silent: list[str]
    """Topics from which nothing has come for longer than the time-out."""
    unusable: list[str]
    """Of topics that do send: what their messages lack."""

    def text(self, word: str, of_silent: str) -> str:
        """Begin with the word and, where topics are silent, with what is to be said of them."""
        if not self.silent:
            return f"{word}: {'; '.join(self.unusable)}"
        return "; ".join([f"{word}{of_silent}{', '.join(self.silent)}", *self.unusable])


class Generator:
    """Numbers from 0 to 1, 1 excluded: SplitMix64, of which the upper 24 bits are taken.

    Args:
        seed: None for another one each time, so that robots differ.
    """

    def __init__(self, seed: int | None) -> None:
        self._state = secrets.randbits(64) if seed is None else seed

    def next(self) -> float:
        """Return the next number, which is one of binary32."""
        self._state = z = self._state + 0x9E3779B97F4A7C15 & _MASK
        z = (z ^ z >> 30) * 0xBF58476D1CE4E5B9 & _MASK
        z = (z ^ z >> 27) * 0x94D049BB133111EB & _MASK
        return ((z ^ z >> 31) >> 40) / 16777216


class Inputs:
    """The latest value of every sensor, and when it came.

    Args:
        node: subscribes to the topics.
        sensors: with resolved topics.

    Raises MappingError for a type or a field that is not known, or that the topic does not have.
    """

    def __init__(self, node: Middleware, sensors: Sequence[SensorMapping]) -> None:
        self._node, self._sensors = node, list(sensors)
        self.values = [binary32(sensor.constant or 0.0) or 0.0 for sensor in self._sensors]
        """By sensor, numbers of binary32; 0 before the first one."""
        self.times: list[float | None] = [None] * len(self._sensors)
        """By sensor, when its value came, on the node's clock; None before the first one."""
        self._heard: list[float | None] = [None] * len(self._sensors)
        """By sensor, when a message came, with a value for it or without."""
        drawn = [(at, sensor.seed) for at, sensor in enumerate(self._sensors) if sensor.random]
        self._generators = [(at, Generator(seed)) for at, seed in drawn]
        for topic in _topics(self._sensors):
            kind = _type_of(node, topic, self._sensors)
            reads = [
                (at, reader(sensor)) for at, sensor in enumerate(self._sensors) if sensor.place.topic == topic
            ]
            node.subscribe(topic, kind, self._receiver(reads))

    def _receiver(self, reads: list[tuple[int, Reader]]) -> Callable[[Any], None]:
        def receive(message: Any) -> None:
            for at, read in reads:
                value = read(message)
                self._heard[at] = self._node.now()
                # NaN and infinities are no measurements: the sensor is as silent as if they had not come.
                if value is not None:
                    self.values[at], self.times[at] = value, self._node.now()

        return receive

    def missing(self) -> Missing | None:
        """Return which sensors have had no value for longer than their time-out; None where all have one."""
        now = self._node.now()
        silent: dict[str, None] = {}
        unusable: dict[str, None] = {}
        for sensor, time, heard in zip(self._sensors, self.times, self._heard):
            if not sensor.place.topic or _recent(time, now, sensor.timeout):
                continue
            if _recent(heard, now, sensor.timeout):
                unusable[f"{sensor.place.topic}: messages come, but {no_value(sensor)}"] = None
            else:
                silent[sensor.place.topic] = None
        return Missing(list(silent), list(unusable)) if silent or unusable else None

    def draw(self) -> None:
        """Draw the values of random sensors for the next cycle."""
        for at, generator in self._generators:
            self.values[at] = generator.next()

    def check_types(self) -> None:
        """Raise MappingError for a topic that others use with another type, now that they may be known."""
        for topic in _topics(self._sensors):
            _type_of(self._node, topic, self._sensors)


class Outputs:
    """The topics that actuators are published on.

    Args:
        node: advertises the topics.
        actuators: with resolved topics.

    Raises MappingError as `Inputs` does.
    """

    def __init__(self, node: Middleware, actuators: Sequence[ActuatorMapping]) -> None:
        self._node, self._actuators = node, list(actuators)
        self._topics: list[Callable[[Sequence[float] | None], None]] = []
        self.publishers: list[tuple[str, str, Publisher]] = []
        """Topic, type, and what publishes on it."""
        for topic in _topics(self._actuators):
            kind = _type_of(node, topic, self._actuators)
            write = writers([actuator for actuator in self._actuators if actuator.place.topic == topic])
            publisher = node.publisher(topic, kind)
            self.publishers.append((topic, kind, publisher))
            self._topics.append(self._sender(publisher, write, stamped(kind)))

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
        """Raise MappingError for a topic that others use with another type, now that they may be known."""
        for topic in _topics(self._actuators):
            _type_of(self._node, topic, self._actuators)


def _topics(entries: _Entries) -> list[str]:
    return list(dict.fromkeys(entry.place.topic for entry in entries if entry.place.topic))


def _recent(time: float | None, now: float, timeout: float) -> bool:
    # What came later than now came before a simulation began anew.
    return time is not None and time <= now and now - time <= timeout


def _type_of(node: Middleware, topic: str, entries: _Entries) -> str:
    """Return the type of a topic: all its entries have it, and no other node uses it with another one."""
    places: list[Place] = [entry.place for entry in entries if entry.place.topic == topic]
    first = places[0]
    for place in places:
        if place.type != first.type:
            raise MappingError(
                place.where,
                f"{topic} has the type {first.type} at {first.where} and {place.type} here; "
                "a topic has one type",
                "type",
            )
    for other in node.types(topic):
        if other != first.type:
            raise MappingError(
                first.where, f"{topic} has the type {other}, but the mapping says {first.type}", "type"
            )
    return first.type
