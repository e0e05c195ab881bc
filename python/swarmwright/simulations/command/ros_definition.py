"""The definition of a simulation with robots of a ROS system, `simulation: {ros: 2, ..}`."""

import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

from pydantic import BeforeValidator, Field, WithJsonSchema, field_validator, model_validator

from swarmwright.common import metric_names
from swarmwright.common.options import Options
from swarmwright.common.problems import FieldError, format_value
from swarmwright.common.simulation_names import SimulationName
from swarmwright.common.suggestions import did_you_mean, suggest_or_list
from swarmwright.common.yaml import Path_, format_path
from swarmwright.simulations.command.definition import Choices, Command, CommandOptions, Definition
from swarmwright.simulations.ros.expression import FUNCTIONS
from swarmwright.simulations.ros.fields import READERS, STATES, WRITERS, SameFieldError, reader, writers
from swarmwright.simulations.ros.mapping import MappingError, choice, read_mapping, short_type
from swarmwright.simulations.ros.middleware import namespace_of, resolve


def problems(options: "RosOptions") -> list[tuple[Path_, str]]:
    """Return problems, with the keys."""
    return [*_check_topics(options), *_check_metrics(options), *_check_services(options)]


def _check_topics(options: "RosOptions") -> Iterator[tuple[Path_, str]]:
    for key, entries, name in (
        ("sensors", options.sensors, "sensor"),
        ("actuators", options.actuators, "actuator"),
    ):
        names: list[str] = []
        for index, entry in enumerate(entries):
            path: Path_ = (key, index)
            entry_name: str = getattr(entry, name)
            if entry_name in names:
                yield (*path, name), f"{entry_name} is defined twice; give each a different name"
            names.append(entry_name)
            yield from _check_entry(entry.model_dump(exclude_defaults=True), key, path)
    if bool(options.sensors) != bool(options.actuators):
        missing = "sensors" if options.actuators else "actuators"
        yield (missing,), "is missing: controllers need sensors and actuators"
    yield from _check_types(options)
    actuator_names = [actuator.actuator for actuator in options.actuators]
    block = {"rate": 1, "sensors": [], "actuators": options.topics["actuators"]}
    try:
        actuators = read_mapping(block, [], actuator_names).actuators
        for topic in dict.fromkeys(actuator.topic_field.topic for actuator in actuators):
            writers([actuator for actuator in actuators if actuator.topic_field.topic == topic])
    except SameFieldError as error:
        yield ("actuators", error.actuator.terms[0][0]), error.reason
    except MappingError:
        pass  # of a single entry, which is reported above


def _check_types(options: "RosOptions") -> Iterator[tuple[Path_, str]]:
    """Yield problems with topics and their types; a topic has a single type."""
    types: dict[str, tuple[str, str]] = {}
    places: list[tuple[Path_, Any]] = [
        (("sensors", index), sensor) for index, sensor in enumerate(options.sensors)
    ]
    places += [(("actuators", index), actuator) for index, actuator in enumerate(options.actuators)]
    places += [(("metrics", name), metric) for name, metric in options.metrics.items() if metric.topic]
    for path, described in places:
        wrong = _check_topic_name(described.topic)
        if wrong is not None:
            yield (
                (*path, "topic"),
                f"{described.topic!r} is not a topic: {wrong}; expected such as scan or /robot_1/scan",
            )
            continue
        if "{robot}" in described.topic and "/" in options.robots:
            yield (*path, "topic"), "{robot} requires robots with names; write robots: [NAME, ..]"
        type_name, where = types.setdefault(described.topic, (short_type(described.type), format_path(path)))
        if type_name != short_type(described.type):
            yield (
                (*path, "type"),
                f"{described.topic} has the type {type_name} at {where}; a topic has a single type",
            )


