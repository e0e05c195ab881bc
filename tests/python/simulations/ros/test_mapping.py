"""What a mapping says, and what is said about mistakes in it."""

from contextlib import suppress
from typing import Any
from unittest.mock import MagicMock

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from swarmwright.simulations.ros.mapping import MappingError, format_value, read_mapping, resolve_topics
from swarmwright.simulations.ros.middleware import namespace_of, resolve
from swarmwright.simulations.ros.topics import Generator, Inputs
from tests.python.simulations.ros.conversation import on_wheels
from tests.python.simulations.ros.mistakes import ACTUATORS, IN_THE_FILE, MAPPING, SENSORS, changed


def test_entries_come_in_the_order_of_the_controller() -> None:
    mapping = read_mapping(MAPPING, SENSORS, ACTUATORS)
    assert [one.topic_field.topic for one in mapping.sensors] == [
        "scan", "scan", "sonar", "odom", "odom", "target", "light",
    ]  # fmt: skip
    assert [one.topic_field.where for one in mapping.actuators] == [
        "actuators[1] (actuator 0)", "actuators[0] (actuator 1)", "actuators[2] (actuator 2)",
    ]  # fmt: skip
    assert (mapping.rate, mapping.reset_after_silence, mapping.sensors[0].timeout) == (50, False, 1.5)
    assert (mapping.sensors[1].infinite, mapping.sensors[1].mean) == (5, True)
    assert mapping.actuators[0].limits == (0.1, 0.8)


def test_both_spellings_of_a_type_are_the_same() -> None:
    def respelled(mapping: dict[str, Any]) -> None:
        for entry in [*mapping["sensors"], *mapping["actuators"]]:
            entry["type"] = entry["type"].replace("/", "/msg/")

    assert read_mapping(changed(respelled), SENSORS, ACTUATORS) == read_mapping(MAPPING, SENSORS, ACTUATORS)


def test_numbers_with_an_exponent_may_be_text_as_ros_1_hands_them_over() -> None:
    mapping = read_mapping(
        changed(lambda m: m["actuators"][1].update(scale="-1.5E+2", limits=["1e-3", "2e0"])),
        SENSORS,
        ACTUATORS,
    )
    assert (mapping.sensors[1].scale, mapping.actuators[0].scale) == (0.3, -150.0)
    assert mapping.actuators[0].limits == (0.001, 2.0)
    with pytest.raises(MappingError, match="scale: '1e999' found, expected a number"):
        read_mapping(changed(lambda m: m["actuators"][1].update(scale="1e999")), SENSORS, ACTUATORS)


def test_an_actuator_may_be_in_several_sums() -> None:
    mapping = read_mapping(changed(on_wheels), SENSORS, ACTUATORS)
    assert [one.terms for one in mapping.actuators] == [
        ((0, 0.7), (1, 0.3)),
        ((0, -1.0), (1, 1.0)),
        ((2, 1.0),),
    ]
    assert mapping.actuators[0].topic_field.where == "actuators[0] (actuator 0, actuator 1)"
    assert (mapping.sensors[5].random, mapping.sensors[5].seed) == (True, 7)
    assert resolve_topics(mapping, lambda name: f"/a/{name}").sensors[5].topic_field.topic == ""


def test_a_sensor_that_the_robot_lacks_has_a_constant() -> None:
    entry = {"sensor": "sensor 6", "source": "constant", "value": "1e-1"}
    mapping = read_mapping(changed(lambda m: m["sensors"].__setitem__(5, entry)), SENSORS, ACTUATORS)
    mapping = resolve_topics(mapping, lambda name: f"/a/{name}")
    node = MagicMock()
    node.types.return_value = ()
    node.now.return_value = 1.0
    inputs = Inputs(node, mapping.sensors)
    inputs.draw()
    assert inputs.values[6] == float(np.float32(0.1))
    missing = inputs.missing()
    assert missing is not None
    assert missing.silent == ["/a/scan", "/a/sonar", "/a/odom", "/a/target"]


def test_random_numbers_repeat_with_a_seed_and_differ_without() -> None:
    one, two = Generator(3), Generator(3)
    drawn = [one.next() for _ in range(2000)]
    assert drawn == [two.next() for _ in range(2000)]
    assert [Generator(None).next() for _ in range(3)] != [Generator(None).next() for _ in range(3)]
    assert all(0 <= value < 1 and np.float32(value) == value for value in drawn)
    assert np.mean(drawn) == pytest.approx(0.5, abs=0.03)
    assert np.var(drawn) == pytest.approx(1 / 12, abs=0.01)


@pytest.mark.parametrize("name", IN_THE_FILE)
def test_a_mistake_is_named(name: str) -> None:
    change, message = IN_THE_FILE[name]
    with pytest.raises(MappingError) as caught:
        read_mapping(changed(change), SENSORS, ACTUATORS)
    assert str(caught.value) == message
    # It is the same mistake when it was read from a file.
    with pytest.raises(MappingError) as caught:
        read_mapping(yaml.safe_load(yaml.safe_dump(changed(change))), SENSORS, ACTUATORS)
    assert str(caught.value) == message


VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=3) | st.integers(), inner),
    max_leaves=6,
)


@given(VALUES, st.sampled_from(["sensors", "actuators", "rate", "timeout", "reset_after_silence", "x"]))
def test_whatever_is_in_the_file_is_read_or_named(value: Any, key: str) -> None:
    for wrong in (value, changed(lambda mapping: mapping.update({key: value}))):
        with suppress(MappingError):
            assert read_mapping(wrong, SENSORS, ACTUATORS).rate > 0
    assert isinstance(format_value(value), str)


def test_names_are_resolved_in_the_namespace_of_the_robot() -> None:
    assert resolve("scan", "/robot_1") == resolve("scan", "robot_1/") == "/robot_1/scan"
    assert resolve("/scan", "/robot_1") == resolve("scan", "/") == resolve("scan", "") == "/scan"
    assert resolve("~/steps", "/robot_1", "controller") == "/robot_1/controller/steps"
    assert resolve("~/steps", "/", "controller") == "/controller/steps"
    assert (namespace_of(""), namespace_of("/"), namespace_of("a/b/")) == ("/", "/", "/a/b")
    for wrong in ("", "so nar", "1st", "a//b", "a/", "~x", "a-b", "ä"):
        with pytest.raises(ValueError, match=r"name|//"):
            resolve(wrong, "/robot_1")
    mapping = resolve_topics(read_mapping(MAPPING, SENSORS, ACTUATORS), lambda name: resolve(name, "/a"))
    assert mapping.sensors[2].topic_field.topic == "/a/sonar"
