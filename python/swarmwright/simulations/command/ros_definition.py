"""What an experiment says of robots of a ROS system: `simulation: {ros: 2, ..}`."""

import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

from pydantic import BeforeValidator, Field, WithJsonSchema, field_validator, model_validator

from swarmwright.common import metric_names
from swarmwright.common.problems import shown
from swarmwright.common.simulation_names import SimulationName
from swarmwright.common.yaml import Path_
from swarmwright.simulations.command import ros_checks
from swarmwright.simulations.command.definition import Choices, Command, CommandOptions, Definition
from swarmwright.simulations.command.ros_sections import (
    GET_ENTITIES_STATES,
    SCOPES,
    STEP_SIMULATION,
    Actuator,
    Metric,
    Reset,
    Sensor,
    Spawn,
    Step,
)
from swarmwright.simulations.ros.names import namespace_of

_TRIGGERS = ("std_srvs/Trigger", "std_srvs/Empty")
"""Types of services by default: of a step, of a reset."""
ATTACHMENT = "attachment.json"
"""What the program reads, in the folder of an instance."""
OF_AN_INSTANCE = ("instance", "port", "domain", "folder", "here")
"""Placeholders that are set when the program starts."""
DOMAINS = 100
"""DDS domains that instances get; beyond about 100 their ports may be taken by other programs on Linux."""
MOST_ROBOTS = 1000
"""Robots of an experiment."""
PROGRAM = Path(__file__).parents[1] / "ros"
"""The folder of the program that drives the robots; a foreign Python can start it."""


def _number_of_robots(value: Any) -> Any:  # noqa: ANN401 - whatever the file says
    if isinstance(value, int) and not isinstance(value, bool):
        if not 1 <= value <= MOST_ROBOTS:
            raise ValueError(f"must be at least 1 and at most {MOST_ROBOTS:,}, not {value}")
        return [f"robot_{number}" for number in range(1, value + 1)]
    return [value] if isinstance(value, str) else value


def _seconds(value: Any) -> Any:  # noqa: ANN401 - whatever the file says
    if isinstance(value, str):
        raise ValueError(f"must be seconds, such as 0.1, or {{service: /step}}, not {shown(value)}")
    return {"duration": value} if isinstance(value, int | float) and not isinstance(value, bool) else value


