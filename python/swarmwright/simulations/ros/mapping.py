"""The mapping of an exported package, mapping.yaml, from fields of topics to sensors and actuators."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, replace
from typing import Callable, Container, Sequence, Tuple

Interval = Tuple[float, float]

_EXPONENT = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)[eE][-+]?[0-9]+")
"""A number that YAML 1.1, as in ROS 1, reads as text."""

_LARGEST = 3.4028234663852886e38
"""Largest number of binary32, the type of a controller's sensors."""


class MappingError(ValueError):
    """A mistake in the mapping.

    Args:
        where: its location, `sensors[0] (goal x)`.
        reason: the problem, with a remedy.
        key: the key with the mistake; empty for the whole entry.
    """

    def __init__(self, where: str, reason: str, key: str = "") -> None:
        super().__init__(f"{where}: {reason}")
        self.reason = reason
        self.key = key


@dataclass(frozen=True)
class TopicField:
    """A numeric field of a topic's messages."""

    where: str
    """Its location in the mapping, for messages: `sensors[0] (goal x)`."""
    topic: str
    type: str
    """Package and name, in the short form: `geometry_msgs/Twist`."""
    field: str
    """Empty if the mapping does not name it."""


@dataclass(frozen=True)
class SensorMapping:
    """A sensor is `clip(value * scale + offset)` in binary64, then rounded to binary32."""

    topic_field: TopicField
    """Without a topic if the value has another source."""
    scale: float
    offset: float
    clip: Interval | None
    timeout: float
    """Seconds without a message after which a sensor is silent."""
    infinite: float | None = None
    """The value if nothing is in range. None: the largest range in the message."""
    sector: Interval | None = None
    """Sector of a laser scan, in degrees, counter-clockwise from straight ahead. None: the whole scan."""
    mean: bool = False
    """Whether to use the mean of the ranges in the sector instead of the smallest."""
    random: bool = False
    """Whether the value is a new random number from 0 to 1 in each cycle."""
    seed: int | None = None
    """Seed of the random numbers. None: a different one at each start."""
    constant: float | None = None
    """Constant value, for a sensor that the robot lacks. None: the value has another source."""


@dataclass(frozen=True)
class ActuatorMapping:
    """The value `limits(sum * scale + offset)` is written to the field, in binary64.

    The sum is that of weight * actuator over the terms.
    """

    topic_field: TopicField
    scale: float
    offset: float
    limits: Interval | None
    terms: tuple[tuple[int, float], ...]
    """Actuators, from 0, and their weights, in the controller's order."""


@dataclass(frozen=True)
class Mapping:
    """The mapping between topics of a robot and a controller."""

    rate: float
    """Control cycles per second."""
    reset_after_silence: bool
    sensors: list[SensorMapping]
    """In the controller's order."""
    actuators: list[ActuatorMapping]
    """In the controller's order, by their first term."""


def read_mapping(value: object, sensors: Sequence[str], actuators: Sequence[str]) -> Mapping:
    """Parse a mapping.

    Args:
        value: the content of mapping.yaml, as plain values.
        sensors: names of the controller's sensors.
        actuators: names of its actuators.

    Raises MappingError for the first mistake.
    """
    block = _Block("mapping", value)
    block.get("rate")
    rate = block.positive("rate", 0)
    timeout = block.positive("timeout", 0.5)
    reset = block.flag("reset_after_silence")
    mapping = Mapping(
        rate,
        reset,
        _sensors(block, sensors, timeout),
        _actuators(block, actuators),
    )
    block.no_others()
    return mapping


def resolve_topics(mapping: Mapping, resolve: Callable[[str], str]) -> Mapping:
    """Return a mapping with full names of topics: `/robot_1/scan`.

    Raises MappingError for an invalid name, for which `resolve` raises ValueError.
    """

    def resolve_field(field: TopicField) -> TopicField:
        try:
            return replace(field, topic=resolve(field.topic))
        except ValueError as error:
            raise MappingError(field.where, f"topic '{field.topic}': {error}", "topic") from None

    return replace(
        mapping,
        sensors=[
            replace(sensor, topic_field=resolve_field(sensor.topic_field))
            if sensor.topic_field.topic
            else sensor
            for sensor in mapping.sensors
        ],
        actuators=[
            replace(actuator, topic_field=resolve_field(actuator.topic_field))
            for actuator in mapping.actuators
        ],
    )


def choice(words: Sequence[str]) -> str:
    """Return words as `a, b or c`."""
    if len(words) < 2:
        return "".join(words)
    return f"{', '.join(words[:-1])} or {words[-1]}"