def _check_topic_name(topic: str) -> str | None:
    """Return why a topic, which may contain `{robot}`, is not valid; None if it is."""
    if topic.startswith("~"):
        return "names that are private to a node are not supported"
    try:
        resolve(topic.replace("{robot}", "robot"))
    except ValueError as error:
        return str(error)
    return None


def _check_metrics(options: "RosOptions") -> Iterator[tuple[Path_, str]]:
    sensors = [sensor.sensor for sensor in options.sensors]
    for name, metric in options.metrics.items():
        path: Path_ = ("metrics", name)
        if metric.sensor is not None:
            if metric.sensor not in sensors:
                available = f"; available: {', '.join(sensors) or 'none'}"
                hint = did_you_mean(metric.sensor, sensors) or available
                yield (*path, "sensor"), f"there is no sensor {metric.sensor!r}{hint}"
        elif metric.type == GET_ENTITIES_STATES:
            if options.ros == 1:
                yield (*path, "type"), "simulation_interfaces require ROS 2"
            if metric.field not in STATES:
                hint = suggest_or_list(metric.field or "", STATES)
                yield (*path, "field"), f"{metric.field!r} is not a field of an entity's state{hint}"
        else:
            yield from _check_entry({**metric.sensor_keys, "sensor": name}, "sensors", path)


def _check_services(options: "RosOptions") -> Iterator[tuple[Path_, str]]:
    for key, section in (("step", options.step), ("reset", options.reset)):
        if options.ros == 1 and (section.type or "").startswith("simulation_interfaces"):
            yield (key, "type"), f"{section.type} requires ROS 2"
    if options.reset.type != RESET_SIMULATION and options.reset.scope != ["default"]:
        yield ("reset", "scope"), f"only possible with {RESET_SIMULATION}; write type: {RESET_SIMULATION}"
    if options.spawn is not None:
        if options.ros == 1:
            yield ("spawn",), f"{SPAWN_ENTITY} requires ROS 2"
        if options.spawn.poses and len(options.spawn.poses) != len(options.robots):
            count, poses = len(options.robots), len(options.spawn.poses)
            yield ("spawn", "poses"), f"must have a pose for each of the {count} robots, not {poses}"
        if options.spawn.file is not None and not (Path(options.folder) / options.spawn.file).is_file():
            yield ("spawn", "file"), f"{options.spawn.file}: there is no such file"
        elif options.spawn.file is not None:
            try:
                (Path(options.folder) / options.spawn.file).read_text("utf-8")
            except OSError as error:
                yield ("spawn", "file"), f"{options.spawn.file}: cannot be read: {error.strerror}"
            except UnicodeDecodeError:
                yield ("spawn", "file"), f"{options.spawn.file}: is not UTF-8 text, expected SDF or URDF"


def _check_entry(entry: Mapping[str, Any], key: str, path: Path_) -> Iterator[tuple[Path_, str]]:
    """Check an entry in the same way as the program that reads it."""
    name = "sensor" if key == "sensors" else "actuator"
    supported = READERS if key == "sensors" else WRITERS
    if short_type(entry["type"]) not in supported:
        yield (*path, "type"), f"{entry['type']!r} is not supported; expected {choice(list(supported))}"
        return
    other_key = {"sensors": "actuators", "actuators": "sensors"}[key]
    try:
        mapping = read_mapping({"rate": 1, key: [dict(entry)], other_key: []},
                               [entry[name]] if name == "sensor" else [],
                               [entry[name]] if name == "actuator" else [])  # fmt: skip
        if key == "sensors":
            reader(mapping.sensors[0])
        else:
            writers(mapping.actuators)
    except MappingError as error:
        if not error.key:
            yield path, error.reason
        else:
            message = error.reason.removeprefix(f"{error.key}:").removeprefix(f"{error.key} ")
            yield (*path, error.key), message.strip()


