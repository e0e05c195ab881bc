"""What mapping.yaml says: which field of which topic is which sensor or actuator of a controller."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Callable, Sequence, Tuple, TypeVar

Interval = Tuple[float, float]


class MappingError(ValueError):
    """A mistake in the mapping: where it is and how to repair it."""


@dataclass(frozen=True)
class Place:
    """A number on a topic."""

    where: str
    """Its place in the mapping, for messages: `sensors[0] (goal x)`."""
    topic: str
    type: str
    """Package and name, in the short spelling: `geometry_msgs/Twist`."""
    field: str
    """Empty where the mapping names none."""


@dataclass(frozen=True)
class SensorMapping:
    """A sensor is `clip(value * scale + offset)` in binary64, then rounded to binary32."""

    place: Place
    scale: float
    offset: float
    clip: Interval | None
    timeout: float
    """Seconds after which a sensor from which nothing has come is silent."""
    infinite: float | None = None
    """The value where nothing is in range. None: the largest range that the message names."""
    sector: Interval | None = None
    """Of a laser scan, in degrees, counter-clockwise from straight ahead. None: all of it."""
    mean: bool = False
    """Of the ranges in the sector, instead of the smallest."""


@dataclass(frozen=True)
class ActuatorMapping:
    """What is written to the field is `limits(actuator * scale + offset)`, in binary64."""

    place: Place
    scale: float
    offset: float
    limits: Interval | None


@dataclass(frozen=True)
class Mapping:
    """Topics of a robot, for a controller."""

    rate: float
    """Control cycles per second."""
    reset_after_silence: bool
    sensors: list[SensorMapping]
    """In the controller's order."""
    actuators: list[ActuatorMapping]
    """In the controller's order."""


