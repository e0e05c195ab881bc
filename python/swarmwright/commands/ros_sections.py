"""Sections of what an experiment says of robots of a ROS system: sensors, step, reset, metrics, .."""

from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, WithJsonSchema, field_validator, model_validator

from swarmwright.commands.definition import Command
from swarmwright.core.options import Options
from swarmwright.core.problems import shown
from swarmwright.ros.reductions import FUNCTIONS

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
    """Relative ones are in the robot's namespace: scan is /robot_1/scan. {robot} stands for the robot's name:
    /model/{robot}/scan."""
    type: str = Field(min_length=1)
    """Of its messages, such as sensor_msgs/LaserScan."""
    field: str | None = Field(default=None, min_length=1)
    """Such as pose.pose.position.x; types with one field need none."""
    scale: float = 1.0
    """Factor."""
    offset: float = 0.0
    """Added after the scale."""


class Sensor(Place):
    """A sensor: value * scale + offset, limited to `clip`."""

    sensor: str = Field(min_length=1)
    """Its name."""
    clip: Interval | None = None
    """Limits, [low, high]."""
    timeout: float | None = Field(default=None, gt=0)
    """Where steps have a duration, seconds for which a message counts, for sensors that are slower than
    steps. Default: one has to come in each step."""
    sector: Interval | None = None
    """Of a scan, [FROM, TO] in degrees, counter-clockwise from straight ahead. Default: all of it."""
    reduce: Literal["min", "mean"] | None = None
    """What counts of the ranges of a scan. Default: min."""
    infinite: float | None = None
    """The value of ranges where nothing is. Default: the sensor's largest range."""


class Actuator(Place):
    """An actuator: what is sent is actuator * scale + offset, limited to `limits`."""

    actuator: str = Field(min_length=1)
    """Its name."""
    limits: Interval | None = None
    """Of what is sent, [low, high]."""


class Step(Options):
    """How the robots go on by one step: time passes, or a service of the simulator is called."""

    duration: float | None = Field(default=None, gt=0)
    """Seconds. `step: 0.1` is short for {duration: 0.1}."""
    clock: Literal["wall", "ros"] = "wall"
    """Whose seconds these are; ros: those of /clock, of a simulator that may be faster or slower."""
    service: str | None = Field(default=None, min_length=1)
    """The simulator's service that makes a step and answers when it is done. Default for StepSimulation:
    /step_simulation; Gazebo has /gzserver/step_simulation."""
    type: Literal["std_srvs/Trigger", "std_srvs/Empty", "simulation_interfaces/StepSimulation"] | None = None
    """Of the service. Default: std_srvs/Trigger."""
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
    """Such as /gazebo/reset_world. Default for ResetSimulation: /reset_simulation; Gazebo has
    /gzserver/reset_simulation."""
    type: Literal["std_srvs/Empty", "std_srvs/Trigger", "simulation_interfaces/ResetSimulation"] | None = None
    """Of the service. Default: std_srvs/Empty."""
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
    """A command that resets, beside a service or in its place; its words may hold {seed} and the names of
    the experiment's parameters in braces."""
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
    """Gazebo has /gzserver/spawn_entity."""
    uri: str | None = Field(default=None, min_length=1)
    """What the simulator calls the robot: file:///models/rover.sdf, or one of its own models."""
    file: str | None = Field(default=None, min_length=1)
    """Or a file in a format that it reads, whose text is sent, relative to the experiment file. {robot} in
    the text stands for the robot's name."""
    poses: list[Pose] = Field(default=[])
    """Of each robot, such as [{x: 0, y: 0}, {x: 1, y: 0, yaw: 1.57}]."""
    area: Area | None = None
    """Or where they are put at random, by the episode's seed."""

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
    """As of a sensor. Absolute ones without {robot} are one value for all robots."""
    type: str | None = Field(default=None, min_length=1)
    """Of its messages; or simulation_interfaces/GetEntitiesStates, the simulator's own knowledge of where
    robots are."""
    field: str | None = Field(default=None, min_length=1)
    """As of a sensor. Of GetEntitiesStates: pose.position.x, yaw, twist.linear.x, .."""
    sensor: str | None = Field(default=None, min_length=1)
    """Or the name of a sensor, whose values are those that controllers get."""
    service: str | None = Field(default=None, min_length=1)
    """Of GetEntitiesStates. Default: /get_entities_states; Gazebo has /gzserver/get_entities_states."""
    entity: str | None = Field(default=None, min_length=1)
    """What the simulator calls a robot, with {robot} for its name; or another thing that it knows, one for
    all robots. Default: {robot}."""
    scale: float = 1.0
    """Factor."""
    offset: float = 0.0
    """Added after the scale."""
    otherwise: float | None = None
    """The value as long as nothing has come on the topic. With it the topic need not send something in every
    step, as one that is sent only when something happens; the last one counts."""
    sector: Interval | None = None
    """As of a sensor."""
    reduce: Literal["min", "mean"] | None = None
    """As of a sensor."""
    infinite: float | None = None
    """As of a sensor."""
    time: Reduce = "last"
    """What is made of the values of an episode, before the first step and after each one."""
    robots: Reduce = "mean"
    """What is made of the values of all robots, in their order."""

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