_INTERVAL = {"type": "array", "items": {"type": "number"}, "minItems": 2, "maxItems": 2}
Interval = Annotated[list[float], Field(min_length=2, max_length=2), WithJsonSchema(_INTERVAL)]
Reduce = Literal["last", "first", "mean", "sum", "min", "max", "std", "count"]
assert set(FUNCTIONS) == set(Reduce.__args__)  # type: ignore[attr-defined] # of a Literal

STEP_SIMULATION = "simulation_interfaces/StepSimulation"
RESET_SIMULATION = "simulation_interfaces/ResetSimulation"
SPAWN_ENTITY = "simulation_interfaces/SpawnEntity"
GET_ENTITIES_STATES = "simulation_interfaces/GetEntitiesStates"
SCOPES = {"default": 0, "time": 1, "state": 2, "spawned": 4, "all": 255}
"""Bits of the scope of ResetSimulation, by name."""


def _to_list(value: Any) -> Any:  # noqa: ANN401 - whatever the file says
    return [value] if isinstance(value, str) else value


class TopicField(Options):
    """A field of the messages of a topic."""

    topic: str = Field(min_length=1)
    """Topic, relative to the robot's namespace (scan is /robot_1/scan), or with {robot} for its name."""
    type: str = Field(min_length=1)
    """Type of the topic's messages, such as sensor_msgs/LaserScan."""
    field: str | None = Field(default=None, min_length=1)
    """Field of the messages, such as pose.pose.position.x; not needed for types with a single field."""
    scale: float = 1.0
    """Factor by which the value is multiplied."""
    offset: float = 0.0
    """Added after the scale."""


class Sensor(TopicField):
    """A sensor: value * scale + offset, limited to `clip`."""

    sensor: str = Field(min_length=1)
    """Name of the sensor."""
    clip: Interval | None = None
    """Limits of the value that the controller receives, [low, high]. Default: none."""
    timeout: float | None = Field(default=None, gt=0)
    """Seconds for which a message is valid, for sensors slower than steps with a duration. Default: each step
    needs a message."""
    sector: Interval | None = None
    """Sector of a scan, [FROM, TO] in degrees, counter-clockwise from straight ahead. Default: the whole
    scan."""
    reduce: Literal["min", "mean"] | None = None
    """How the ranges of a scan are reduced to a number. Default: min."""
    infinite: float | None = None
    """Value of a range without a detection. Default: the sensor's largest range."""


class Actuator(TopicField):
    """An actuator: actuator * scale + offset, limited to `limits`, is sent."""

    actuator: str = Field(min_length=1)
    """Name of the actuator."""
    limits: Interval | None = None
    """Limits of the value that is sent, [low, high]. Default: none."""


class Step(Options):
    """How a step is made: by waiting, or by calling a service of the simulator."""

    duration: float | None = Field(default=None, gt=0)
    """Duration of a step in seconds. `step: 0.1` is short for {duration: 0.1}."""
    clock: Literal["wall", "ros"] = "wall"
    """Clock for the duration. ros: /clock, for a simulator that may be faster or slower than real time."""
    service: str | None = Field(default=None, min_length=1)
    """Service that makes a step. Default for StepSimulation: /step_simulation (Gazebo:
    /gzserver/step_simulation)."""
    type: Literal["std_srvs/Trigger", "std_srvs/Empty", "simulation_interfaces/StepSimulation"] | None = None
    """Type of the service. Default: std_srvs/Trigger."""
    steps: int = Field(default=1, ge=1, le=2**53)
    """StepSimulation: steps of the simulator in a step of the controller."""
    delay: float = Field(default=0.0, ge=0, le=60)
    """Seconds between commands and the call of the service, for simulators that receive commands late."""
    messages: int = Field(default=1, ge=1, le=1_000_000)
    """Messages of each sensor that a call produces; the last one is used."""

    @model_validator(mode="after")
    def _fits(self) -> "Step":
        if (self.duration is None) == (self.service is None and self.type is None):
            raise FieldError("duration", "write either the duration of a step or a service that makes a step")
        if self.steps != 1 and self.type != STEP_SIMULATION:
            raise FieldError("steps", f"only possible with {STEP_SIMULATION}; write type: {STEP_SIMULATION}")
        return self

    @property
    def is_called(self) -> bool:
        """Whether a service makes steps."""
        return self.duration is None