def read_mapping(value: object, sensors: Sequence[str], actuators: Sequence[str]) -> Mapping:
    """Return what a mapping says.

    Args:
        value: the content of mapping.yaml, as plain values.
        sensors: the controller's sensors, by name.
        actuators: its actuators, by name.

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
        _entries(block, "sensor", sensors, lambda entry: _sensor(entry, timeout)),
        _entries(block, "actuator", actuators, _actuator),
    )
    block.no_others()
    return mapping


def resolved(mapping: Mapping, resolve: Callable[[str], str]) -> Mapping:
    """Return a mapping with topics by their full names: `/robot_1/scan`.

    Raises MappingError for what is no name, for which `resolve` raises ValueError.
    """

    def full(place: Place) -> Place:
        try:
            return replace(place, topic=resolve(place.topic))
        except ValueError as error:
            raise MappingError(f"{place.where}: topic '{place.topic}': {error}") from None

    return replace(
        mapping,
        sensors=[replace(one, place=full(one.place)) for one in mapping.sensors],
        actuators=[replace(one, place=full(one.place)) for one in mapping.actuators],
    )


def choice(words: Sequence[str]) -> str:
    """Return words as `a, b or c`."""
    if len(words) < 2:
        return "".join(words)
    return f"{', '.join(words[:-1])} or {words[-1]}"


def short_type(name: str) -> str:
    """Return a type of messages or services in the short spelling: `geometry_msgs/Twist`."""
    parts = name.split("/")
    if len(parts) == 3 and parts[1] in ("msg", "srv"):
        return f"{parts[0]}/{parts[2]}"
    return name


def shown(value: object) -> str:
    """Return a value as messages repeat it."""
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
        return "{" + ", ".join(f"{key}: {shown(one)}" for key, one in _sorted(value).items()) + "}"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(map(shown, value)) + "]"
    return str(value)


def _sorted(value: dict[object, object]) -> dict[str, object]:
    named = {key if isinstance(key, str) else shown(key): one for key, one in value.items()}
    return {key: named[key] for key in sorted(named)}


class _Block:
    """One block of the mapping: its keys are asked for, and those that nobody asked for are mistakes."""

    def __init__(self, where: str, value: object) -> None:
        self.where = where
        self._known: list[str] = []
        if not isinstance(value, dict):
            raise self.mistake("expected keys and values")
        self._value = _sorted(value)

    def mistake(self, reason: str) -> MappingError:
        return MappingError(f"{self.where}: {reason}")

    def has(self, key: str) -> bool:
        if key not in self._known:
            self._known.append(key)
        return key in self._value

    def get(self, key: str) -> object:
        if not self.has(key):
            raise self.mistake(f"{key} is missing")
        return self._value[key]

    def text(self, key: str) -> str:
        value = self.get(key)
        if not isinstance(value, str):
            raise self.mistake(f"{key}: {shown(value)} found, expected text")
        if not value:
            raise self.mistake(f"{key} is empty")
        return value

    def number(self, key: str, otherwise: float) -> float:
        return self._finite(key, self._value[key]) if self.has(key) else otherwise

    def positive(self, key: str, otherwise: float) -> float:
        value = self.number(key, otherwise)
        if not value > 0:
            raise self.mistake(f"{key}: {shown(value)} found, expected more than 0")
        return value

    def flag(self, key: str) -> bool:
        if not self.has(key):
            return False
        value = self._value[key]
        if not isinstance(value, bool):
            raise self.mistake(f"{key}: {shown(value)} found, expected true or false")
        return value

    def interval(self, key: str) -> Interval | None:
        if not self.has(key):
            return None
        value = self._value[key]
        if not isinstance(value, (list, tuple)) or len(value) != 2:
            raise self.mistake(f"{key}: expected two numbers [low, high]")
        low, high = self._finite(key, value[0]), self._finite(key, value[1])
        if not low < high:
            raise self.mistake(f"{key}: the first number must be below the second")
        return low, high

    def no_others(self) -> None:
        for key in self._value:
            if key not in self._known:
                raise self.mistake(f"unknown key '{key}'; expected {choice(self._known)}")

    def _finite(self, key: str, value: object) -> float:
        number = math.nan
        if isinstance(value, (int, float)) and not isinstance(value, bool):
            try:
                number = float(value)
            except OverflowError:
                number = math.inf
        if not math.isfinite(number):
            raise self.mistake(f"{key}: {shown(value)} found, expected a number")
        return number


def _place(block: _Block) -> Place:
    topic, kind = block.text("topic"), block.text("type")
    return Place(block.where, topic, short_type(kind), block.text("field") if block.has("field") else "")


def _sensor(block: _Block, timeout: float) -> SensorMapping:
    found = SensorMapping(
        place=_place(block),
        scale=block.number("scale", 1),
        offset=block.number("offset", 0),
        clip=block.interval("clip"),
        timeout=block.positive("timeout", timeout),
    )
    if found.place.type == "sensor_msgs/LaserScan":
        sector = block.interval("sector")
        reduce = block.text("reduce") if block.has("reduce") else "min"
        if reduce not in ("min", "mean"):
            raise block.mistake(f"reduce: '{reduce}' found, expected min or mean")
        found = replace(found, sector=sector, mean=reduce == "mean")
    if found.place.type in ("sensor_msgs/LaserScan", "sensor_msgs/Range") and block.has("infinite"):
        found = replace(found, infinite=block.number("infinite", 0))
    return found


def _actuator(block: _Block) -> ActuatorMapping:
    return ActuatorMapping(
        place=_place(block),
        scale=block.number("scale", 1),
        offset=block.number("offset", 0),
        limits=block.interval("limits"),
    )


_Entry = TypeVar("_Entry")


def _entries(
    mapping: _Block, kind: str, names: Sequence[str], read: Callable[[_Block], _Entry]
) -> list[_Entry]:
    """Return entries that name the controller's sensors or actuators, in the controller's order."""
    listed = mapping.get(f"{kind}s")
    if not isinstance(listed, (list, tuple)):
        raise mapping.mistake(f"{kind}s: expected a list, each entry begun by '- '")
    found: dict[str, _Entry] = {}
    for index, value in enumerate(listed):
        block = _Block(f"{kind}s[{index}]", value)
        name = block.text(kind)
        if name not in names:
            raise block.mistake(f"the controller has no {kind} '{name}'; it has {choice(names)}")
        block.where += f" ({name})"
        if name in found:
            raise block.mistake("is mapped twice")
        found[name] = read(block)
        block.no_others()
    for name in names:
        if name not in found:
            raise MappingError(f"{kind}s: '{name}' is missing; every {kind} needs an entry")
    return [found[name] for name in names]
