"""What a file says of robots in a simulator that is attached: robots, sensors, actuators, steps, metrics.

The words are those of `simulation: {ros: ..}`; a sensor or an actuator is a device of the robot's instead of
a topic.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Self

from pydantic import Field, PrivateAttr, ValidationError, field_validator, model_validator

from swarmwright.common import metric_names, yaml
from swarmwright.common.errors import InputError
from swarmwright.common.options import Options
from swarmwright.common.problems import problems_of
from swarmwright.simulations.command.definition import Command
from swarmwright.simulations.command.ros_sections import Area, Interval, Pose, Reduce


class Device(Options):
    """A device of a robot, and how its numbers are converted."""

    device: str = Field(min_length=1)
    """Its name, as the simulator has it."""
    kind: str = ""
    """What is read or set; the simulator's page lists them. Default: the first one there."""
    scale: float = 1.0
    """Factor."""
    offset: float = 0.0
    """Added after the scale."""


class Sensor(Device):
    """A number that controllers sense."""

    sensor: str = Field(min_length=1)
    """Its name."""
    index: int = Field(default=0, ge=0)
    """Which number, of a device that measures several."""
    clip: Interval | None = None
    """[low, high]: where values end, after the scale."""
    infinite: float | None = None
    """What is read, before the scale, where a sensor detects nothing."""


class Actuator(Device):
    """A number that controllers command, -1 to 1 before the scale."""

    actuator: str = Field(min_length=1)
    """Its name."""
    limits: Interval | None = None
    """[low, high] of what is set."""


class Metric(Options):
    """A number of an episode: sampled before the first step and after each one, and reduced."""

    sensor: str | None = Field(default=None, min_length=1)
    """The name of a sensor, whose values are those that controllers get."""
    pose: str | None = Field(default=None, pattern="^(x|y|z|yaw)$")
    """Or where the robot is: x, y or z in metres, yaw in radians."""
    scale: float = 1.0
    """Factor."""
    offset: float = 0.0
    """Added after the scale."""
    time: Reduce = "last"
    """What is made of the values of an episode."""
    robots: Reduce = "mean"
    """What is made of the values of all robots."""

    @model_validator(mode="after")
    def _fits(self) -> Self:
        if (self.sensor is None) == (self.pose is None):
            raise ValueError("sensor: give either a sensor, or pose: x, y, z or yaw")
        return self


class Attachment(Options):
    """Robots of a simulator."""

    robots: list[str] = Field(min_length=1)
    """Their names, as the simulator has them."""
    sensors: list[Sensor] = Field(min_length=1)
    """What a robot's controller senses."""
    actuators: list[Actuator] = Field(min_length=1)
    """What it commands."""
    ticks: int = Field(default=1, ge=1, le=100_000)
    """Steps of the simulator's from one action to the next."""
    steps: int = Field(default=100, ge=1, le=2**31)
    """Actions in an episode."""
    poses: list[Pose] = Field(default=[])
    """Where robots start, one of each. Default: where the simulator's file has them."""
    area: Area | None = None
    """Or where they are put at random, by the episode's seed."""
    apart: float = Field(default=0.0, ge=0)
    """Metres between two robots in the area, at least."""
    metrics: dict[str, Metric] = Field(default={})
    """Name -> {sensor or pose, time, robots}."""
    start: Command | None = None
    """A command that starts the simulator, which ends with the server. {port} in it is a free port. Default:
    the simulator runs already."""
    startup: float = Field(default=60.0, gt=0, le=86_400)
    """Seconds that the simulator has to start."""
    patience: float = Field(default=30.0, gt=0, le=86_400)
    """Seconds to wait for an answer."""
    host: str = Field(default="localhost", min_length=1)
    """Where a simulator that runs already is."""
    _folder: Path = PrivateAttr(default=Path())

    @field_validator("metrics")
    @classmethod
    def _names(cls, value: dict[str, Metric]) -> dict[str, Metric]:
        metric_names.check(value)
        return value

    @model_validator(mode="after")
    def _fits(self) -> Self:
        twice = next((one for index, one in enumerate(self.robots) if one in self.robots[:index]), None)
        if twice is not None:
            raise ValueError(f"robots: {twice} is there twice")
        if self.poses and self.area is not None:
            raise ValueError("poses: give either poses or area")
        if self.poses and len(self.poses) != len(self.robots):
            raise ValueError(
                f"poses: {len(self.poses)} found, expected one of each of {len(self.robots)} robots"
            )
        names = [one.sensor for one in self.sensors]
        for name, metric in self.metrics.items():
            if metric.sensor is not None and metric.sensor not in names:
                raise ValueError(
                    f"metrics: {name}: there is no sensor {metric.sensor!r}; {', '.join(names)} are"
                )
        return self

    @property
    def folder(self) -> Path:
        """Where the file lies; files that `start` names are relative to it."""
        return self._folder

    def check_kinds(self, sensors: Mapping[str, object], actuators: Mapping[str, object]) -> None:
        """Raise InputError for kinds of devices that the simulator does not have."""
        groups: tuple[tuple[str, Sequence[Device], Mapping[str, object]], ...] = (
            ("sensors", self.sensors, sensors),
            ("actuators", self.actuators, actuators),
        )
        for section, devices, known in groups:
            for number, one in enumerate(devices):
                if one.kind and one.kind not in known:
                    raise InputError(
                        f"{section}[{number}].kind: {one.kind!r} found, expected {', '.join(known)}"
                    )

    @classmethod
    def read(cls, path: Path) -> Self:
        """Read a file. Raises InputError with file, line and field."""
        source = yaml.read(path)
        if source.problems:
            raise InputError("; ".join(f"{source.place(at)}{text}" for at, _, text in source.problems))
        try:
            attachment = cls.model_validate(source.values)
        except ValidationError as error:
            found = [f"{source.place(at)}{text}" for at, text in problems_of(error, cls)]
            raise InputError("; ".join(found)) from None
        attachment._folder = path.absolute().parent  # type: ignore[misc] # a private attribute
        return attachment
