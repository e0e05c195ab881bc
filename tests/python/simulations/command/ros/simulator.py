"""A simulator with `simulation_interfaces`, over DDS as nodes of ROS 2 with rmw_cyclonedds speak it.

Its types are written here, from the published definitions, and share nothing with those of Swarmwright.
Robots are points that drive on a plane; each publishes where it is and where its goal is, once in a step.

    python3 simulator.py [--robots 2] [--publish-on-reset] [--realtime SPEED] [--log FILE] [--fault FAULT]

Without --robots there are none until they are spawned. Faults: `dies`, `reset_fails`, `step_fails`,
`step_hangs`, `silent`, `nan`, `wrong_type`, each in the fifth step, where that has a meaning; `clock_stops`.
With --realtime it is not stepped, and publishes /clock.
"""

# mypy: ignore-errors
# Cyclone DDS has no types that mypy understands.

import argparse
import math
import os
import re
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from cyclonedds.core import InstanceState, Policy, Qos, ReadCondition, SampleState, ViewState, WaitSet
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct, make_idl_struct
from cyclonedds.idl.types import array, float64, int32, int64, sequence, uint8, uint16, uint32, uint64
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic

OK, FAILED, INCORRECT_STATE, NOT_UNIQUE = 1, 4, 3, 101
SPAWNED, STATE, TIME = 4, 2, 1


def message(name: str) -> dict[str, str]:
    package, kind = name.split("/")
    return {"typename": f"{package}.msg.dds_.{kind}_"}


def service(name: str, part: str) -> dict[str, str]:
    package, kind = name.split("/")
    return {"typename": f"{package}.srv.dds_.{kind}_{part}_Data_"}


@dataclass
class Time(IdlStruct, **message("builtin_interfaces/Time")):
    sec: int32 = 0
    nanosec: uint32 = 0


@dataclass
class Header(IdlStruct, **message("std_msgs/Header")):
    stamp: Time = field(default_factory=Time)
    frame_id: str = ""


@dataclass
class Clock(IdlStruct, **message("rosgraph_msgs/Clock")):
    clock: Time = field(default_factory=Time)


@dataclass
class Vector3(IdlStruct, **message("geometry_msgs/Vector3")):
    x: float64 = 0.0
    y: float64 = 0.0
    z: float64 = 0.0


@dataclass
class Point(IdlStruct, **message("geometry_msgs/Point")):
    x: float64 = 0.0
    y: float64 = 0.0
    z: float64 = 0.0


@dataclass
class Quaternion(IdlStruct, **message("geometry_msgs/Quaternion")):
    x: float64 = 0.0
    y: float64 = 0.0
    z: float64 = 0.0
    w: float64 = 1.0


@dataclass
class Pose(IdlStruct, **message("geometry_msgs/Pose")):
    position: Point = field(default_factory=Point)
    orientation: Quaternion = field(default_factory=Quaternion)


@dataclass
class PoseStamped(IdlStruct, **message("geometry_msgs/PoseStamped")):
    header: Header = field(default_factory=Header)
    pose: Pose = field(default_factory=Pose)


@dataclass
class Twist(IdlStruct, **message("geometry_msgs/Twist")):
    linear: Vector3 = field(default_factory=Vector3)
    angular: Vector3 = field(default_factory=Vector3)


@dataclass
class Accel(IdlStruct, **message("geometry_msgs/Accel")):
    linear: Vector3 = field(default_factory=Vector3)
    angular: Vector3 = field(default_factory=Vector3)


@dataclass
class PoseWithCovariance(IdlStruct, **message("geometry_msgs/PoseWithCovariance")):
    pose: Pose = field(default_factory=Pose)
    covariance: array[float64, 36] = field(default_factory=lambda: [0.0] * 36)


@dataclass
class TwistWithCovariance(IdlStruct, **message("geometry_msgs/TwistWithCovariance")):
    twist: Twist = field(default_factory=Twist)
    covariance: array[float64, 36] = field(default_factory=lambda: [0.0] * 36)


