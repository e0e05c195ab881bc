"""A simulator with the standard services `simulation_interfaces`: reset, step, spawn, states of entities."""

from __future__ import annotations

import math
import random
from typing import Any, Callable, Mapping, Sequence

from .fields import STATES, scale_reader
from .mapping import SensorMapping
from .middleware import Client, Middleware

_OK = 1
_PAUSED = 2
_NAME_NOT_UNIQUE = _ALREADY_IN_STATE = 101
_RESULTS = {0: "the simulator does not support this", 2: "not found", 3: "the simulator is in another state"}
_RESULTS[4] = "the operation failed"
_OF_SPAWN = {
    101: "the name is taken",
    102: "the simulator does not take this name",
    103: "the simulator does not read this format",
    104: "there is no model",
    105: "the simulator does not take this namespace",
    106: "the model cannot be read",
    107: "a file that the model needs is missing",
    108: "a file that the model needs is of a kind that the simulator does not read",
    109: "the pose is not possible",
}
MESSAGES = {
    "geometry_msgs/Accel": "geometry_msgs/Vector3 linear; geometry_msgs/Vector3 angular",
    "rcl_interfaces/Parameter": "string name; rcl_interfaces/ParameterValue value",
    "rcl_interfaces/ParameterValue": (
        "uint8 type; bool bool_value; int64 integer_value; float64 double_value; string string_value; "
        "byte[] byte_array_value; bool[] bool_array_value; int64[] integer_array_value; "
        "float64[] double_array_value; string[] string_array_value"
    ),
    "rcl_interfaces/SetParametersResult": "bool successful; string reason",
    "simulation_interfaces/Bounds": "uint8 type; geometry_msgs/Vector3[] points",
    "simulation_interfaces/EntityCategory": "uint8 category",
    "simulation_interfaces/EntityFilters": (
        "string filter; simulation_interfaces/EntityCategory[] categories; "
        "simulation_interfaces/TagsFilter tags; simulation_interfaces/Bounds bounds"
    ),
    "simulation_interfaces/EntityState": (
        "std_msgs/Header header; geometry_msgs/Pose pose; geometry_msgs/Twist twist; "
        "geometry_msgs/Accel acceleration"
    ),
    "simulation_interfaces/Resource": "string uri; string resource_string",
    "simulation_interfaces/Result": "uint8 result; string error_message",
    "simulation_interfaces/SimulationState": "uint8 state",
    "simulation_interfaces/TagsFilter": "string[] tags; uint8 filter_mode",
}
_RESULT = "simulation_interfaces/Result result"
SERVICES = {
    "rcl_interfaces/SetParameters": (
        "rcl_interfaces/Parameter[] parameters",
        "rcl_interfaces/SetParametersResult[] results",
    ),
    "simulation_interfaces/GetEntitiesStates": (
        "simulation_interfaces/EntityFilters filters",
        f"{_RESULT}; string[] entities; simulation_interfaces/EntityState[] states",
    ),
    "simulation_interfaces/ResetSimulation": ("uint8 scope", _RESULT),
    "simulation_interfaces/SetSimulationState": ("simulation_interfaces/SimulationState state", _RESULT),
    "simulation_interfaces/SpawnEntity": (
        (
            "string name; bool allow_renaming; simulation_interfaces/Resource entity_resource; "
            "string entity_namespace; geometry_msgs/PoseStamped initial_pose"
        ),
        f"{_RESULT}; string entity_name",
    ),
    "simulation_interfaces/StepSimulation": ("uint64 steps 1", _RESULT),
}
"""The published definitions, in the notation of `dds.define`."""


class SimulationError(Exception):
    """A service of the simulator failed."""