class Reset(Options):
    """How the simulator is reset for an episode: by a service or by a command.

    Without either, an episode begins in the final state of the previous one.
    """

    service: str | None = Field(default=None, min_length=1)
    """Service that resets, such as /gazebo/reset_world. Default for ResetSimulation: /reset_simulation
    (Gazebo: /gzserver/reset_simulation)."""
    type: Literal["std_srvs/Empty", "std_srvs/Trigger", "simulation_interfaces/ResetSimulation"] | None = None
    """Type of the service. Default: std_srvs/Empty."""
    scope: Annotated[
        Any,
        BeforeValidator(_to_list),
        WithJsonSchema(
            {"anyOf": [{"enum": list(SCOPES)}, {"type": "array", "items": {"enum": list(SCOPES)}}]}
        ),
    ] = Field(default=["default"])
    """ResetSimulation: time, state (poses and velocities), spawned (removes entities), a list of these, all,
    or the simulator's default.
    """
    command: Command | None = None
    """Command that resets the simulator, in addition to a service or instead of it, with {seed} and
    parameters in braces."""
    parameters: str | None = Field(default=None, min_length=1)
    """Node (ROS 1: namespace), such as /simulator, whose ROS parameters are set to the experiment's
    parameters and the episode's `seed` before a reset."""
    settle: int | None = Field(default=None, ge=0, le=1_000_000)
    """Steps at rest after a reset before sensors are read, for simulators that publish nothing while paused.
    Default: 1 for StepSimulation, else 0."""

    @field_validator("scope")
    @classmethod
    def _scope(cls, value: Any) -> list[str]:  # noqa: ANN401 - whatever the file says
        if not isinstance(value, list) or not value or not all(letter in SCOPES for letter in value):
            raise ValueError(
                f"must be one of {', '.join(SCOPES)}, or a list of these, not {format_value(value)}"
            )
        return value

    @property
    def despawns(self) -> bool:
        """Whether a reset removes spawned robots."""
        return self.type == RESET_SIMULATION and bool({"default", "all", "spawned"} & set(self.scope))


class Pose(Options):
    """Position in metres, and yaw in radians."""

    x: float = 0.0
    """Metres."""
    y: float = 0.0
    """Metres."""
    z: float = 0.0
    """Metres."""
    yaw: float = 0.0
    """Radians, counter-clockwise."""


class Area(Options):
    """Area in which robots are placed at random, by the episode's seed."""

    x: Interval
    """Metres, [low, high]."""
    y: Interval
    """Metres, [low, high]."""
    z: float = 0.0
    """Metres."""
    yaw: Interval = Field(default=[-3.141592653589793, 3.141592653589793])
    """Radians, [low, high]."""

    @field_validator("x", "y", "yaw")
    @classmethod
    def _check_order(cls, value: list[float]) -> list[float]:
        if value[0] > value[1]:
            raise ValueError(f"must be [low, high], not {format_value(value)}")
        return value


class Spawn(Options):
    """How robots are spawned in a simulator that has SpawnEntity: after each reset that removes them."""

    service: str = Field(default="/spawn_entity", min_length=1)
    """The service that spawns robots; Gazebo has /gzserver/spawn_entity."""
    uri: str | None = Field(default=None, min_length=1)
    """The simulator's name of the robot's model, such as file:///models/rover.sdf."""
    file: str | None = Field(default=None, min_length=1)
    """Instead of `uri`: a model file, relative to the experiment file, with {robot} for the robot's name."""
    poses: list[Pose] = Field(default=[])
    """Initial pose of each robot, such as [{x: 0, y: 0}, {x: 1, y: 0, yaw: 1.57}]; metres and radians."""
    area: Area | None = None
    """Instead of `poses`: an area for random positions."""

    @model_validator(mode="after")
    def _fits(self) -> "Spawn":
        if (self.uri is None) == (self.file is None):
            raise FieldError("uri", "write either uri, the simulator's name of the model, or file")
        if bool(self.poses) == (self.area is not None):
            raise FieldError("poses", "write either poses, with a pose for each robot, or area")
        return self