class RosOptions(Definition):
    """Robots of a running ROS 1 or ROS 2 system: topics are their sensors and actuators.

    Swarmwright runs a program that drives them stepwise. It needs the Python that ROS is installed for, or,
    for ROS 2, no ROS at all: `middleware: dds` speaks to it directly.
    """

    prefix: ClassVar[str] = SimulationName.ROS

    ros: Literal[1, 2]
    """The version of ROS."""
    middleware: Literal["rospy", "rclpy", "dds"] | None = None
    """What connects to it: rospy (ROS 1); dds, Cyclone DDS (`pip install 'swarmwright[ros2]'`) or rclpy (ROS
    2). Default: rospy or dds."""
    python: str | None = Field(default=None, min_length=1)
    """The Python in which rospy or rclpy can be imported. Default: /usr/bin/python3."""
    title: str | None = Field(default=None, min_length=1, max_length=1000)
    """The name in discovery. Default: ros1 or ros2, and a digest of this definition and of the files that it
    names."""
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
    """The robots' namespaces, or how many there are: robot_1, robot_2, ..; 1 to 1,000. Default: one robot
    without a namespace."""
    sensors: list[Sensor] = Field(default=[])
    """What a robot's controller senses: a list of {sensor: NAME, topic: .., type: .., ..}, as in the mapping
    of exported packages."""
    actuators: list[Actuator] = Field(default=[])
    """What it commands: a list of {actuator: NAME, topic: .., type: .., ..}."""
    step: Annotated[
        Step,
        BeforeValidator(_seconds, json_schema_input_type=float | Step),
    ]
    """How a step is made: its duration in seconds, or {service: ..}; see below."""
    reset: Reset = Field(default_factory=Reset)
    """How an episode begins; see below."""
    spawn: Spawn | None = None
    """How robots come into the simulator; see below. Default: they are there."""
    steps: int = Field(default=100, ge=1, le=2**31)
    """Steps of an episode."""
    done: str | None = Field(default=None, min_length=1)
    """Condition that ends an episode early: an expression over the metrics as they are after a step, such as
    "collisions > 0"."""
    metrics: dict[str, Metric] = Field(default={})
    """Numbers of an episode, for `fitness`: name -> {topic: .., type: .., time: last, robots: mean}; see
    below."""
    fitness: str | None = Field(default=None, min_length=1)
    """The simulation's own fitness, an expression over its metrics. Default: the experiment's, or the metric
    `fitness`."""
    start: Command | None = None
    """A command that starts the simulator; each server has its own, on a ROS master (ROS 1) or in a domain
    (ROS 2) of its own, and it ends with the server. It runs in a work folder; {here} stands for the folder of
    the experiment file: world:={here}/world.yaml. Default: the system runs already."""
    patience: float = Field(default=5.0, gt=0, le=86_400)
    """Seconds to wait for a sensor's message or a service's answer; then the episode has failed."""
    startup: float = Field(default=30.0, gt=0, le=86_400)
    """Seconds to wait at first for topics and services to appear."""
    timeout: float = Field(default=600.0, gt=0, le=31 * 86_400)
    """Seconds that an episode may take."""
    recycle: int = Field(default=0, ge=0)
    """Episodes after which the program, and what `start` has started, is started again; 0 for never."""
    choices: Choices = Field(default={})
    """All values that a parameter may have, as for commands; needed for text in `reset.command`."""
    environment: dict[str, str] = Field(default={})
    """Environment variables in addition to the inherited ones: ROS_MASTER_URI, ROS_DOMAIN_ID, .. Values
    may hold {instance}, {port}, {domain}, {folder} and {here}."""
    dimensions: int = Field(default=2, ge=0, le=1000)
    """Spatial dimensions, which experiments may require."""
    output: float = Field(default=10.0, gt=0)
    """Megabytes that may be printed between two starts of the program."""
    disk: float = Field(default=1000.0, gt=0)
    """Megabytes that may be written into the work folder."""
    work: str | None = Field(default=None, min_length=1)
    """The folder that work folders are made in. Default: one of the user's in the system's folder for
    temporary files."""
    sources: list[str] = Field(default=[])
    """Files and folders that the simulation consists of, beside those that `start` and `reset` name: they are
    part of its digest, and copied into run folders."""
    determinism: Literal["bitwise", "statistical", "none"] | None = None
    """How far two evaluations of one episode agree on any server; needed for audits (`faults: {audit}`).
    Default: none where steps have a duration, else not known."""
    folder: str = Field(default=".", min_length=1)
    """The folder that paths here are relative to. Default: that of the experiment file."""

    @field_validator("robots")
    @classmethod
    def _robots(cls, value: Any) -> list[str]:  # noqa: ANN401 - whatever the file says
        if not isinstance(value, list) or not value:
            raise ValueError(f"must be a number of robots, or a list of namespaces, not {shown(value)}")
        if len(value) > MOST_ROBOTS:
            raise ValueError(f"there may be at most {MOST_ROBOTS:,} robots, not {len(value):,}")
        names: set[str] = set()
        for one in value:
            if not isinstance(one, str) or not one:
                raise ValueError(f"{shown(one)} is not a namespace; expected such as robot_1")
            try:
                namespace_of(one)
            except ValueError as error:
                raise ValueError(
                    f"{shown(one)} is not a namespace: {error}; expected such as robot_1"
                ) from None
            if one in names:
                raise ValueError(f"{one} is there twice")
            names.add(one)
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
            raise ValueError(f"middleware: {self.middleware} is not for ROS {self.ros}; {names} is")
        if self.python is not None and self.connection == "dds":
            raise ValueError("python: dds runs in Swarmwright's own Python; leave it out, or take rclpy")
        return self

    @property
    def connection(self) -> str:
        """The middleware."""
        return self.middleware or ("rospy" if self.ros == 1 else "dds")

    @property
    def is_shared(self) -> bool:
        """Whether all servers would drive the same robots: none has a system of its own."""
        own = ("{instance}", "{port}", "{domain}")
        texts = [text for name, text in self.environment.items() if name.startswith("ROS_")]
        return self.start is None and not any(place in text for text in texts for place in own)

    @property
    def interpreter(self) -> str:
        """The Python that runs the program."""
        return sys.executable if self.connection == "dds" else self.python or "/usr/bin/python3"

    @property
    def topics(self) -> dict[str, Any]:
        """Sensors and actuators as in the mapping of an exported package."""
        return {
            "sensors": [one.model_dump(exclude_defaults=True) for one in self.sensors],
            "actuators": [one.model_dump(exclude_defaults=True) for one in self.actuators],
        }

    def named_files(self) -> Iterator[tuple[str, Sequence[str]]]:
        """See `Definition`."""
        yield "command", [*(self.start or ()), *(self.reset.command or ())]
        if self.spawn is not None and self.spawn.file is not None:
            yield "spawn", [self.spawn.file]
        yield "sources", self.sources

    def as_command(self) -> CommandOptions:
        """See `Definition`."""
        environment = dict(self.environment)
        if self.start is not None:
            own = {
                1: {
                    "ROS_MASTER_URI": "http://127.0.0.1:{port}",
                    "ROS_IP": "127.0.0.1",
                    "ROS_HOME": "{folder}/ros",
                    "ROS_LOG_DIR": "{folder}/ros/log",
                },
                2: {"ROS_DOMAIN_ID": "{domain}", "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"},
            }
            environment = own[self.ros] | environment
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
        """Return what the program reads."""
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
            "spawn": None if self.spawn is None else self._spawned(self.spawn),
            "metrics": {name: self._measured(one) for name, one in self.metrics.items()},
        }

    @property
    def _settle(self) -> int:
        if self.reset.settle is not None:
            return self.reset.settle
        return 1 if self.step.type == STEP_SIMULATION else 0

    @staticmethod
    def _service(of: Step | Reset, kind: str, name: str) -> dict[str, Any]:
        """Return name and type of a service, as far as there is one."""
        if of.type is None and of.service is None:
            return {"service": None, "type": None}
        of_type = of.type or kind
        return {"service": of.service or name, "type": of_type}

    def _spawned(self, spawn: Spawn) -> dict[str, Any]:
        text = "" if spawn.file is None else (Path(self.folder) / spawn.file).read_text("utf-8")
        return {**spawn.model_dump(exclude={"file"}), "uri": spawn.uri or "", "text": text}

    @staticmethod
    def _measured(metric: Metric) -> dict[str, Any]:
        values: dict[str, Any] = {
            "time": metric.time,
            "robots": metric.robots,
            "otherwise": metric.otherwise,
        }
        if metric.type == GET_ENTITIES_STATES:
            service = metric.service or "/get_entities_states"
            values |= {"service": service, "entity": metric.entity or "{robot}"}
        return {**values, "place": metric.place}

    def problems(self) -> list[tuple[Path_, str]]:
        """See `Definition`."""
        return ros_checks.problems(self)


def _bits(scope: Sequence[str]) -> int:
    bits = 0
    for one in scope:
        bits |= SCOPES[one]
    return bits
