"""Fields of messages as numbers."""

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmwright.simulations.ros.fields import READERS, WRITERS, SameFieldError, binary32, reader, writers
from swarmwright.simulations.ros.mapping import (
    ActuatorMapping,
    Interval,
    MappingError,
    SensorMapping,
    TopicField,
)


def sensor(kind: str, field: str = "", **values: Any) -> SensorMapping:
    place = TopicField("sensors[0] (a)", "/topic", kind, field)
    return SensorMapping(
        **{"scale": 1.0, "offset": 0.0, "clip": None, "timeout": 1.0, **values}, topic_field=place
    )


def actuator(kind: str, field: str = "", **values: Any) -> ActuatorMapping:
    place = TopicField("actuators[0] (a)", "/topic", kind, field)
    ready = {"scale": 1.0, "offset": 0.0, "limits": None, "terms": ((0, 1.0),), **values}
    return ActuatorMapping(**ready, topic_field=place)


def scan(ranges: list[float], begin: float, step: float, low: float = 0.1, high: float = 4.0) -> Any:
    return SimpleNamespace(
        angle_min=begin, angle_increment=step, range_min=low, range_max=high, ranges=ranges
    )


SCAN, RANGE = "sensor_msgs/LaserScan", "sensor_msgs/Range"


def test_a_sector_behind_the_robot() -> None:
    message = scan([float(degree) / 100 + 0.5 for degree in range(360)], -math.pi, math.pi / 180)
    # Beam i looks at i - 180 degrees: 150..180 are beams 330..359 and 180 again is beam 0.
    found = reader(sensor(SCAN, sector=(150.0, 210.0), mean=True))(message)
    beams = [*range(330, 360), *range(31)]
    values = [min(max(0.5 + one / 100, 0.1), 4.0) for one in beams]
    assert found == pytest.approx(sum(values) / len(values), rel=1e-6)
    assert reader(sensor(SCAN, sector=(150.0, 210.0)))(message) == 0.5
    assert reader(sensor(SCAN, sector=(-0.5, 0.5)))(message) == np.float32(0.5 + 1.8)


def test_another_scan_on_the_same_topic_has_another_sector() -> None:
    read = reader(sensor(SCAN, sector=(-10.0, 10.0)))
    assert read(scan([1.0, 2.0, 3.0], -1.0, 1.0)) == 2.0
    assert read(scan([1.0, 2.0, 3.0], 0.0, 1.0)) == 1.0
    assert read(scan([], 0.0, 1.0)) is None


@given(
    st.lists(st.floats(width=32), max_size=30),
    st.floats(-7, 7, width=32),
    st.floats(-1, 1, width=32),
    st.tuples(st.floats(-400, 400), st.floats(0.01, 360)).map(lambda pair: (pair[0], pair[0] + pair[1])),
    st.booleans(),
)
def test_a_sector_has_the_beams_that_look_into_it(
    ranges: list[float], begin: float, step: float, sector: Interval, mean: bool
) -> None:
    found = reader(sensor(SCAN, sector=sector, mean=mean))(scan(ranges, begin, step))
    middle, half = math.radians(sum(sector) / 2), math.radians((sector[1] - sector[0]) / 2)
    inside: list[float] = []
    for index, value in enumerate(ranges):
        turned = begin + index * step - middle
        away = abs(math.atan2(math.sin(turned), math.cos(turned)))
        if abs(away - half) < 1e-5:
            return  # at an end, where rounding decides
        if away < half and (value >= 0.1 or value == -math.inf):
            inside.append(min(max(value, 0.1), 4.0))
    if not inside:
        assert found is None
    else:
        assert found == pytest.approx(sum(inside) / len(inside) if mean else min(inside), rel=1e-6)


@pytest.mark.parametrize(
    ("value", "infinite", "expected"),
    [
        (1.5, None, 1.5),
        (0.01, None, None),
        (0.0, 7.0, None),
        (-1.0, None, None),
        (0.2, None, 0.2),
        (9.0, None, 3.0),
        (math.inf, None, 3.0),
        (math.inf, 7.0, 7.0),
        (9.0, 7.0, 7.0),
        (-math.inf, 7.0, 0.2),
        (math.nan, 7.0, None),
    ],
)
def test_ranges_are_those_of_rep_117(value: float, infinite: float | None, expected: float | None) -> None:
    message = SimpleNamespace(range=value, min_range=0.2, max_range=3.0)
    found = reader(sensor(RANGE, infinite=infinite))(message)
    assert found == (None if expected is None else np.float32(expected))