def short_type(name: str) -> str:
    """Return a type of messages or services in the short form: `geometry_msgs/Twist`."""
    parts = name.split("/")
    if len(parts) == 3 and parts[1] in ("msg", "srv"):
        return f"{parts[0]}/{parts[2]}"
    return name


def format_value(value: object) -> str:
    """Return a value as text for messages."""
    if value is None:
        return "nothing"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, (int, float)):
        try:
            return f"{float(value):g}"
        except OverflowError:
            return str(value)
    if isinstance(value, dict):
        return (
            "{" + ", ".join(f"{key}: {format_value(item)}" for key, item in _sort_keys(value).items()) + "}"
        )
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(map(format_value, value)) + "]"
    return f"'{value}'" if isinstance(value, str) else str(value)


def _sort_keys(value: dict[object, object]) -> dict[str, object]:
    named = {key if isinstance(key, str) else format_value(key): item for key, item in value.items()}
    return {key: named[key] for key in sorted(named)}


class _Block:
    """A block of the mapping; keys that were not read are mistakes."""

    def __init__(self, where: str, value: object) -> None:
        self.where = where
        self._keys: list[str] = []
        if not isinstance(value, dict):
            raise self.mistake("expected keys and values")
        self._value = _sort_keys(value)

    def mistake(self, reason: str, key: str = "") -> MappingError:
        return MappingError(self.where, reason, key)

    def has(self, key: str) -> bool:
        if key not in self._keys:
            self._keys.append(key)
        return key in self._value

    def get(self, key: str) -> object:
        if not self.has(key):
            raise self.mistake(f"{key} is missing", key)
        return self._value[key]

    def text(self, key: str) -> str:
        value = self.get(key)
        if not isinstance(value, str):
            raise self.mistake(f"{key}: {format_value(value)} found, expected text", key)
        if not value:
            raise self.mistake(f"{key} is empty", key)
        return value

    def number(self, key: str, otherwise: float) -> float:
        return self._finite(key, self._value[key]) if self.has(key) else otherwise

    def single(self, key: str) -> float:
        value = self._finite(key, self.get(key))
        if abs(value) > _LARGEST:
            raise self.mistake(f"{key}: {format_value(value)} found, expected at most 3.4e38", key)
        return value

    def positive(self, key: str, otherwise: float) -> float:
        value = self.number(key, otherwise)
        if not value > 0:
            raise self.mistake(f"{key}: {format_value(value)} found, expected more than 0", key)
        return value

    def flag(self, key: str) -> bool:
        if not self.has(key):
            return False
        value = self._value[key]
        if not isinstance(value, bool):
            raise self.mistake(f"{key}: {format_value(value)} found, expected true or false", key)
        return value

    def interval(self, key: str, turn: float = 0.0) -> Interval | None:
        """Return two numbers; turn: a full turn for directions, 0 for other numbers."""
        if not self.has(key):
            return None
        value = self._value[key]
        if not isinstance(value, (list, tuple)) or len(value) != 2:
            raise self.mistake(f"{key}: expected two numbers [low, high]", key)
        low, high = self._finite(key, value[0]), self._finite(key, value[1])
        if not low < high:
            remedy = ""
            if high < low < high + turn:
                remedy = f"; write {format_value([low - turn, high])} or {format_value([low, high + turn])}"
            raise self.mistake(f"{key}: the first number must be below the second{remedy}", key)
        return low, high

    def weights(self, key: str) -> dict[str, float]:
        value = self.get(key)
        if not isinstance(value, dict) or not value:
            raise self.mistake(
                f"{key}: {format_value(value)} found, expected weights by name, such as "
                f"{{left: 0.5, right: 0.5}}",
                key,
            )
        return {name: self._finite(f"{key}.{name}", weight) for name, weight in _sort_keys(value).items()}

    def seed(self, key: str) -> int | None:
        if not self.has(key):
            return None
        value = self.number(key, 0)
        if not (0 <= value < 2**53 and value == math.floor(value)):
            raise self.mistake(
                f"{key}: {format_value(self.get(key))} found, expected a whole number from 0 to 2^53 - 1",
                key,
            )
        return int(value)

    def no_others(self) -> None:
        for key in self._value:
            if key not in self._keys:
                raise self.mistake(f"unknown key '{key}'; expected {choice(self._keys)}")

    def _finite(self, key: str, value: object) -> float:
        number, problem = math.nan, "found"
        if isinstance(value, (int, float)) and not isinstance(value, bool):
            try:
                number = float(value)
            except OverflowError:
                number = math.inf
        elif isinstance(value, str) and _EXPONENT.fullmatch(value):
            number = float(value)
        elif isinstance(value, str):
            problem = "is text"
        if not math.isfinite(number):
            raise self.mistake(f"{key}: {format_value(value)} {problem}, expected a number", key)
        return number