@dataclass
class Odometry(IdlStruct, **message("nav_msgs/Odometry")):
    header: Header = field(default_factory=Header)
    child_frame_id: str = ""
    pose: PoseWithCovariance = field(default_factory=PoseWithCovariance)
    twist: TwistWithCovariance = field(default_factory=TwistWithCovariance)


@dataclass
class Result(IdlStruct, **message("simulation_interfaces/Result")):
    result: uint8 = OK
    error_message: str = ""


@dataclass
class Resource(IdlStruct, **message("simulation_interfaces/Resource")):
    uri: str = ""
    resource_string: str = ""


@dataclass
class EntityState(IdlStruct, **message("simulation_interfaces/EntityState")):
    header: Header = field(default_factory=Header)
    pose: Pose = field(default_factory=Pose)
    twist: Twist = field(default_factory=Twist)
    acceleration: Accel = field(default_factory=Accel)


@dataclass
class EntityCategory(IdlStruct, **message("simulation_interfaces/EntityCategory")):
    category: uint8 = 0


@dataclass
class TagsFilter(IdlStruct, **message("simulation_interfaces/TagsFilter")):
    tags: sequence[str] = field(default_factory=list)
    filter_mode: uint8 = 0


@dataclass
class Bounds(IdlStruct, **message("simulation_interfaces/Bounds")):
    type: uint8 = 0
    points: sequence[Vector3] = field(default_factory=list)


@dataclass
class EntityFilters(IdlStruct, **message("simulation_interfaces/EntityFilters")):
    filter: str = ""
    categories: sequence[EntityCategory] = field(default_factory=list)
    tags: TagsFilter = field(default_factory=TagsFilter)
    bounds: Bounds = field(default_factory=Bounds)


@dataclass
class SimulationState(IdlStruct, **message("simulation_interfaces/SimulationState")):
    state: uint8 = 0


@dataclass
class SimulatorFeatures(IdlStruct, **message("simulation_interfaces/SimulatorFeatures")):
    features: sequence[uint16] = field(default_factory=list)
    spawn_formats: sequence[str] = field(default_factory=list)
    custom_info: str = ""


# Requests and responses.


@dataclass
class StepRequest(IdlStruct, **service("simulation_interfaces/StepSimulation", "Request")):
    steps: uint64


@dataclass
class StepResponse(IdlStruct, **service("simulation_interfaces/StepSimulation", "Response")):
    result: Result


@dataclass
class ResetRequest(IdlStruct, **service("simulation_interfaces/ResetSimulation", "Request")):
    scope: uint8


@dataclass
class ResetResponse(IdlStruct, **service("simulation_interfaces/ResetSimulation", "Response")):
    result: Result


@dataclass
class SpawnRequest(IdlStruct, **service("simulation_interfaces/SpawnEntity", "Request")):
    name: str
    allow_renaming: bool
    entity_resource: Resource
    entity_namespace: str
    initial_pose: PoseStamped


@dataclass
class SpawnResponse(IdlStruct, **service("simulation_interfaces/SpawnEntity", "Response")):
    result: Result
    entity_name: str = ""


@dataclass
class StatesRequest(IdlStruct, **service("simulation_interfaces/GetEntitiesStates", "Request")):
    filters: EntityFilters


@dataclass
class StatesResponse(IdlStruct, **service("simulation_interfaces/GetEntitiesStates", "Response")):
    result: Result
    entities: sequence[str] = field(default_factory=list)
    states: sequence[EntityState] = field(default_factory=list)


@dataclass
class SetStateRequest(IdlStruct, **service("simulation_interfaces/SetSimulationState", "Request")):
    state: SimulationState


@dataclass
class SetStateResponse(IdlStruct, **service("simulation_interfaces/SetSimulationState", "Response")):
    result: Result


@dataclass
class GetStateRequest(IdlStruct, **service("simulation_interfaces/GetSimulationState", "Request")):
    nothing: uint8


@dataclass
class GetStateResponse(IdlStruct, **service("simulation_interfaces/GetSimulationState", "Response")):
    state: SimulationState
    result: Result = field(default_factory=Result)


