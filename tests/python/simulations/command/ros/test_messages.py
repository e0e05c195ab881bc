"""simulation_interfaces: messages have the bytes that another implementation writes from the definitions."""

import random
from typing import Any

import pytest
from rosbags.typesys import get_types_from_msg

from swarmwright.simulations.ros.dds import define, message_type, new, service_types
from swarmwright.simulations.ros.simulation_interfaces import MESSAGES, SERVICES
from tests.python.simulations.ros.definitions import drawn, encoded, plain, store

# The fields as they are published, version 2.1.0; of requests and responses, too.
DEFINITIONS = {
    "geometry_msgs/Accel": "geometry_msgs/Vector3 linear\ngeometry_msgs/Vector3 angular",
    "rcl_interfaces/SetParameters_Request": "Parameter[] parameters",
    "rcl_interfaces/SetParameters_Response": "SetParametersResult[] results",
    "simulation_interfaces/Result": "uint8 result\nstring error_message",
    "simulation_interfaces/Resource": "string uri\nstring resource_string",
    "simulation_interfaces/SimulationState": "uint8 state",
    "simulation_interfaces/EntityCategory": "uint8 category",
    "simulation_interfaces/TagsFilter": "string[] tags\nuint8 filter_mode",
    "simulation_interfaces/Bounds": "uint8 type\ngeometry_msgs/Vector3[] points",
    "simulation_interfaces/EntityFilters": (
        "string filter\nEntityCategory[] categories\nTagsFilter tags\nBounds bounds"
    ),
    "simulation_interfaces/EntityState": (
        "std_msgs/Header header\ngeometry_msgs/Pose pose\ngeometry_msgs/Twist twist\n"
        "geometry_msgs/Accel acceleration"
    ),
    "simulation_interfaces/StepSimulation_Request": "uint64 steps",
    "simulation_interfaces/StepSimulation_Response": "Result result",
    "simulation_interfaces/ResetSimulation_Request": "uint8 scope",
    "simulation_interfaces/ResetSimulation_Response": "Result result",
    "simulation_interfaces/SetSimulationState_Request": "SimulationState state",
    "simulation_interfaces/SetSimulationState_Response": "Result result",
    "simulation_interfaces/GetEntitiesStates_Request": "EntityFilters filters",
    "simulation_interfaces/GetEntitiesStates_Response": (
        "Result result\nstring[] entities\nEntityState[] states"
    ),
    "simulation_interfaces/SpawnEntity_Request": (
        "string name\nbool allow_renaming\nResource entity_resource\nstring entity_namespace\n"
        "geometry_msgs/PoseStamped initial_pose"
    ),
    "simulation_interfaces/SpawnEntity_Response": "Result result\nstring entity_name",
}
DEFINED = dict(MESSAGES)


@pytest.fixture(scope="module")
def types() -> Any:
    """Types of ROS 2 Humble and of these definitions."""
    define(MESSAGES, SERVICES)
    found = store()
    for name, text in DEFINITIONS.items():
        kind = name.replace("/", "/msg/")
        if kind not in found.fielddefs:
            found.register(get_types_from_msg(text, kind))
    return found


@pytest.mark.parametrize("kind", DEFINED)
def test_bytes_of_messages(kind: str, types: Any) -> None:
    numbers = random.Random(5)
    for _ in range(20):
        theirs = drawn(types, kind.replace("/", "/msg/"), numbers)
        data = encoded(types, theirs)
        read = message_type(kind).deserialize(data)
        assert plain(read) == plain(theirs)
        assert read.serialize() == data


@pytest.mark.parametrize("kind", SERVICES)
def test_bytes_of_services(kind: str, types: Any) -> None:
    numbers = random.Random(5)
    package, name = kind.split("/")
    for made, part in zip(service_types(kind), ("Request", "Response"), strict=True):
        for _ in range(20):
            theirs = drawn(types, f"{package}/msg/{name}_{part}", numbers)
            data = encoded(types, theirs)
            # Who asks, and which of its requests it is: 16 bytes, which leave the alignment as it is.
            read = made.deserialize(data[:4] + bytes(16) + data[4:])
            assert plain(read.data) == plain(theirs)
            assert read.serialize()[20:] == data[4:]
        assert made.__idl_typename__ == f"{package}.srv.dds_.{name}_{part}_"


def test_a_step_is_one_step_by_default() -> None:
    request, _ = service_types("simulation_interfaces/StepSimulation")
    assert new(request).data.steps == 1
