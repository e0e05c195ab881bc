"""Episodes of robots that move by themselves, without a middleware."""

import math
import os
import time
from collections.abc import Callable, Iterator
from types import SimpleNamespace
from typing import Any, cast
from unittest.mock import MagicMock

import pytest

from swarmwright.simulations.command.ros_definition import RosOptions
from swarmwright.simulations.ros.dds import Dds
from swarmwright.simulations.ros.episodes import Feeds, Pace, Robots, Value
from swarmwright.simulations.ros.mapping import SensorMapping, TopicField
from tests.python.simulations.ros.conversation import until
from tests.python.simulations.ros.network import environment


class Node:
    """A node in a time of its own, whose topics send something at regular intervals."""

    def __init__(self, interval: float) -> None:
        self._interval, self._time, self._next = interval, 100.0, 100.0
        self._callbacks: list[Callable[[Any], None]] = []

    def subscribe(self, _topic: str, _kind: str, callback: Callable[[Any], None], _depth: int) -> Any:
        self._callbacks.append(callback)
        return SimpleNamespace(publishers=lambda: 1)

    def publisher(self, *_: object) -> Any:
        return MagicMock()

    def types(self, _topic: str) -> list[str]:
        return []

    def now(self) -> float:
        return self._time

    def spin_once(self, timeout: float) -> None:
        self._time += min(max(timeout, 0.0), 0.01)
        if self._time >= self._next:
            self._next += self._interval
            for callback in self._callbacks:
                callback(SimpleNamespace(data=0.5))


def robots(interval: float, metrics: dict[str, Any] | None = None, **sensor: float) -> Robots:
    place = {"topic": "light", "type": "std_msgs/Float32"}
    options = RosOptions.model_validate(
        {
            "ros": 1,
            "sensors": [{"sensor": "light", **place, **sensor}],
            "actuators": [{"actuator": "speed", "topic": "speed", "type": "std_msgs/Float32"}],
            "step": 0.1,
            "steps": 5,
            "metrics": {"light": {"sensor": "light"}, **(metrics or {})},
        }
    )
    return Robots(options.attachment(), cast("Any", Node(interval)), lambda: None)


def episode(driven: Robots) -> dict[str, Any]:
    answer = driven.reset({}, 1)
    while "done" not in answer:
        answer = driven.step([[0.5]])
    return answer


def test_steps_that_a_slow_sensor_stretches_are_reported_once() -> None:
    driven = robots(0.5)
    answer = episode(driven)
    assert answer["metrics"] == {"light": 0.5}
    assert "steps took 0.5" in answer["warning"]
    assert "instead of 0.1 s (simulation.step), over 5 steps" in answer["warning"]
    assert "for /light (std_msgs/Float32; sensor light); make steps longer" in answer["warning"]
    assert "warning" not in episode(driven)


def test_for_a_slow_metric_another_remedy_is_named() -> None:
    score = {"topic": "score", "type": "std_msgs/Float32"}
    warning = episode(robots(0.5, {"score": score}, timeout=60.0))["warning"]
    assert "for /score (std_msgs/Float32; metric score); make steps longer" in warning
    assert warning.endswith("or give slow metrics a value otherwise")
    assert "warning" not in episode(robots(0.5, {"score": {**score, "otherwise": 0}}, timeout=60.0))


@pytest.mark.parametrize(("interval", "sensor"), [(0.05, {}), (0.1, {}), (0.5, {"timeout": 60.0})])
def test_sensors_that_are_in_time_need_no_warning(interval: float, sensor: dict[str, float]) -> None:
    assert "warning" not in episode(robots(interval, None, **sensor))


TYPE = "std_msgs/Float64"


@pytest.fixture
def nodes(monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[Dds, Dds]]:
    """One that receives, one that publishes, in a domain of their own."""
    made = environment()
    for name in set(os.environ) - set(made):
        monkeypatch.delenv(name)
    for name in ("ROS_DOMAIN_ID", "CYCLONEDDS_URI"):
        monkeypatch.setenv(name, made[name])
    both = Dds("tester"), Dds("robot")
    try:
        yield both
    finally:
        for node in both:
            node.close()


def number(scale: float = 1.0) -> SensorMapping:
    return SensorMapping(TopicField("sensors[0]", "/load", TYPE, "data"), scale, 0.5, (0.0, 8.0), 1.0)