class Simulation:
    """The services of a simulator that a definition names.

    Args:
        node: the node that calls them.
        definition: the attachment.

    Methods raise SimulationError or MiddlewareError for a service that failed, and TimeoutError for a service
    that is missing or does not answer.
    """

    def __init__(self, node: Middleware, definition: Mapping[str, Any]) -> None:
        self._node = node
        self._clients: dict[str, Client] = {}
        self._states: dict[str, dict[str, Any]] = {}
        """Service -> states of entities after the last step."""
        self._step = self._standard(definition["step"])
        self._reset = self._standard(definition["reset"])
        needed = {self._step: "StepSimulation", self._reset: "ResetSimulation"}
        if definition["spawn"] is not None:
            needed[definition["spawn"]["service"]] = "SpawnEntity"
        self.needed = [self._client(service, kind) for service, kind in needed.items() if service]
        """Clients of the required services."""

    def step(self, steps: int, wait: float) -> None:
        """Make steps of the paused simulation."""
        request = self._client(self._step, "StepSimulation").request()
        request.steps = steps
        self._ask(self._step, "StepSimulation", request, wait)

    def reset(self, scope: int, wait: float) -> None:
        """Reset the simulation."""
        request = self._client(self._reset, "ResetSimulation").request()
        request.scope = scope
        self._ask(self._reset, "ResetSimulation", request, wait)

    def pause(self, wait: float) -> None:
        """Pause the simulation for steps, if it has a service for that."""
        if not self._step:
            return
        service = f"{self._step.rpartition('/')[0]}/set_simulation_state"
        client = self._client(service, "SetSimulationState")
        if not client.available():
            return
        request = client.request()
        request.state.state = _PAUSED
        self._ask(service, "SetSimulationState", request, wait, fine=(_OK, _ALREADY_IN_STATE, 0))

    def spawn(
        self, spawn: Mapping[str, Any], robots: Sequence[str], seed: int, *, wait: float, may_exist: bool
    ) -> None:
        """Spawn robots in the simulation.

        may_exist: whether they may exist from an earlier connection.
        """
        service, fine = spawn["service"], (_OK, _NAME_NOT_UNIQUE) if may_exist else (_OK,)
        for robot, pose in zip(robots, _poses(spawn, len(robots), seed)):
            request = self._client(service, "SpawnEntity").request()
            name = robot.strip("/").replace("/", "_")
            request.name = name
            request.entity_namespace = robot if robot.startswith("/") else f"/{robot}"
            # Before version 2 of the interfaces, the request itself has these two fields.
            resource = getattr(request, "entity_resource", request)
            resource.uri = spawn["uri"]
            resource.resource_string = spawn["text"].replace("{robot}", name)
            pose_message = request.initial_pose.pose
            pose_message.position.x, pose_message.position.y, pose_message.position.z = (
                pose["x"],
                pose["y"],
                pose["z"],
            )
            pose_message.orientation.z, pose_message.orientation.w = (
                math.sin(pose["yaw"] / 2),
                math.cos(pose["yaw"] / 2),
            )
            subject = f" of {name}"
            self._ask(service, "SpawnEntity", request, wait, fine=fine, results=_OF_SPAWN, subject=subject)

    def state(self, service: str, entity: str, entry: SensorMapping) -> Callable[[], float]:
        """Return a function that reads a number of an entity's state at the last call of `ask`."""
        self._states[service] = {}
        read = scale_reader(STATES[entry.topic_field.field](entry), entry)

        def value() -> float:
            states = self._states[service]
            if entity not in states:
                available = ", ".join(sorted(states)[:20]) or "none"
                where = f"{entry.topic_field.where}.entity"
                raise SimulationError(
                    f"{service}: there is no entity {entity!r}; available: {available}; see {where}"
                )
            number = read(states[entity])
            if number is None or not math.isfinite(number):
                raise SimulationError(
                    f"{service}: {entry.topic_field.field} of {entity} is {number}, expected a finite number"
                )
            return number

        return value

    def ask(self, wait: float) -> None:
        """Request the states of all entities, if any are read."""
        for service in self._states:
            request = self._client(service, "GetEntitiesStates").request()
            response = self._ask(service, "GetEntitiesStates", request, wait)
            self._states[service] = dict(zip(response.entities, response.states))

    def set_parameters(self, node: str, values: Mapping[str, Any], wait: float) -> None:
        """Set parameters of a ROS 2 node."""
        service = f"{node.rstrip('/')}/set_parameters"
        client = self._client(service, "SetParameters", "rcl_interfaces")
        request = client.request()
        for name, value in values.items():
            request.parameters.append(self._parameter(name, value))
        response = client.call(request, wait)
        for name, result in zip(values, response.results):
            if not result.successful:
                raise SimulationError(f"{service}: {name} was refused: {result.reason or 'no reason given'}")

    def _parameter(self, name: str, value: Any) -> Any:
        parameter = self._node.new("rcl_interfaces/Parameter")
        parameter.name, into = name, parameter.value
        if isinstance(value, bool):
            into.type, into.bool_value = 1, value
        elif isinstance(value, int):
            into.type, into.integer_value = 2, value
        elif isinstance(value, float):
            into.type, into.double_value = 3, value
        elif isinstance(value, str):
            into.type, into.string_value = 4, value
        elif isinstance(value, list) and value and all(type(item) in (int, float) for item in value):
            into.type, into.double_array_value = 8, [float(item) for item in value]
        else:
            raise SimulationError(f"{name}: {value!r} cannot be a parameter of a node")
        return parameter

    @staticmethod
    def _standard(section: Mapping[str, Any]) -> str:
        """Return the name of a service of the standard; empty for another one, or none."""
        kind = section["type"] or ""
        return section["service"] if kind.startswith("simulation_interfaces/") else ""

    def _client(self, service: str, kind: str, package: str = "simulation_interfaces") -> Client:
        if service not in self._clients:
            self._clients[service] = self._node.client(service, f"{package}/{kind}")
        return self._clients[service]

    def _ask(
        self,
        service: str,
        kind: str,
        request: Any,
        wait: float,
        *,
        fine: Sequence[int] = (_OK,),
        results: Mapping[int, str] = {},
        subject: str = "",
    ) -> Any:
        """Call a service and return its response, if its result is in `fine`."""
        response = self._clients[service].call(request, wait)
        code = response.result.result
        if code not in fine:
            meaning = results.get(code) or _RESULTS.get(code, "a result of the simulator's own")
            message = response.result.error_message
            raise SimulationError(
                f"{service} ({kind}){subject}: result {code}, {meaning}{f': {message}' if message else ''}"
            )
        return response


def _poses(spawn: Mapping[str, Any], count: int, seed: int) -> Sequence[Mapping[str, float]]:
    """Return the poses of robots; in an area they follow from the seed."""
    area = spawn["area"]
    if area is None:
        poses: Sequence[Mapping[str, float]] = spawn["poses"]
        return poses
    numbers = random.Random(seed)
    return [
        {
            "x": numbers.uniform(*area["x"]),
            "y": numbers.uniform(*area["y"]),
            "z": area["z"],
            "yaw": numbers.uniform(*area["yaw"]),
        }
        for _ in range(count)
    ]
