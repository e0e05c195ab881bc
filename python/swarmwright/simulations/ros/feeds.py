"""Topics with values that are read in each step."""

from __future__ import annotations

import math
import time
from typing import Any

from .fields import binary32, describe_missing_value, number_reader
from .mapping import SensorMapping
from .middleware import Middleware


class Value:
    """A number on a topic.

    Args:
        name: name for messages, such as `sensor left`.
        entry: the number's field, with its resolved topic.
        single: whether to round to binary32, the type of a controller's sensors.
        keeps: seconds of real time for which a value is valid, even in later steps; 0: only in its step,
            infinite: always.
        otherwise: the value before the first message; None: a message is required.
        remedy: how to avoid waiting for messages, in words.
    """

    def __init__(
        self,
        name: str,
        entry: SensorMapping,
        *,
        single: bool,
        keeps: float = 0.0,
        otherwise: float | None = None,
        remedy: str = "",
    ) -> None:
        self.name, self.entry, self.keeps, self._otherwise = name, entry, keeps, otherwise
        self.remedy = remedy
        self.number = math.nan if otherwise is None else otherwise
        self.came: float | None = None
        """Time of the latest value, on a real clock."""
        self.strange: str | None = None
        """A value in this step that is not finite; empty if a message had no value."""
        self._read = number_reader(entry)
        self._single = single

    def begin(self) -> None:
        """Start a step."""
        self.strange = None
        if not self.keeps:
            self.came = None

    def forget(self) -> None:
        """Start an episode."""
        self.came = self.strange = None
        self.number = math.nan if self._otherwise is None else self._otherwise

    def take(self, message: Any, now: float) -> None:
        """Read a message."""
        value = self._read(message)
        number = value if value is None or not self._single else binary32(value)
        if number is None or not math.isfinite(number):
            self.strange = "" if value is None else f"{value:g}"
            return
        self.number, self.came, self.strange = number, now, None

    def is_there(self, now: float) -> bool:
        """Return whether the value is valid."""
        if self.came is None:
            return self._otherwise is not None
        return self.keeps == 0.0 or now - self.came <= self.keeps


class Feed:
    """A topic and the values that are read from it."""

    def __init__(self, node: Middleware, topic: str, kind: str, depth: int) -> None:
        self.topic, self.kind, self._node = topic, kind, node
        self.values: list[Value] = []
        self.count = 0
        """Number of messages in the step."""
        self._subscription = node.subscribe(topic, kind, self._receive, depth)

    def __str__(self) -> str:
        return f"{self.topic} ({self.kind}; {', '.join(value.name for value in self.values)})"

    @property
    def remedy(self) -> str:
        """How to avoid waiting for messages, in words."""
        remedies = [value.remedy for value in self.values if math.isfinite(value.keeps)]
        return " and ".join(dict.fromkeys(remedies))

    @property
    def needed(self) -> bool:
        """Whether a message is required."""
        return not all(value.is_there(math.inf) for value in self.values)

    def begin(self) -> None:
        """Begin a step."""
        self.count = 0
        for value in self.values:
            value.begin()

    def forget(self) -> None:
        """Begin an episode."""
        self.count = 0
        for value in self.values:
            value.forget()

    def publishers(self) -> int:
        """Return the number of publishers of the topic."""
        return self._subscription.publishers()

    def wrong_type(self) -> str | None:
        """Return a different type with which other nodes use the topic; None if there is none."""
        return next((name for name in self._node.types(self.topic) if name != self.kind), None)

    def is_complete(self, messages: int, now: float) -> bool:
        """Return whether all values are valid.

        messages: number of messages required in the step, unless values of earlier steps are valid.
        """
        if not all(value.is_there(now) for value in self.values):
            return False
        return self.count >= messages or all(value.keeps for value in self.values)

    def explain_missing(self, messages: int, now: float, seconds: float) -> str:
        """Return why the feed is not complete."""
        where = f"{self.topic} ({self.kind})"
        other_type = self.wrong_type()
        if other_type is not None:
            return f"{self.topic} has the type {other_type}, but the definition says {self.kind}"
        for value in self.values:
            if value.strange is not None and not value.is_there(now):
                problem = f"{value.strange} came for {seconds:g} s, expected a finite number"
                if not value.strange:
                    problem = f"messages came for {seconds:g} s, but {describe_missing_value(value.entry)}"
                return f"{where}: {value.name}: {problem}"
        names = ", ".join(value.name for value in self.values)
        if not self.publishers():
            return f"{where}: no node publishes it; {names} cannot be read"
        if 0 < self.count < messages:
            return (
                f"{where}: {self.count} messages came within {seconds:g} s, expected {messages} "
                f"(simulation.step.messages); {names}"
            )
        return f"{where}: nothing came for {seconds:g} s; {names}"

    def _receive(self, message: Any) -> None:
        self.count += 1
        now = time.monotonic()
        for value in self.values:
            value.take(message, now)


class Feeds:
    """All received topics, each subscribed once."""

    def __init__(self, node: Middleware, messages: int) -> None:
        self._node, self._messages = node, messages
        self.all: list[Feed] = []

    def add(self, value: Value) -> Value:
        """Add a value to read; return it."""
        field = value.entry.topic_field
        feed = next((subscription for subscription in self.all if subscription.topic == field.topic), None)
        if feed is None:
            feed = Feed(self._node, field.topic, field.type, max(10, 2 * self._messages))
            self.all.append(feed)
        feed.values.append(value)
        return value

    def begin(self) -> None:
        """Start a step; earlier messages are ignored."""
        for feed in self.all:
            feed.begin()

    def forget(self) -> None:
        """Begin an episode."""
        for feed in self.all:
            feed.forget()

    def missing(self, messages: int | None = None) -> list[Feed]:
        """Return the topics that are not complete in the step."""
        now = time.monotonic()
        needed_messages = self._messages if messages is None else messages
        return [feed for feed in self.all if not feed.is_complete(needed_messages, now)]