@pytest.mark.parametrize("unknown", [0.0, -1.0, math.inf, math.nan])
def test_a_largest_range_that_is_not_known_limits_nothing(unknown: float) -> None:
    def found(value: float, infinite: float | None = None) -> float | None:
        message = SimpleNamespace(range=value, min_range=0.2, max_range=unknown)
        return reader(sensor(RANGE, infinite=infinite))(message)

    assert (found(90.0), found(0.1), found(-math.inf)) == (90.0, None, float(np.float32(0.2)))
    assert (found(math.inf), found(math.inf, 8.0)) == (None, 8.0)


@given(st.lists(st.sampled_from([0.0, 0.05, math.nan, 1.0, 3.0, math.inf]), max_size=9), st.booleans())
def test_beams_without_a_measurement_are_as_good_as_none(ranges: list[float], mean: bool) -> None:
    read = reader(sensor(SCAN, mean=mean))
    usable = [value for value in ranges if value >= 0.1]
    assert read(scan(ranges, 0.0, 0.1)) == read(scan(usable, 0.0, 0.1))


def test_yaw_and_clipping() -> None:
    half = 0.4
    q = SimpleNamespace(w=math.cos(half), x=0.0, y=0.0, z=math.sin(half))
    odometry = SimpleNamespace(pose=SimpleNamespace(pose=SimpleNamespace(orientation=q)))
    assert reader(sensor("nav_msgs/Odometry", "yaw"))(odometry) == pytest.approx(0.8)
    assert reader(sensor("nav_msgs/Odometry", "yaw", scale=10.0, clip=(-1.0, 1.0)))(odometry) == 1.0


@given(st.floats())
def test_a_sensor_is_a_finite_number_of_32_bits_or_nothing(value: float) -> None:
    found = reader(sensor("std_msgs/Float64", scale=3.0, offset=-1.0))(SimpleNamespace(data=value))
    with np.errstate(over="ignore", invalid="ignore"):
        expected = np.float32(np.float64(value) * 3.0 - 1.0)
    assert found == (expected if np.isfinite(expected) else None)
    assert binary32(value) == (None if not np.isfinite(np.float64(value)) else found_or_none(value))


def found_or_none(value: float) -> float | None:
    with np.errstate(over="ignore"):
        rounded = np.float32(value)
    return float(rounded) if np.isfinite(rounded) else None


def test_commands_are_scaled_and_limited() -> None:
    twist = SimpleNamespace(linear=SimpleNamespace(x=0.0), angular=SimpleNamespace(z=0.0))
    kind = "geometry_msgs/Twist"
    write = writers(
        [
            actuator(kind, "angular.z", scale=-1.5),
            actuator(kind, "linear.x", offset=0.5, limits=(0.1, 0.8), terms=((1, 1.0),)),
        ]
    )
    write(twist, [0.5, 0.9])
    assert (twist.linear.x, twist.angular.z) == (0.8, -0.75)
    number = SimpleNamespace(data=0.0)
    writers([actuator("std_msgs/Float32", scale=-1e39)])(number, [1.0])
    assert number.data == -math.inf  # as a cast to binary32 gives it
    with pytest.raises(MappingError, match=r"actuators\[0\] \(a\): writes the same field as actuators\[0\]"):
        writers([actuator(kind, "angular.z"), actuator(kind, "angular.z")])


def test_errors_name_the_key() -> None:
    with pytest.raises(MappingError) as caught:
        writers([actuator("geometry_msgs/Twist", "linear.w")])
    assert (caught.value.key, caught.value.reason[:10]) == ("field", "field 'lin")
    with pytest.raises(MappingError) as caught:
        writers([actuator("std_msgs/Byte", "data")])
    assert caught.value.key == "type"
    same = [actuator("geometry_msgs/Twist", "linear.x"), actuator("geometry_msgs/Twist", "linear.x")]
    with pytest.raises(SameFieldError) as twice:
        writers(same)
    assert twice.value.actuator is same[1]


@given(st.lists(st.floats(-1, 1, width=32), min_size=3, max_size=3))
def test_a_sum_of_actuators_is_that_of_their_terms(values: list[float]) -> None:
    number = SimpleNamespace(data=0.0)
    terms = ((0, -1.0), (2, 1.0))
    writers([actuator("std_msgs/Float64", scale=2.0, limits=(-1.0, 1.0), terms=terms)])(number, values)
    assert number.data == min(max((values[2] - values[0]) * 2.0, -1.0), 1.0)


def test_every_type_that_is_commanded_can_be_sensed() -> None:
    assert set(WRITERS) < set(READERS)
    assert all(set(WRITERS[kind]) == set(READERS[kind]) for kind in WRITERS)
