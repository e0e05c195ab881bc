"""Sections of what an experiment says of robots of a ROS system: sensors, step, reset, metrics, .."""

from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, WithJsonSchema, field_validator, model_validator

from swarmwright.common.options import Options
from swarmwright.common.problems import shown
from swarmwright.simulations.command.definition import Command
from swarmwright.simulations.ros.reductions import FUNCTIONS

_INTERVAL = {"type": "array", "items": {"type": "number"}, "minItems": 2, "maxItems": 2}
Interval = Annotated[list[float], Field(min_length=2, max_length=2), WithJsonSchema(_INTERVAL)]
Reduce = Literal["last", "first", "mean", "sum", "min", "max", "std", "count"]
assert set(FUNCTIONS) == set(Reduce.__args__)  # type: ignore[attr-defined] # of a Literal

STEP_SIMULATION = "simulation_interfaces/StepSimulation"
RESET_SIMULATION = "simulation_interfaces/ResetSimulation"
SPAWN_ENTITY = "simulation_interfaces/SpawnEntity"
GET_ENTITIES_STATES = "simulation_interfaces/GetEntitiesStates"
SCOPES = {"default": 0, "time": 1, "state": 2, "spawned": 4, "all": 255}
"""Of ResetSimulation: its bits by name."""


def _listed(value: Any) -> Any:  # noqa: ANN401 - whatever the file says
    return [value] if isinstance(value, str) else value


class Place(Options):
    """A field of the messages of a topic."""

    topic: str = Field(min_length=1)
    """Topic. A relative one is in the robot's namespace: scan is /robot_1/scan. {robot} stands for the
    robot's name: /model/{robot}/scan."""
    type: str = Field(min_length=1)
    """Type of the topic's messages, such as sensor_msgs/LaserScan."""
    field: str | None = Field(default=None, min_length=1)
    """Field of the messages, such as pose.pose.position.x; types with one field need none."""
    scale: float = 1.0
    """Factor by which the value is multiplied."""
    offset: float = 0.0
    """Added after the scale."""


class Sensor(Place):
    """A sensor: value * scale + offset, limited to `clip`."""

    sensor: str = Field(min_length=1)
    """Name of the sensor."""
    clip: Interval | None = None
    """Limits of the value that the controller gets, [low, high]. Default: none."""
    timeout: float | None = Field(default=None, gt=0)
    """Where steps have a duration, seconds for which a message counts, for sensors that are slower than
    steps. Default: a message has to arrive in each step."""
    sector: Interval | None = None
    """Sector of a scan, [FROM, TO] in degrees, counter-clockwise from straight ahead. Default: the whole
    scan."""
    reduce: Literal["min", "mean"] | None = None
    """How the ranges of a scan become one number. Default: min."""
    infinite: float | None = None
    """Value of a range where nothing is detected. Default: the sensor's largest range. Ranges below its
    smallest one are not measurements."""


class Actuator(Place):
    """An actuator: what is sent is actuator * scale + offset, limited to `limits`."""

    actuator: str = Field(min_length=1)
    """Name of the actuator."""
    limits: Interval | None = None
    """Limits of the value that is sent, [low, high]. Default: none."""


class Step(Options):
    """How a step is made: time passes, or a service of the simulator is called."""

    duration: float | None = Field(default=None, gt=0)
    """Duration of a step in seconds. `step: 0.1` is short for {duration: 0.1}."""
    clock: Literal["wall", "ros"] = "wall"
    """Clock that measures the duration. ros: /clock, of a simulator that may be faster or slower."""
    service: str | None = Field(default=None, min_length=1)
    """The simulator's service that makes a step and answers when it is done. Default for StepSimulation:
    /step_simulation; Gazebo has /gzserver/step_simulation."""
    type: Literal["std_srvs/Trigger", "std_srvs/Empty", "simulation_interfaces/StepSimulation"] | None = None
    """Type of the service. Default: std_srvs/Trigger."""
    steps: int = Field(default=1, ge=1, le=2**53)
    """StepSimulation: steps of the simulator that are one step of the controller."""
    delay: float = Field(default=0.0, ge=0, le=60)
    """Seconds between sending commands and calling the service, for simulators in which commands arrive
    later than calls: topics and services have no common order in ROS."""
    messages: int = Field(default=1, ge=1, le=1_000_000)
    """Messages from each sensor that a call brings; the last one counts."""

    @model_validator(mode="after")
    def _fits(self) -> "Step":
        if (self.duration is None) == (self.service is None and self.type is None):
            raise ValueError("duration: give either the duration of a step or a service that makes one")
        if self.steps != 1 and self.type != STEP_SIMULATION:
            raise ValueError(f"steps: only {STEP_SIMULATION} has it; write type: {STEP_SIMULATION}")
        return self

    @property
    def is_called(self) -> bool:
        """Whether a service makes steps."""
        return self.duration is None