@dataclass
class FeaturesRequest(IdlStruct, **service("simulation_interfaces/GetSimulatorFeatures", "Request")):
    nothing: uint8


@dataclass
class FeaturesResponse(IdlStruct, **service("simulation_interfaces/GetSimulatorFeatures", "Response")):
    features: SimulatorFeatures


@dataclass
class ParameterValue(IdlStruct, **message("rcl_interfaces/ParameterValue")):
    type: uint8
    bool_value: bool
    integer_value: int64
    double_value: float64
    string_value: str
    byte_array_value: sequence[uint8]
    bool_array_value: sequence[bool]
    integer_array_value: sequence[int64]
    double_array_value: sequence[float64]
    string_array_value: sequence[str]


@dataclass
class Parameter(IdlStruct, **message("rcl_interfaces/Parameter")):
    name: str
    value: ParameterValue


@dataclass
class ParameterResult(IdlStruct, **message("rcl_interfaces/SetParametersResult")):
    successful: bool = True
    reason: str = ""


@dataclass
class ParametersRequest(IdlStruct, **service("rcl_interfaces/SetParameters", "Request")):
    parameters: sequence[Parameter]


@dataclass
class ParametersResponse(IdlStruct, **service("rcl_interfaces/SetParameters", "Response")):
    results: sequence[ParameterResult]


def with_header(data: Any) -> Any:
    """What is on the wire: rmw_cyclonedds puts who asks and the number of the request before each."""
    name = data.__idl__.idl_transformed_typename.replace("::", ".").removesuffix("Data_")
    return make_idl_struct(data.__name__, name, {"client": uint64, "sequence": int64, "data": data})


RELIABLE = Qos(
    Policy.Reliability.Reliable(10**9),
    Policy.Durability.Volatile,
    Policy.History.KeepLast(100),
    Policy.DataRepresentation(use_cdrv0_representation=True),
)


class Robot:
    def __init__(self, simulator: "Simulator", name: str, namespace: str, pose: Pose) -> None:
        self.name, self.start = name, pose
        self._simulator = simulator
        self._goal = simulator.writer(f"rt{namespace}/goal", Twist)
        odometry = Twist if simulator.fault == "wrong_type" else Odometry
        self._odometry = simulator.writer(f"rt{namespace}/odom", odometry)
        self._commands = simulator.reader(f"rt{namespace}/cmd_vel", Twist)
        self.ends = [self._goal, self._odometry, self._commands]
        self.reset()

    def reset(self) -> None:
        q = self.start.orientation
        self.x, self.y = self.start.position.x, self.start.position.y
        self.yaw = math.atan2(2 * (q.w * q.z + q.x * q.y), 1 - 2 * (q.y * q.y + q.z * q.z))
        self.command = Twist()

    def listen(self) -> None:
        for command in self._commands.take(100):
            if isinstance(command, Twist):
                self.command = command
                self._simulator.log(self.name, command)

    def move(self, seconds: float) -> None:
        speed = self.command.linear.x * self._simulator.parameters["gain"]
        self.yaw += seconds * self.command.angular.z
        self.x += seconds * speed * math.cos(self.yaw)
        self.y += seconds * speed * math.sin(self.yaw)

    @property
    def pose(self) -> Pose:
        turned = Quaternion(0.0, 0.0, math.sin(self.yaw / 2), math.cos(self.yaw / 2))
        return Pose(Point(self.x, self.y, 0.0), turned)

    def publish(self, fault: str) -> None:
        if fault == "silent" and self.name == "robot_1":
            return
        if self._simulator.fault == "wrong_type":
            self._odometry.write(Twist())
        else:
            self._odometry.write(Odometry(pose=PoseWithCovariance(self.pose)))
        dx, dy = 3.0 - self.x, -self.y
        ahead = math.cos(self.yaw) * dx + math.sin(self.yaw) * dy
        left = math.cos(self.yaw) * dy - math.sin(self.yaw) * dx
        if fault == "nan" and self.name == "robot_1":
            left = math.nan
        self._goal.write(Twist(linear=Vector3(ahead, left, 0.0)))


