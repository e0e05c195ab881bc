"""Fields of messages as numbers: what can be sensed from a topic and what can be commanded on one.

Messages are read and written by their attributes, so the same functions serve rospy, rclpy and Cyclone DDS.
"""

from __future__ import annotations

import math
import struct
from typing import Any, Callable, Optional, Sequence, TypeVar

from .mapping import ActuatorMapping, Interval, MappingError, Place, SensorMapping, choice

Reader = Callable[[Any], Optional[float]]
"""Returns what a message says about a sensor, None where it says nothing."""
Writer = Callable[[Any, float], None]

_Use = TypeVar("_Use")
_DEGREE = math.pi / 180
_TOLERANCE = 1e-4
"""Degrees by which rounding may move an angle out of a sector."""
_LINEAR_ANGULAR = tuple(f"{part}.{axis}" for part in ("linear", "angular") for axis in "xyz")
_POSITION = ("position.x", "position.y", "position.z")


class SameFieldError(MappingError):
    """Two actuators write the same field of a topic; `actuator` is the later one."""

    def __init__(self, actuator: ActuatorMapping, first: Place) -> None:
        super().__init__(actuator.place.where, f"writes the same field as {first.where}", "field")
        self.actuator = actuator


def reader(sensor: SensorMapping) -> Reader:
    """Return what reads a sensor from a message: a finite number of binary32, or None.

    Raises MappingError as `number_reader`.
    """
    read = number_reader(sensor)

    def sensed(message: Any) -> float | None:
        value = read(message)
        return None if value is None else binary32(value)

    return sensed


def number_reader(sensor: SensorMapping) -> Reader:
    """Return what reads a number of binary64 from a message, which may be NaN or infinite, or None.

    Raises MappingError for a type that is not known, or a field that it does not have.
    """
    place = sensor.place
    if place.type not in READERS:
        raise _unknown_type(place, list(READERS))
    return scaled(_field(READERS[place.type], place)[1](sensor), sensor)


def scaled(read: Reader, sensor: SensorMapping) -> Reader:
    """Return what reads a number with the sensor's scale, offset and clip."""

    def number(message: Any) -> float | None:
        value = read(message)
        return None if value is None else clipped(value * sensor.scale + sensor.offset, sensor.clip)

    return number


def writers(
    actuators: Sequence[ActuatorMapping],
) -> Callable[[Any, Sequence[float]], None]:
    """Return what writes the actuators of one topic to a message that has zeros.

    Args:
        actuators: those of the topic, all of one type. What is returned takes all of the controller's.

    Raises MappingError for a type that is not known, or a field that it does not have; SameFieldError for a
    field that two write.
    """
    uses: list[tuple[ActuatorMapping, Writer]] = []
    first: dict[str, Place] = {}
    for actuator in actuators:
        place = actuator.place
        if place.type not in WRITERS:
            raise _unknown_type(place, list(WRITERS))
        name, write = _field(WRITERS[place.type], place)
        if name in first:
            raise SameFieldError(actuator, first[name])
        first[name] = place
        uses.append((actuator, write))

    def written(message: Any, values: Sequence[float]) -> None:
        for actuator, write in uses:
            value = _total(values, actuator)
            write(message, clipped(value * actuator.scale + actuator.offset, actuator.limits))

    return written


def _total(values: Sequence[float], actuator: ActuatorMapping) -> float:
    """Return the weighted sum of actuators, added one after the other."""
    total = 0.0
    for index, weight in actuator.terms:
        total += weight * values[index]
    return total


def no_value(sensor: SensorMapping) -> str:
    """Return what is said of messages that have nothing for a sensor."""
    within = "" if sensor.sector is None else " within [{:g}, {:g}] degrees".format(*sensor.sector)
    return f"none has a usable value{within}"


def stamped(kind: str) -> bool:
    """Return whether messages of a type begin with a header that has the time."""
    return kind == "geometry_msgs/TwistStamped"


def clipped(value: float, interval: Interval | None) -> float:
    """Return a value within an interval; NaN remains NaN."""
    if interval is None or math.isnan(value):
        return value
    return min(max(value, interval[0]), interval[1])


def binary32(value: float) -> float | None:
    """Return a number rounded to binary32; None for one that is not finite, or is not when it is rounded."""
    try:
        (rounded,) = struct.unpack("f", struct.pack("f", value))
    except OverflowError:
        return None
    return float(rounded) if math.isfinite(rounded) else None


def _field(fields: dict[str, _Use], place: Place) -> tuple[str, _Use]:
    """Return a field's name and its use; where a type has only one, the mapping need not name it."""
    if not place.field and len(fields) == 1:
        return next(iter(fields.items()))
    if place.field in fields:
        return place.field, fields[place.field]
    what = f"'{place.field}' is not in {place.type}" if place.field else "is missing"
    raise MappingError(place.where, f"field {what}; expected {choice(sorted(fields))}", "field")


def _unknown_type(place: Place, known: list[str]) -> MappingError:
    reason = f"the type '{place.type}' is not known here; expected {choice(known)}"
    return MappingError(place.where, reason, "type")


def _range(value: float, smallest: float, largest: float, sensor: SensorMapping) -> float | None:
    """Return a range as REP 117 defines it; None for what is not a measurement.

    Beyond the largest nothing is seen, minus infinity is too close to be measured; NaN and other numbers
    below the smallest are no measurements. A largest range of 0 is not known.
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


def _within(angle: float, sector: Interval) -> bool:
    """Return whether an angle lies in a sector, in degrees, whatever turns they count from.

    Ends belong to it, and so does what rounding moved beyond them.
    """
    begin = angle - sector[0] + _TOLERANCE
    return begin - 360 * math.floor(begin / 360) <= sector[1] - sector[0] + 2 * _TOLERANCE


def _scan(sensor: SensorMapping) -> Reader:
    """Return what reads the smallest range of a sector, or the mean, summed in the order of the message."""
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
    return math.isfinite(angle) and _within(angle, sector)


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
    """Write to a field of binary32, which has no number beyond its largest but infinity."""
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
"""By type and field, what makes a reader for a sensor."""

STATES: dict[str, Callable[[SensorMapping], Reader]] = {
    **_pose("pose."),
    **_numbers("twist.", _LINEAR_ANGULAR),
}
"""By field, what makes a reader for an entity's state, of `simulation_interfaces`."""

WRITERS: dict[str, dict[str, Writer]] = {
    "geometry_msgs/Twist": {name: _setter(name) for name in _LINEAR_ANGULAR},
    "geometry_msgs/TwistStamped": {f"twist.{name}": _setter(f"twist.{name}") for name in _LINEAR_ANGULAR},
    "std_msgs/Float32": {"data": _single},
    "std_msgs/Float64": {"data": _setter("data")},
}
"""By type and field, what writes a command."""