class Reset(Options):
    """How the simulator goes back to the start of an episode: by a service or by a command.

    Without either, the next episode begins where the last one ended.
    """

    service: str | None = Field(default=None, min_length=1)
    """The service that resets, such as /gazebo/reset_world. Default for ResetSimulation: /reset_simulation;
    Gazebo has /gzserver/reset_simulation."""
    type: Literal["std_srvs/Empty", "std_srvs/Trigger", "simulation_interfaces/ResetSimulation"] | None = None
    """Type of the service. Default: std_srvs/Empty."""
    scope: Annotated[
        Any,
        BeforeValidator(_listed),
        WithJsonSchema(
            {"anyOf": [{"enum": list(SCOPES)}, {"type": "array", "items": {"enum": list(SCOPES)}}]}
        ),
    ] = Field(default=["default"])
    """ResetSimulation: what is reset: time, state (poses and velocities), spawned (what was spawned is
    removed), a list of these, or all. default: as the simulator's all."""
    command: Command | None = None
    """A command that resets, in addition to a service or instead of one; its words may hold {seed} and the
    names of the experiment's parameters in braces."""
    parameters: str | None = Field(default=None, min_length=1)
    """A node, such as /simulator. Before a reset its ROS parameters are set to the experiment's parameters
    and to the episode's seed as `seed`, 0 to 2**31 - 1. In ROS 1, the namespace on the parameter server."""
    settle: int | None = Field(default=None, ge=0, le=1_000_000)
    """Steps after a reset in which the robots stand, before the first sensors count, for simulators that
    publish nothing while they are paused. Default: 1 where StepSimulation makes steps, else 0."""

    @field_validator("scope")
    @classmethod
    def _scope(cls, value: Any) -> list[str]:  # noqa: ANN401 - whatever the file says
        if not isinstance(value, list) or not value or not all(one in SCOPES for one in value):
            raise ValueError(f"must be one of {', '.join(SCOPES)}, or a list of these, not {shown(value)}")
        return value

    @property
    def despawns(self) -> bool:
        """Whether robots that were spawned are removed."""
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
    """Where robots are put at random, by the episode's seed."""

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
    def _ordered(cls, value: list[float]) -> list[float]:
        if value[0] > value[1]:
            raise ValueError(f"must be [low, high], not {shown(value)}")
        return value


class Spawn(Options):
    """How robots come into a simulator that has SpawnEntity: after each reset that removes them."""

    service: str = Field(default="/spawn_entity", min_length=1)
    """The service that spawns robots; Gazebo has /gzserver/spawn_entity."""
    uri: str | None = Field(default=None, min_length=1)
    """The robot's model as the simulator names it: file:///models/rover.sdf, or one of its own models."""
    file: str | None = Field(default=None, min_length=1)
    """Instead of `uri`: a file, relative to the experiment file, in a format that the simulator reads. Its
    text is sent; {robot} in it stands for the robot's name."""
    poses: list[Pose] = Field(default=[])
    """Initial pose of each robot, such as [{x: 0, y: 0}, {x: 1, y: 0, yaw: 1.57}]; metres and radians."""
    area: Area | None = None
    """Instead of `poses`: an area in which robots are placed at random, by the episode's seed."""

    @model_validator(mode="after")
    def _fits(self) -> "Spawn":
        if (self.uri is None) == (self.file is None):
            raise ValueError("uri: give either uri, the simulator's name of the model, or file")
        if bool(self.poses) == (self.area is not None):
            raise ValueError("poses: give either poses, one of each robot, or area")
        return self


class Metric(Options):
    """A number of an episode: read from a topic, a sensor or the simulator after each step, and reduced."""

    topic: str | None = Field(default=None, min_length=1)
    """As for a sensor. An absolute topic without {robot} is one value for all robots."""
    type: str | None = Field(default=None, min_length=1)
    """Type of the topic's messages; or simulation_interfaces/GetEntitiesStates, the simulator's own knowledge
    of where robots are."""
    field: str | None = Field(default=None, min_length=1)
    """As for a sensor. For GetEntitiesStates: pose.position.x, yaw, twist.linear.x, .."""
    sensor: str | None = Field(default=None, min_length=1)
    """Instead of a topic: the name of a sensor, whose values are those that controllers get."""
    service: str | None = Field(default=None, min_length=1)
    """Service for GetEntitiesStates. Default: /get_entities_states; Gazebo has
    /gzserver/get_entities_states."""
    entity: str | None = Field(default=None, min_length=1)
    """The simulator's name of a robot, with {robot} for the robot's name; or another entity of the simulator,
    one for all robots. Default: {robot}."""
    scale: float = 1.0
    """Factor by which the value is multiplied."""
    offset: float = 0.0
    """Added after the scale."""
    otherwise: float | None = None
    """The value until the first message on the topic. With it, the topic need not send a message in every
    step, for topics on which a message is sent only when something happens; the last message counts."""
    sector: Interval | None = None
    """As for a sensor."""
    reduce: Literal["min", "mean"] | None = None
    """As for a sensor."""
    infinite: float | None = None
    """As for a sensor."""
    time: Reduce = "last"
    """How the values of an episode, taken before the first step and after each one, become one number."""
    robots: Reduce = "mean"
    """How the values of all robots, in their order, become one number."""

    @model_validator(mode="after")
    def _fits(self) -> "Metric":
        states = self.type == GET_ENTITIES_STATES
        if sum((self.topic is not None, self.sensor is not None, states)) != 1:
            raise ValueError(f"topic: give a topic, a sensor, or type: {GET_ENTITIES_STATES}")
        if self.topic is not None and self.type is None:
            raise ValueError("type: is missing: that of the topic's messages")
        if states and self.field is None:
            raise ValueError("field: is missing, such as pose.position.x")
        given = self.model_dump(exclude_defaults=True)
        of_a_sensor = ("type", "field", "service", "entity", "sector", "reduce", "infinite", "otherwise")
        useless = {"sensor": of_a_sensor, "topic": ("service", "entity")}
        for key, others in useless.items():
            for other in others:
                if key in given and other in given:
                    raise ValueError(f"{other}: has no meaning with {key}; leave it out")
        return self

    @property
    def place(self) -> dict[str, Any]:
        """Return what a sensor with these values says."""
        given = self.model_dump(exclude_defaults=True)
        return {key: value for key, value in given.items() if key not in _OF_METRICS}


_OF_METRICS = {"time", "robots", "service", "entity", "otherwise"}