def test_messages_of_a_step_are_awaited_where_a_metric_may_be_older(nodes: tuple[Dds, Dds]) -> None:
    node, robot = nodes
    feeds = Feeds(node, messages=2)
    sensor = feeds.add(Value("sensor load", number(), single=True))
    metric = feeds.add(Value("metric load", number(scale=2.0), single=False, keeps=math.inf, otherwise=-1.0))
    assert len(feeds.all) == 1
    publisher = robot.publisher("/load", TYPE)

    def spun(holds: Callable[[], bool]) -> bool:
        node.spin_once(0.02)
        return holds()

    until(lambda: spun(lambda: publisher.listeners() > 0))

    def publish(value: float, count: int) -> None:
        message = publisher.new()
        message.data = value
        publisher.publish(message)
        until(lambda: spun(lambda: feeds.all[0].count == count))

    feeds.begin()
    assert feeds.missing()
    assert metric.number == -1.0
    publish(1.1, 1)
    assert metric.number == 2.7
    assert [feed.topic for feed in feeds.missing()] == ["/load"]
    assert not feeds.missing(messages=1)
    said = feeds.all[0].explain_missing(2, time.monotonic(), 5.0)
    assert "1 messages came within 5 s, expected 2 (simulation.step.messages)" in said
    publish(7.8, 2)
    assert not feeds.missing()
    assert (sensor.number, metric.number) == (8.0, 8.0)
    feeds.begin()
    assert feeds.missing(), "a sensor's value of an earlier step counts no more"


def test_a_metric_that_may_be_older_is_not_awaited(nodes: tuple[Dds, Dds]) -> None:
    feeds = Feeds(nodes[0], messages=2)
    feeds.add(Value("metric load", number(), single=False, keeps=math.inf, otherwise=0.0))
    feeds.begin()
    assert not feeds.missing()


def test_messages_without_a_value_are_told_from_silence(nodes: tuple[Dds, Dds]) -> None:
    node, robot = nodes
    feeds = Feeds(node, messages=1)
    place = TopicField("sensors[0]", "/scan", "sensor_msgs/LaserScan", "")
    behind = SensorMapping(place, 1.0, 0.0, None, 1.0, sector=(150.0, 210.0))
    feeds.add(Value("sensor behind", behind, single=True))
    publisher = robot.publisher("/scan", "sensor_msgs/LaserScan")

    def spun(holds: Callable[[], bool]) -> bool:
        node.spin_once(0.02)
        return holds()

    until(lambda: spun(lambda: publisher.listeners() > 0))
    feeds.begin()
    message = publisher.new()
    message.range_min, message.range_max, message.angle_increment = 0.1, 4.0, 1.0
    message.ranges = [2.0, 2.0, 2.0, 0.0]
    publisher.publish(message)
    until(lambda: spun(lambda: feeds.all[0].count == 1))
    assert feeds.all[0].explain_missing(1, time.monotonic(), 5.0) == (
        "/scan (sensor_msgs/LaserScan): sensor behind: messages came for 5 s, but none has a usable value "
        "within [150, 210] degrees"
    )


def paced(duration: float, *times: float) -> Pace:
    pace = Pace(duration)
    for at in times:
        pace.command(at)
    return pace


@pytest.mark.parametrize(
    "times", [(), (5.0,), (5.0, 5.1, 5.2, 5.3), (5.0, 5.105, 5.21), (5.0, 5.15, 5.2, 5.3)]
)
def test_steps_that_are_in_time_on_average_need_no_warning(times: tuple[float, ...]) -> None:
    assert paced(0.1, *times).warning() is None


def test_a_slow_topic_is_named_with_the_time_that_steps_took() -> None:
    pace = paced(0.1, 0.0, 0.5, 1.0, 1.5)
    pace.wait("/a (sensor a)", 0.2, "give slow sensors a timeout")
    pace.wait("/d (metric d)", 0.5, "give slow metrics a value otherwise")
    assert pace.warning() == (
        "steps took 0.5 s on average instead of 0.1 s (simulation.step), over 3 steps; robots continued "
        "with the last command while they waited, most of the time for /d (metric d); make steps longer, "
        "or give slow metrics a value otherwise"
    )
    pace.begin()
    assert pace.warning() is None


@pytest.mark.parametrize("waited", [0.0, 0.001, 0.19, -5.0])
def test_without_a_slow_topic_it_is_the_machine(waited: float) -> None:
    """Waits of less than half of the 0.4 s beyond the durations are no cause."""
    pace = paced(0.1, 0.0, 0.3, 0.6)
    pace.wait("/a (sensor a)", waited, "give slow sensors a timeout")
    assert "this machine is too slow or too busy" in str(pace.warning())
    pace.wait("/a (sensor a)", 0.2, "give slow sensors a timeout")
    assert "/a (sensor a)" in str(pace.warning())


def test_neither_rests_nor_a_clock_that_begins_anew_count() -> None:
    pace = paced(0.1, 0.0, 0.1)
    pace.rest()
    pace.command(9.0)
    pace.command(9.1)
    pace.command(0.0)
    pace.command(0.1)
    assert pace.warning() is None