LOCALHOST = """<CycloneDDS><Domain>
    <General><AllowMulticast>false</AllowMulticast></General>
    <Discovery><ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>32</MaxAutoParticipantIndex>
        <Peers><Peer address="localhost"/></Peers></Discovery>
</Domain></CycloneDDS>"""
"""What rmw_cyclonedds tells Cyclone DDS where ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST."""


class Simulator:
    def __init__(self, fault: str, robots: int, publish_on_reset: bool) -> None:
        self.fault, self._publish_on_reset = fault, publish_on_reset
        if os.environ.get("ROS_AUTOMATIC_DISCOVERY_RANGE") == "LOCALHOST":
            os.environ.setdefault("CYCLONEDDS_URI", LOCALHOST)
        self._node = DomainParticipant(int(os.environ.get("ROS_DOMAIN_ID", "0")))
        self._waiting = WaitSet(self._node)
        self._conditions: dict[Any, Any] = {}
        self.robots: dict[str, Robot] = {}
        self.parameters: dict[str, float] = {"gain": 1.0}
        self.steps, self.paused = 0, False
        self.spawned: list[Robot] = []
        for number in range(1, robots + 1):
            name = f"robot_{number}"
            self.robots[name] = Robot(self, name, f"/{name}", Pose(Point(0.0, 0.5 * number, 0.0)))
        kinds = {
            "/step_simulation": (StepRequest, StepResponse, self.step),
            "/reset_simulation": (ResetRequest, ResetResponse, self.reset),
            "/spawn_entity": (SpawnRequest, SpawnResponse, self.spawn),
            "/get_entities_states": (StatesRequest, StatesResponse, self.states),
            "/set_simulation_state": (SetStateRequest, SetStateResponse, self.set_state),
            "/get_simulation_state": (GetStateRequest, GetStateResponse, self.get_state),
            "/get_simulator_features": (FeaturesRequest, FeaturesResponse, self.features),
            "/simulator/set_parameters": (ParametersRequest, ParametersResponse, self.set_parameters),
        }
        self._services = []
        for name, (request, response, handler) in kinds.items():
            answered = with_header(response)
            reader = self.reader(f"rq{name}Request", with_header(request))
            writer = self.writer(f"rr{name}Reply", answered)
            self._services.append((reader, writer, response, answered, handler))

    def writer(self, topic: str, kind: Any) -> Any:
        return DataWriter(self._node, Topic(self._node, topic, kind), qos=RELIABLE)

    def reader(self, topic: str, kind: Any) -> Any:
        reader = DataReader(self._node, Topic(self._node, topic, kind), qos=RELIABLE)
        condition = ReadCondition(reader, ViewState.Any | SampleState.Any | InstanceState.Any)
        self._waiting.attach(condition)
        self._conditions[reader] = condition
        return reader

    def _forget(self, robot: Robot) -> None:
        for end in robot.ends:
            if end in self._conditions:
                condition = self._conditions.pop(end)
                self._waiting.detach(condition)
                condition.__del__()
            end.__del__()

    def log(self, name: str, command: Twist) -> None:
        """Note what a robot was told."""
        if given.log:
            with Path(given.log).open("a", encoding="utf-8") as file:
                file.write(f"{name} {command.linear.x} {command.angular.z}\n")

    def run(self) -> None:
        clock = self.writer("rt/clock", Clock) if given.realtime else None
        due, seconds = time.monotonic(), 0.0
        while True:
            if clock is None:
                self._waiting.wait(10**9)
            else:
                due += 0.02 / given.realtime
                self._waiting.wait(max(0, int((due - time.monotonic()) * 1e9)))
                if not self.paused and not (self.fault == "clock_stops" and seconds > 1.5):
                    seconds += 0.02
                    clock.write(Clock(Time(int(seconds), round(seconds % 1 * 1e9))))
                for robot in self.robots.values():
                    robot.move(0.02)
                self.publish()
            for robot in self.robots.values():
                robot.listen()
            for requests, responses, kind, answered, handler in self._services:
                for request in requests.take(10):
                    if not isinstance(request, IdlStruct):
                        continue
                    answer = handler(request.data)
                    if answer is not None:
                        self._await(responses)
                        responses.write(answered(request.client, request.sequence, kind(*answer)))

    @staticmethod
    def _await(responses: Any) -> None:
        deadline = time.monotonic() + 2
        while not responses.get_matched_subscriptions() and time.monotonic() < deadline:
            time.sleep(0.005)

    def publish(self) -> None:
        late = self.fault if self.steps >= 5 else ""
        for robot in self.robots.values():
            robot.publish(late)

    def step(self, request: StepRequest) -> tuple[Any, ...] | None:
        if not self.paused:
            return (Result(INCORRECT_STATE, "the simulation is not paused"),)
        self.steps += 1
        if self.steps >= 5 and self.fault == "dies":
            print("the engine is on fire", flush=True)
            sys.exit(7)
        if self.steps >= 5 and self.fault == "step_fails":
            return (Result(FAILED, "physics diverged"),)
        if self.steps >= 5 and self.fault == "step_hangs":
            return None
        for _ in range(request.steps):
            for robot in self.robots.values():
                robot.move(0.01)
        self.publish()
        return (Result(),)

    def reset(self, request: ResetRequest) -> tuple[Any, ...]:
        if self.fault == "reset_fails":
            return (Result(FAILED, "the world is locked"),)
        scope = request.scope or 255
        if scope & SPAWNED:
            for robot in self.spawned:
                self._forget(self.robots.pop(robot.name))
            self.spawned.clear()
        if scope & STATE:
            for robot in self.robots.values():
                robot.reset()
        if scope & TIME:
            self.steps = 0
        if self._publish_on_reset:
            self.publish()
        return (Result(),)

    def spawn(self, request: SpawnRequest) -> tuple[Any, ...]:
        if request.name in self.robots:
            return Result(NOT_UNIQUE, f"{request.name} is there already"), ""
        if not (request.entity_resource.uri or request.entity_resource.resource_string):
            return Result(104, ""), ""
        pose = request.initial_pose.pose
        robot = self.robots[request.name] = Robot(self, request.name, request.entity_namespace, pose)
        self.spawned.append(robot)
        return Result(), request.name

    def states(self, request: StatesRequest) -> tuple[Any, ...]:
        chosen = [one for name, one in self.robots.items() if re.search(request.filters.filter, name)]
        return Result(), [one.name for one in chosen], [EntityState(pose=one.pose) for one in chosen]

    def set_state(self, request: SetStateRequest) -> tuple[Any, ...]:
        paused = request.state.state == 2
        if paused == self.paused:
            return (Result(101, "it is so"),)
        self.paused = paused
        return (Result(),)

    def get_state(self, _: GetStateRequest) -> tuple[Any, ...]:
        return (SimulationState(2 if self.paused else 1),)

    def features(self, _: FeaturesRequest) -> tuple[Any, ...]:
        return (SimulatorFeatures([0, 10, 20, 21, 22, 23, 24, 25, 26, 31, 32], ["sdf"], "a stand-in"),)

    def set_parameters(self, request: ParametersRequest) -> tuple[Any, ...]:
        results = []
        for one in request.parameters:
            number = {2: one.value.integer_value, 3: one.value.double_value}.get(one.value.type)
            known = number is not None and one.name in {"seed", "gain"}
            results.append(ParameterResult(known, "" if known else "there is no such parameter"))
            if known:
                self.parameters[one.name] = number
        return (results,)


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--robots", type=int, default=0)
    parser.add_argument("--fault", default="")
    parser.add_argument("--publish-on-reset", action="store_true")
    parser.add_argument("--realtime", type=float, default=0.0, help="so many times as fast")
    parser.add_argument("--log", help="file for the commands that come")
    parser.add_argument("--note", help="for who looks at processes")
    given = parser.parse_args()
    Simulator(given.fault, given.robots, given.publish_on_reset).run()
