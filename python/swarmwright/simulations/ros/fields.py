"""Numeric fields of messages, for sensors and commands.

Messages are read and written by attributes, so that the same functions work with rospy, rclpy and Cyclone
DDS.
"""

from __future__ import annotations

import math
import struct
from typing import Any, Callable, Optional, Sequence, TypeVar

from .mapping import ActuatorMapping, Interval, MappingError, SensorMapping, TopicField, choice

Reader = Callable[[Any], Optional[float]]
"""Returns a sensor's value in a message, None if there is none."""
Writer = Callable[[Any, float], None]

_Use = TypeVar("_Use")
_DEGREE = math.pi / 180
_TOLERANCE = 1e-4
"""Tolerance in degrees for rounding of an angle at the end of a sector."""
_LINEAR_ANGULAR = tuple(f"{part}.{axis}" for part in ("linear", "angular") for axis in "xyz")
_POSITION = ("position.x", "position.y", "position.z")


class SameFieldError(MappingError):
    """Two actuators write the same field of a topic; `actuator` is the later one."""

    def __init__(self, actuator: ActuatorMapping, first: TopicField) -> None:
        super().__init__(actuator.topic_field.where, f"writes the same field as {first.where}", "field")
        self.actuator = actuator


def reader(sensor: SensorMapping) -> Reader:
    """Return a function that reads a sensor from a message: a finite binary32 number, or None.

    Raises MappingError like `number_reader`.
    """
    read = number_reader(sensor)

    def read_single(message: Any) -> float | None:
        value = read(message)
        return None if value is None else binary32(value)

    return read_single


def number_reader(sensor: SensorMapping) -> Reader:
    """Return a function that reads a binary64 number, possibly NaN or infinite, from a message, or None.

    Raises MappingError for an unknown type or field.
    """
    field = sensor.topic_field
    if field.type not in READERS:
        raise _unknown_type(field, list(READERS))
    return scale_reader(_field(READERS[field.type], field)[1](sensor), sensor)


def scale_reader(read: Reader, sensor: SensorMapping) -> Reader:
    """Return a reader that applies the sensor's scale, offset and clip."""

    def number(message: Any) -> float | None:
        value = read(message)
        return None if value is None else clip(value * sensor.scale + sensor.offset, sensor.clip)

    return number


def writers(
    actuators: Sequence[ActuatorMapping],
) -> Callable[[Any, Sequence[float]], None]:
    """Return a function that writes the actuators of a topic to a message of zeros.

    Args:
        actuators: actuators of the topic, all of the same type. The returned function takes the values of all
            actuators of the controller.

    Raises MappingError for an unknown type or field; SameFieldError if two actuators write the same field.
    """
    uses: list[tuple[ActuatorMapping, Writer]] = []
    first: dict[str, TopicField] = {}
    for actuator in actuators:
        field = actuator.topic_field
        if field.type not in WRITERS:
            raise _unknown_type(field, list(WRITERS))
        name, write = _field(WRITERS[field.type], field)
        if name in first:
            raise SameFieldError(actuator, first[name])
        first[name] = field
        uses.append((actuator, write))

    def write_all(message: Any, values: Sequence[float]) -> None:
        for actuator, write in uses:
            value = _total(values, actuator)
            write(message, clip(value * actuator.scale + actuator.offset, actuator.limits))

    return write_all


def _total(values: Sequence[float], actuator: ActuatorMapping) -> float:
    """Return the weighted sum of actuators, added in order."""
    total = 0.0
    for index, weight in actuator.terms:
        total += weight * values[index]
    return total


def describe_missing_value(sensor: SensorMapping) -> str:
    """Return a description of messages without a value for a sensor."""
    within = "" if sensor.sector is None else " within [{:g}, {:g}] degrees".format(*sensor.sector)
    return f"none has a usable value{within}"


def has_stamp(kind: str) -> bool:
    """Return whether messages of a type have a header with a time."""
    return kind == "geometry_msgs/TwistStamped"


def clip(value: float, interval: Interval | None) -> float:
    """Clip a value to an interval; NaN stays NaN."""
    if interval is None or math.isnan(value):
        return value
    return min(max(value, interval[0]), interval[1])


def binary32(value: float) -> float | None:
    """Round a number to binary32; return None if it is not finite before or after rounding."""
    try:
        (rounded,) = struct.unpack("f", struct.pack("f", value))
    except OverflowError:
        return None
    return float(rounded) if math.isfinite(rounded) else None


def _field(fields: dict[str, _Use], field: TopicField) -> tuple[str, _Use]:
    """Return a field's name and its function; the mapping need not name the only field of a type."""
    if not field.field and len(fields) == 1:
        return next(iter(fields.items()))
    if field.field in fields:
        return field.field, fields[field.field]
    problem = f"'{field.field}' is not in {field.type}" if field.field else "is missing"
    raise MappingError(field.where, f"field {problem}; expected {choice(sorted(fields))}", "field")


def _unknown_type(field: TopicField, types: list[str]) -> MappingError:
    reason = f"the type '{field.type}' is unknown; expected {choice(types)}"
    return MappingError(field.where, reason, "type")