class Metric(Options):
    """A number of an episode: read from a topic, a sensor or the simulator after each step, and reduced."""

    topic: str | None = Field(default=None, min_length=1)
    """As for a sensor. An absolute topic without {robot} is a single value for all robots."""
    type: str | None = Field(default=None, min_length=1)
    """Type of the topic's messages, or simulation_interfaces/GetEntitiesStates for the states of robots."""
    field: str | None = Field(default=None, min_length=1)
    """As for a sensor. For GetEntitiesStates: pose.position.x, yaw, twist.linear.x, .."""
    sensor: str | None = Field(default=None, min_length=1)
    """Instead of a topic: the name of a sensor, with the values that controllers receive."""
    service: str | None = Field(default=None, min_length=1)
    """Service for GetEntitiesStates. Default: /get_entities_states (Gazebo:
    /gzserver/get_entities_states)."""
    entity: str | None = Field(default=None, min_length=1)
    """The simulator's name of a robot, with {robot}, or of another entity. Default: {robot}."""
    scale: float = 1.0
    """Factor by which the value is multiplied."""
    offset: float = 0.0
    """Added after the scale."""
    otherwise: float | None = None
    """Value until the first message, for topics without messages in every step."""
    sector: Interval | None = None
    """As for a sensor."""
    reduce: Literal["min", "mean"] | None = None
    """As for a sensor."""
    infinite: float | None = None
    """As for a sensor."""
    time: Reduce = "last"
    """Reduction of the values of an episode, from before the first step to the last, to a number."""
    robots: Reduce = "mean"
    """Reduction of the values of all robots to a number."""

    @model_validator(mode="after")
    def _fits(self) -> "Metric":
        states = self.type == GET_ENTITIES_STATES
        if sum((self.topic is not None, self.sensor is not None, states)) != 1:
            raise FieldError("topic", f"write a topic, a sensor, or type: {GET_ENTITIES_STATES}")
        if self.topic is not None and self.type is None:
            raise FieldError("type", "is missing; write the type of the topic's messages")
        if states and self.field is None:
            raise FieldError("field", "is missing, such as pose.position.x")
        values = self.model_dump(exclude_defaults=True)
        of_a_sensor = ("type", "field", "service", "entity", "sector", "reduce", "infinite", "otherwise")
        useless = {"sensor": of_a_sensor, "topic": ("service", "entity")}
        for key, keys in useless.items():
            for other in keys:
                if key in values and other in values:
                    raise FieldError(other, f"has no meaning with {key}; leave it out")
        return self

    @property
    def sensor_keys(self) -> dict[str, Any]:
        """The keys of a sensor with these values."""
        values = self.model_dump(exclude_defaults=True)
        return {key: value for key, value in values.items() if key not in _OF_METRICS}


_OF_METRICS = {"time", "robots", "service", "entity", "otherwise"}


_TRIGGERS = ("std_srvs/Trigger", "std_srvs/Empty")
"""Default types of services, of a step and of a reset."""
ATTACHMENT = "attachment.json"
"""Name of the program's input file in the folder of an instance."""
INSTANCE_PLACEHOLDERS = ("instance", "port", "domain", "folder", "here")
"""Placeholders that are set when the program starts."""
DOMAINS = 100
"""DDS domains for instances; the ports of higher domains may be used by other programs on Linux."""
MOST_ROBOTS = 1000
"""Largest number of robots of an experiment."""
PROGRAM = Path(__file__).parents[1] / "ros"
"""The folder of the program that controls the robots, which another Python can start."""


