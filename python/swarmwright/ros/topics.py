"""Sensors from topics, actuators to topics, as a mapping says."""

from __future__ import annotations

from typing import Any, Callable, Sequence, Union

from .fields import Reader, reader, stamped, writers
from .mapping import ActuatorMapping, MappingError, Place, SensorMapping
from .middleware import Middleware, Publisher

_Entries = Sequence[Union[SensorMapping, ActuatorMapping]]


class Inputs:
    """The latest value of every sensor, and when it came.

    Args:
        node: subscribes to the topics.
        sensors: with resolved topics.

    Raises MappingError for a type or a field that is not known, or that the topic does not have.
    """

    def __init__(self, node: Middleware, sensors: Sequence[SensorMapping]) -> None:
        self._node, self._sensors = node, list(sensors)
        self.values = [0.0] * len(self._sensors)
        """By sensor, numbers of binary32; 0 before the first one."""
        self.times: list[float | None] = [None] * len(self._sensors)
        """By sensor, when its value came, on the node's clock; None before the first one."""
        for topic in _topics(self._sensors):
            kind = _type_of(node, topic, self._sensors)
            reads = [(at, reader(one)) for at, one in enumerate(self._sensors) if one.place.topic == topic]
            node.subscribe(topic, kind, self._receiver(reads))

    def _receiver(self, reads: list[tuple[int, Reader]]) -> Callable[[Any], None]:
        def receive(message: Any) -> None:
            for at, read in reads:
                value = read(message)
                # NaN and infinities are no measurements: the sensor is as silent as if they had not come.
                if value is not None:
                    self.values[at], self.times[at] = value, self._node.now()

        return receive

    def silent(self) -> list[str]:
        """Return the topics of sensors from which nothing has come for longer than their time-out."""
        now = self._node.now()
        found = []
        for sensor, time in zip(self._sensors, self.times):
            # What came later than now came before a simulation began anew.
            if time is None or now < time or now - time > sensor.timeout:
                found.append(sensor.place.topic)
        return list(dict.fromkeys(found))

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
            chosen = [at for at, one in enumerate(self._actuators) if one.place.topic == topic]
            write = writers([self._actuators[at] for at in chosen])
            publisher = node.publisher(topic, kind)
            self.publishers.append((topic, kind, publisher))
            self._topics.append(self._sender(publisher, chosen, write, stamped(kind)))

    def _sender(
        self,
        publisher: Publisher,
        chosen: list[int],
        write: Callable[[Any, Sequence[float]], None],
        stamp: bool,
    ) -> Callable[[Sequence[float] | None], None]:
        def send(values: Sequence[float] | None) -> None:
            message = publisher.new()
            if stamp:
                self._node.stamp(message.header)
            if values is not None:
                write(message, [values[at] for at in chosen])
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
    return list(dict.fromkeys(entry.place.topic for entry in entries))


def _type_of(node: Middleware, topic: str, entries: _Entries) -> str:
    """Return the type of a topic: all its entries have it, and nobody else uses it with another one."""
    places: list[Place] = [entry.place for entry in entries if entry.place.topic == topic]
    first = places[0]
    for place in places:
        if place.type != first.type:
            raise MappingError(
                f"{place.where}: {topic} has the type {first.type} at {first.where} and {place.type} here; "
                "a topic has one type"
            )
    for other in node.types(topic):
        if other != first.type:
            raise MappingError(
                f"{first.where}: {topic} has the type {other}, but the mapping says {first.type}"
            )
    return first.type