def _range(value: float, smallest: float, largest: float, sensor: SensorMapping) -> float | None:
    """Return a range as defined by REP 117; None if it is not a measurement.

    Beyond the largest range, nothing is detected; minus infinity is too close to be measured; NaN and other
    numbers below the smallest range are not measurements. A largest range of 0 is unknown.
    """
    limited = largest > 0 and math.isfinite(largest)
    if value == -math.inf:
        return smallest
    if value == math.inf or (limited and value > largest):
        if sensor.infinite is not None:
            return sensor.infinite
        return largest if limited else None
    if math.isnan(value) or value < smallest:
        return None
    return value


def _is_within(angle: float, sector: Interval) -> bool:
    """Return whether an angle lies in a sector, in degrees, modulo full turns.

    The sector includes its ends, with a tolerance for rounding.
    """
    begin = angle - sector[0] + _TOLERANCE
    return begin - 360 * math.floor(begin / 360) <= sector[1] - sector[0] + 2 * _TOLERANCE


def _scan(sensor: SensorMapping) -> Reader:
    """Return a reader of the smallest range of a sector, or the mean, summed in the message's order."""
    last: tuple[object, Sequence[int]] = (None, ())

    def beams(scan: Any, count: int) -> Sequence[int]:
        nonlocal last
        if sensor.sector is None:
            return range(count)
        shape = (count, scan.angle_min, scan.angle_increment)
        if shape != last[0]:
            angles = [(scan.angle_min + index * scan.angle_increment) / _DEGREE for index in range(count)]
            last = (shape, [index for index, angle in enumerate(angles) if _sees(angle, sensor.sector)])
        return last[1]

    def read(scan: Any) -> float | None:
        total, least, count = 0.0, math.inf, 0
        for index in beams(scan, len(scan.ranges)):
            value = _range(float(scan.ranges[index]), scan.range_min, scan.range_max, sensor)
            if value is None:
                continue
            total += value
            least = min(least, value)
            count += 1
        if not count:
            return None
        return total / count if sensor.mean else least

    return read


def _sees(angle: float, sector: Interval) -> bool:
    return math.isfinite(angle) and _is_within(angle, sector)


def _sonar(sensor: SensorMapping) -> Reader:
    return lambda m: _range(float(m.range), m.min_range, m.max_range, sensor)


def _yaw(path: str) -> Callable[[SensorMapping], Reader]:
    get = _getter(path)

    def read(message: Any) -> float:
        q = get(message)
        return math.atan2(2 * (q.w * q.z + q.x * q.y), 1 - 2 * (q.y * q.y + q.z * q.z))

    return lambda _: read


def _getter(path: str) -> Callable[[Any], Any]:
    names = path.split(".")

    def get(message: Any) -> Any:
        for name in names:
            message = getattr(message, name)
        return message

    return get


def _number(path: str) -> Callable[[SensorMapping], Reader]:
    get = _getter(path)
    return lambda _: lambda message: float(get(message))


def _setter(path: str) -> Writer:
    *names, last = path.split(".")
    get = _getter(".".join(names)) if names else lambda message: message
    return lambda message, value: setattr(get(message), last, value)


def _single(message: Any, value: float) -> None:
    """Write to a binary32 field; larger numbers become infinity."""
    message.data = math.copysign(math.inf, value) if binary32(value) is None else value


def _numbers(begin: str, names: Sequence[str]) -> dict[str, Callable[[SensorMapping], Reader]]:
    return {begin + name: _number(begin + name) for name in names}


def _pose(begin: str) -> dict[str, Callable[[SensorMapping], Reader]]:
    return {**_numbers(begin, _POSITION), "yaw": _yaw(f"{begin}orientation")}


READERS: dict[str, dict[str, Callable[[SensorMapping], Reader]]] = {
    "sensor_msgs/LaserScan": {"ranges": _scan},
    "sensor_msgs/Range": {"range": _sonar},
    "nav_msgs/Odometry": {**_pose("pose.pose."), **_numbers("twist.twist.", _LINEAR_ANGULAR)},
    "geometry_msgs/Twist": _numbers("", _LINEAR_ANGULAR),
    "geometry_msgs/TwistStamped": _numbers("twist.", _LINEAR_ANGULAR),
    "geometry_msgs/PoseStamped": _pose("pose."),
    "geometry_msgs/PoseWithCovarianceStamped": _pose("pose.pose."),
    "std_msgs/Float32": _numbers("", ["data"]),
    "std_msgs/Float64": _numbers("", ["data"]),
}
"""Type -> field -> function that makes a reader for a sensor."""

STATES: dict[str, Callable[[SensorMapping], Reader]] = {
    **_pose("pose."),
    **_numbers("twist.", _LINEAR_ANGULAR),
}
"""Field -> function that makes a reader for an entity's state, of `simulation_interfaces`."""

WRITERS: dict[str, dict[str, Writer]] = {
    "geometry_msgs/Twist": {name: _setter(name) for name in _LINEAR_ANGULAR},
    "geometry_msgs/TwistStamped": {f"twist.{name}": _setter(f"twist.{name}") for name in _LINEAR_ANGULAR},
    "std_msgs/Float32": {"data": _single},
    "std_msgs/Float64": {"data": _setter("data")},
}
"""Type -> field -> function that writes a command."""