def _number_of_robots(value: Any) -> Any:  # noqa: ANN401 - whatever the file says
    if isinstance(value, int) and not isinstance(value, bool):
        if not 1 <= value <= MOST_ROBOTS:
            raise ValueError(f"must be at least 1 and at most {MOST_ROBOTS:,}, not {value}")
        return [f"robot_{number}" for number in range(1, value + 1)]
    return [value] if isinstance(value, str) else value


def _seconds(value: Any) -> Any:  # noqa: ANN401 - whatever the file says
    if isinstance(value, str):
        raise ValueError(f"must be seconds, such as 0.1, or {{service: /step}}, not {format_value(value)}")
    return {"duration": value} if isinstance(value, int | float) and not isinstance(value, bool) else value


class RosOptions(Definition):
    """Robots of a running ROS 1 or ROS 2 system: topics are their sensors and actuators.

    It needs the Python that ROS is installed for; for ROS 2, `middleware: dds` needs no ROS installation.
    """

    prefix: ClassVar[str] = SimulationName.ROS

    ros: Literal[1, 2]
    """The version of ROS."""
    middleware: Literal["rospy", "rclpy", "dds"] | None = None
    """Client library: rospy (ROS 1); dds (`pip install 'swarmwright[ros2]'`) or rclpy (ROS 2). Default: rospy
    or dds."""
    python: str | None = Field(default=None, min_length=1)
    """The Python that can import rospy or rclpy. Default: /usr/bin/python3."""
    title: str | None = Field(default=None, min_length=1, max_length=1000)
    """The name in discovery. Default: ros1 or ros2, and a digest of this definition and its files."""
    robots: Annotated[
        Any,
        BeforeValidator(_number_of_robots),
        WithJsonSchema(
            {
                "anyOf": [
                    {"type": "integer", "minimum": 1, "maximum": MOST_ROBOTS},
                    {"type": "array", "items": {"type": "string"}, "minItems": 1, "maxItems": MOST_ROBOTS},
                ]
            }
        ),
    ] = Field(default=["/"])
    """The robots' namespaces, or their number: robot_1, robot_2, ..; 1 to 1,000. Default: a single robot
    without a namespace."""
    sensors: list[Sensor] = Field(default=[])
    """Sensors of a robot: a list of {sensor: NAME, topic: .., type: .., ..}."""
    actuators: list[Actuator] = Field(default=[])
    """Actuators of a robot: a list of {actuator: NAME, topic: .., type: .., ..}."""
    step: Annotated[
        Step,
        BeforeValidator(_seconds, json_schema_input_type=float | Step),
    ]
    """How a step is made: its duration in seconds, or {service: ..}; see below."""
    reset: Reset = Field(default_factory=Reset)
    """How an episode begins; see below."""
    spawn: Spawn | None = None
    """How robots are spawned in the simulator; see below. Default: they exist already."""
    steps: int = Field(default=100, ge=1, le=2**31)
    """Steps of an episode."""
    done: str | None = Field(default=None, min_length=1)
    """Condition that ends an episode early, over the metrics: "collisions > 0"."""
    metrics: dict[str, Metric] = Field(default={})
    """Numbers of an episode, for `fitness`: name -> {topic: .., type: .., time: last, robots: mean}; see
    below."""
    fitness: str | None = Field(default=None, min_length=1)
    """The simulation's own fitness, an expression over its metrics. Default: the experiment's fitness, or the
    metric `fitness`."""
    start: Command | None = None
    """Command that starts a simulator for each server, with its own ROS master or domain, in a work folder.
    Default: the system is already running.
    """
    patience: float = Field(default=5.0, gt=0, le=86_400)
    """Seconds to wait for a sensor's message or a service's answer before the episode fails."""
    startup: float = Field(default=30.0, gt=0, le=86_400)
    """Seconds to wait at the start for topics and services to appear."""
    timeout: float = Field(default=600.0, gt=0, le=31 * 86_400)
    """Seconds that an episode may take."""
    recycle: int = Field(default=0, ge=0)
    """Episodes after which the program, and the command `start`, are restarted; 0 for never."""
    choices: Choices = Field(default={})
    """All values that a parameter may have, as for commands; required for text in `reset.command`."""
    environment: dict[str, str] = Field(default={})
    """Further environment variables, such as ROS_DOMAIN_ID, with {instance}, {port}, {domain}, {folder} and
    {here}."""
    dimensions: int = Field(default=2, ge=0, le=1000)
    """Spatial dimensions, which experiments may require."""
    output: float = Field(default=10.0, gt=0)
    """Megabytes that may be printed between two starts of the program."""
    disk: float = Field(default=1000.0, gt=0)
    """Megabytes that may be written into the work folder."""
    work: str | None = Field(default=None, min_length=1)
    """Parent folder of work folders. Default: the system's folder for temporary files."""
    sources: list[str] = Field(default=[])
    """Further files and folders of the simulation, for its digest and for run folders."""
    determinism: Literal["bitwise", "statistical", "none"] | None = None
    """Agreement of repeated evaluations of an episode; audits need it (`faults: {audit}`). Default: none if
    steps have a duration, else unknown.
    """
    folder: str = Field(default=".", min_length=1)
    """Base folder of relative paths in this section. Default: that of the experiment file."""

    @field_validator("robots")
    @classmethod
    def _robots(cls, value: Any) -> list[str]:  # noqa: ANN401 - whatever the file says
        if not isinstance(value, list) or not value:
            raise ValueError(
                f"must be a number of robots, or a list of namespaces, not {format_value(value)}"
            )
        if len(value) > MOST_ROBOTS:
            raise ValueError(f"must be at most {MOST_ROBOTS:,} robots, not {len(value):,}")
        names: set[str] = set()
        for name in value:
            if not isinstance(name, str) or not name:
                raise ValueError(f"{format_value(name)} is not a namespace; expected such as robot_1")
            try:
                namespace_of(name)
            except ValueError as error:
                raise ValueError(
                    f"{format_value(name)} is not a namespace: {error}; expected such as robot_1"
                ) from None
            if name in names:
                raise ValueError(f"{name} is repeated")
            names.add(name)
        return value

    @field_validator("metrics")
    @classmethod
    def _names(cls, value: dict[str, Metric]) -> dict[str, Metric]:
        metric_names.check(value)
        return value

    @model_validator(mode="after")
    def _fits(self) -> "RosOptions":
        possible = ("rospy",) if self.ros == 1 else ("dds", "rclpy")
        if self.middleware is not None and self.middleware not in possible:
            names = " or ".join(possible)
            raise FieldError("middleware", f"{self.middleware} is not for ROS {self.ros}; write {names}")
        if self.python is not None and self.connection == "dds":
            raise FieldError("python", "not possible with dds, which runs in Swarmwright's Python; use rclpy")
        return self

    @property
    def connection(self) -> str:
        """The middleware."""
        return self.middleware or ("rospy" if self.ros == 1 else "dds")

    @property
    def is_shared(self) -> bool:
        """Whether all servers control the same robots, because none has its own system."""
        placeholders = ("{instance}", "{port}", "{domain}")
        texts = [text for name, text in self.environment.items() if name.startswith("ROS_")]
        return self.start is None and not any(
            placeholder in text for text in texts for placeholder in placeholders
        )

    @property
    def interpreter(self) -> str:
        """The Python that runs the program."""
        return sys.executable if self.connection == "dds" else self.python or "/usr/bin/python3"

    @property
    def topics(self) -> dict[str, Any]:
        """Sensors and actuators in the format of an exported package's mapping."""
        return {
            "sensors": [sensor.model_dump(exclude_defaults=True) for sensor in self.sensors],
            "actuators": [actuator.model_dump(exclude_defaults=True) for actuator in self.actuators],
        }

    def list_named_files(self) -> Iterator[tuple[str, Sequence[str]]]:
        """See `Definition`."""
        yield "command", [*(self.start or ()), *(self.reset.command or ())]
        if self.spawn is not None and self.spawn.file is not None:
            yield "spawn", [self.spawn.file]
        yield "sources", self.sources

    def as_command(self) -> CommandOptions:
        """See `Definition`."""
        environment = dict(self.environment)
        if self.start is not None:
            defaults = {
                1: {
                    "ROS_MASTER_URI": "http://127.0.0.1:{port}",
                    "ROS_IP": "127.0.0.1",
                    "ROS_HOME": "{folder}/ros",
                    "ROS_LOG_DIR": "{folder}/ros/log",
                },
                2: {"ROS_DOMAIN_ID": "{domain}", "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"},
            }
            environment = defaults[self.ros] | environment
        return CommandOptions(
            command=[self.interpreter, str(PROGRAM), f"{{folder}}/{ATTACHMENT}"],
            title=self.title,
            controller="stepwise",
            sensors=len(self.sensors) or None,
            actuators=len(self.actuators) or None,
            choices=self.choices,
            metrics=dict.fromkeys(self.metrics, "last"),
            fitness=self.fitness,
            dimensions=self.dimensions,
            timeout=self.timeout,
            recycle=self.recycle,
            environment=environment,
            output=self.output,
            disk=self.disk,
            children="end",
            work=self.work,
            determinism=self.determinism or (None if self.step.is_called else "none"),
            folder=self.folder,
        )

    def attachment(self) -> dict[str, Any]:
        """Return the program's input."""
        values = self.model_dump(
            include={"ros", "robots", "steps", "done", "patience", "startup", "start"}, mode="json"
        )
        return {
            **values,
            **self.topics,
            "middleware": self.connection,
            "step": {**self.step.model_dump(), **self._service(self.step, _TRIGGERS[0], "/step_simulation")},
            "reset": {
                **self.reset.model_dump(),
                **self._service(self.reset, _TRIGGERS[1], "/reset_simulation"),
                "scope": _bits(self.reset.scope),
                "settle": self._settle,
                "despawns": self.reset.despawns,
            },
            "spawn": None if self.spawn is None else self._describe_spawn(self.spawn),
            "metrics": {name: self._describe_metric(metric) for name, metric in self.metrics.items()},
        }

    @property
    def _settle(self) -> int:
        if self.reset.settle is not None:
            return self.reset.settle
        return 1 if self.step.type == STEP_SIMULATION else 0

    @staticmethod
    def _service(section: Step | Reset, kind: str, name: str) -> dict[str, Any]:
        """Return name and type of a service; None for both if there is none."""
        if section.type is None and section.service is None:
            return {"service": None, "type": None}
        type_name = section.type or kind
        return {"service": section.service or name, "type": type_name}

    def _describe_spawn(self, spawn: Spawn) -> dict[str, Any]:
        text = "" if spawn.file is None else (Path(self.folder) / spawn.file).read_text("utf-8")
        return {**spawn.model_dump(exclude={"file"}), "uri": spawn.uri or "", "text": text}

    @staticmethod
    def _describe_metric(metric: Metric) -> dict[str, Any]:
        values: dict[str, Any] = {
            "time": metric.time,
            "robots": metric.robots,
            "otherwise": metric.otherwise,
        }
        if metric.type == GET_ENTITIES_STATES:
            service = metric.service or "/get_entities_states"
            values |= {"service": service, "entity": metric.entity or "{robot}"}
        return {**values, "place": metric.sensor_keys}

    def problems(self) -> list[tuple[Path_, str]]:
        """See `Definition`."""
        return problems(self)


def _bits(scope: Sequence[str]) -> int:
    bits = 0
    for letter in scope:
        bits |= SCOPES[letter]
    return bits
