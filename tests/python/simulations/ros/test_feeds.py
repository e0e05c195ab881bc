"""When a step has all that robots sense, with a topic that a second node publishes."""

import math
import os
import time
from collections.abc import Callable, Iterator

import pytest

from swarmwright.simulations.ros.dds import Dds
from swarmwright.simulations.ros.episodes import Feeds, Value
from swarmwright.simulations.ros.mapping import SensorMapping, TopicField
from tests.python.simulations.ros.conversation import until
from tests.python.simulations.ros.network import environment

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