def _read_field(block: _Block) -> TopicField:
    topic, kind = block.text("topic"), block.text("type")
    return TopicField(block.where, topic, short_type(kind), block.text("field") if block.has("field") else "")


def _sensor(block: _Block, timeout: float) -> SensorMapping:
    if block.has("source"):
        source = block.text("source")
        nowhere = TopicField(block.where, "", "", "")
        if source == "constant":
            return SensorMapping(nowhere, 1, 0, None, timeout, constant=block.single("value"))
        if source != "random":
            raise block.mistake(f"source: '{source}' found, expected random or constant", "source")
        return SensorMapping(nowhere, 1, 0, None, timeout, random=True, seed=block.seed("seed"))
    sensor = SensorMapping(
        topic_field=_read_field(block),
        scale=block.number("scale", 1),
        offset=block.number("offset", 0),
        clip=block.interval("clip"),
        timeout=block.positive("timeout", timeout),
    )
    if sensor.topic_field.type == "sensor_msgs/LaserScan":
        sector = block.interval("sector", turn=360)
        reduce = block.text("reduce") if block.has("reduce") else "min"
        if reduce not in ("min", "mean"):
            raise block.mistake(f"reduce: '{reduce}' found, expected min or mean", "reduce")
        sensor = replace(sensor, sector=sector, mean=reduce == "mean")
    if sensor.topic_field.type in ("sensor_msgs/LaserScan", "sensor_msgs/Range") and block.has("infinite"):
        sensor = replace(sensor, infinite=block.number("infinite", 0))
    return sensor


def _actuator(block: _Block, terms: tuple[tuple[int, float], ...]) -> ActuatorMapping:
    return ActuatorMapping(
        terms=terms,
        topic_field=_read_field(block),
        scale=block.number("scale", 1),
        offset=block.number("offset", 0),
        limits=block.interval("limits"),
    )


def _get_list(mapping: _Block, kind: str) -> Sequence[object]:
    listed = mapping.get(f"{kind}s")
    if not isinstance(listed, (list, tuple)):
        raise mapping.mistake(f"{kind}s: expected a list, each entry begun by '- '")
    return listed


def _index(block: _Block, kind: str, names: Sequence[str], name: str) -> int:
    if name not in names:
        raise block.mistake(f"the controller has no {kind} '{name}'; it has {choice(names)}")
    return names.index(name)


def _check_all(kind: str, names: Sequence[str], used: Container[int]) -> None:
    for index, name in enumerate(names):
        if index not in used:
            raise MappingError(f"{kind}s", f"'{name}' is missing; every {kind} needs an entry")


def _sensors(mapping: _Block, names: Sequence[str], timeout: float) -> list[SensorMapping]:
    """Return the entries of all sensors, in the controller's order."""
    sensors: dict[int, SensorMapping] = {}
    for number, value in enumerate(_get_list(mapping, "sensor")):
        block = _Block(f"sensors[{number}]", value)
        name = block.text("sensor")
        index = _index(block, "sensor", names, name)
        block.where += f" ({name})"
        if index in sensors:
            raise block.mistake("is mapped twice")
        sensors[index] = _sensor(block, timeout)
        block.no_others()
    _check_all("sensor", names, sensors)
    return [sensors[index] for index in range(len(names))]


def _actuators(mapping: _Block, names: Sequence[str]) -> list[ActuatorMapping]:
    """Return the entries, each for a single actuator or for several with weights."""
    actuators: list[ActuatorMapping] = []
    used: set[int] = set()
    alone: set[int] = set()
    for number, value in enumerate(_get_list(mapping, "actuator")):
        block = _Block(f"actuators[{number}]", value)
        is_sum = block.has("actuators")
        weights = block.weights("actuators") if is_sum else {block.text("actuator"): 1.0}
        terms = tuple(
            sorted((_index(block, "actuator", names, name), weight) for name, weight in weights.items())
        )
        block.where += f" ({', '.join(names[index] for index, _ in terms)})"
        if not is_sum and terms[0][0] in alone:
            raise block.mistake("is mapped twice")
        if not is_sum:
            alone.add(terms[0][0])
        used.update(index for index, _ in terms)
        actuators.append(_actuator(block, terms))
        block.no_others()
    _check_all("actuator", names, used)
    return sorted(actuators, key=lambda term: term.terms[0][0])
