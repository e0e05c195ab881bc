"""Messages have the bytes that another implementation writes, from the definitions that ROS 2 publishes."""

import random
from typing import Any

import pytest

from swarmwright.simulations.ros.dds import MESSAGES, SERVICES, message_type, new, service_types
from tests.python.simulations.ros.definitions import DISTRIBUTIONS, decoded, drawn, encoded, plain, store


def spelled(kind: str) -> str:
    return kind.replace("/", "/msg/")


def assigned(made: Any, values: dict[str, Any]) -> Any:
    """A message with these values."""
    for name, value in values.items():
        old = getattr(made, name)
        if isinstance(value, dict):
            assigned(old, value)
        elif isinstance(value, list) and value and isinstance(value[0], dict):
            setattr(made, name, [assigned(new(message_type(INNER[name])), one) for one in value])
        else:
            setattr(made, name, value)
    return made


INNER = {"dim": "std_msgs/MultiArrayDimension"}


@pytest.mark.parametrize("distribution", DISTRIBUTIONS)
@pytest.mark.parametrize("kind", MESSAGES)
def test_bytes_of_messages(kind: str, distribution: str) -> None:
    types, numbers = store(distribution), random.Random(5)
    for _ in range(20):
        theirs = drawn(types, spelled(kind), numbers)
        data = encoded(types, theirs)
        read = message_type(kind).deserialize(data)
        if (kind, distribution) == ("sensor_msgs/Range", "jazzy"):
            # It has one number more, which is not read.
            assert plain(read) == {k: v for k, v in plain(theirs).items() if k != "variance"}
            assert data.startswith(read.serialize())
            continue
        assert plain(read) == plain(theirs)
        assert read.serialize() == data
        assert assigned(new(message_type(kind)), plain(theirs)).serialize() == data
        assert plain(decoded(types, spelled(kind), read.serialize())) == plain(theirs)


@pytest.mark.parametrize("kind", SERVICES)
def test_bytes_of_services(kind: str) -> None:
    types, numbers = store(), random.Random(5)
    for made, part in zip(service_types(kind), ("Request", "Response"), strict=True):
        theirs = drawn(types, f"{spelled(kind)}_{part}", numbers)
        wrapped = new(made)
        wrapped.client, wrapped.sequence = 0x1122334455667788, 9
        assigned(wrapped.data, plain(theirs))
        data = wrapped.serialize()
        # rmw_cyclonedds puts 16 bytes before what ROS knows: who asks, and which of its requests it is.
        header = bytes.fromhex("00010000 8877665544332211 0900000000000000")
        assert data[:20] == header
        assert data[:4] + data[20:] == encoded(types, theirs)
        assert made.__idl_typename__ == f"std_srvs.srv.dds_.{kind.split('/')[1]}_{part}_"


@pytest.mark.parametrize("kind", MESSAGES)
def test_a_new_message_has_the_defaults_of_its_definition(kind: str) -> None:
    made = plain(new(message_type(kind)))
    # No rotation is the only default that is not zero.
    assert {name for name, value in numbers_in(made) if value} <= {"w"}
    assert plain(decoded(store(), spelled(kind), new(message_type(kind)).serialize())) == made
    assert message_type(spelled(kind)) is message_type(kind)


def numbers_in(value: Any, name: str = "") -> list[tuple[str, Any]]:
    if isinstance(value, dict):
        return [found for name, one in value.items() for found in numbers_in(one, name)]
    if isinstance(value, list):
        return [found for one in value for found in numbers_in(one, name)]
    return [(name, value)]


def test_no_rotation_is_the_default() -> None:
    pose = new(message_type("geometry_msgs/PoseStamped")).pose
    assert (pose.orientation.w, pose.orientation.x) == (1.0, 0.0)
    with pytest.raises(KeyError):
        message_type("sensor_msgs/Imu")
