"""Robots of a ROS system, driven by a program that connects to it."""

import contextlib
import fcntl
import hashlib
import json
import os
import weakref
from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar

from numpy.typing import ArrayLike

from swarmwright.common.errors import InputError
from swarmwright.common.ranges import Range
from swarmwright.common.simulation_names import SimulationName
from swarmwright.common.temporary import private_folder
from swarmwright.simulations.command.definition import CommandOptions
from swarmwright.simulations.command.placeholders import Placeholder, Template, Values, command
from swarmwright.simulations.command.process import resolve_word
from swarmwright.simulations.command.ros_definition import (
    ATTACHMENT,
    DOMAINS,
    INSTANCE_PLACEHOLDERS,
    RosOptions,
)
from swarmwright.simulations.command.simulation import CommandSimulation
from swarmwright.simulations.command.stepwise import Start
from swarmwright.simulations.command.work_files import Instance


class RosSimulation(CommandSimulation):
    """Robots of a ROS system.

    A program with the definition runs in the Python of the middleware, and is stepped over its standard input
    and output like any stepwise command.
    """

    _is_own_program: ClassVar[bool] = True

    def __init__(self) -> None:
        self._definition = RosOptions.parse(self.adapted)
        self._has_robots = False
        self.metrics = list(self._definition.metrics)
        super().__init__()
        self.sensor_names = [sensor.sensor for sensor in self._definition.sensors]
        self.actuator_names = [actuator.actuator for actuator in self._definition.actuators]
        self.sensor_ranges = [
            Range.from_scale(1 / sensor.scale, -sensor.offset / sensor.scale) if sensor.scale else None
            for sensor in self._definition.sensors
        ]
        self.actuator_ranges = [
            Range.from_scale(actuator.scale, actuator.offset) for actuator in self._definition.actuators
        ]
        self.step_seconds = self._definition.step.duration  # None if a service makes a step

    @classmethod
    def _options(cls) -> CommandOptions:
        return RosOptions.parse(cls.adapted).as_command()

    @property
    def _label(self) -> str:
        return SimulationName.parse(self.adapted).label

    def _placeholders(self, instance: Instance, episode: int) -> dict[str, Any]:
        values = super()._placeholders(instance, episode)
        return {**values, "domain": 1 + instance.number % DOMAINS}

    def _start(self) -> Start:
        start = super()._start()
        if self._definition.is_shared and not self._has_robots:
            self._lock(start.environment)
        text = json.dumps(self._attachment())
        (self.folder / ATTACHMENT).write_text(text, "utf-8")
        return start

    def _lock(self, environment: Mapping[str, str]) -> None:
        """Lock the robots for this object. Raises InputError if another process on this machine has them."""
        variables = {**os.environ, **environment}
        where = [variables.get(name, "") for name in ("ROS_MASTER_URI", "ROS_DOMAIN_ID")]
        names = list(self._definition.robots)
        if self._definition.step.is_called:
            names.append("the simulation")  # a step moves all robots
        with contextlib.ExitStack() as locks:
            for name in names:
                text = "\n".join([str(self._definition.ros), *where, name])
                path = private_folder() / f"ros-{hashlib.sha256(text.encode()).hexdigest()[:16]}.lock"
                lock = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
                locks.callback(os.close, lock)
                try:
                    fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                except OSError:
                    raise InputError(
                        f"simulation: another server on this machine controls {name}; use a single server "
                        "(servers: 1), or let each server start its own simulator (simulation.start)"
                    ) from None
            weakref.finalize(self, locks.pop_all().close)
        self._has_robots = True

    def _attachment(self) -> dict[str, Any]:
        """Return the program's input: the definition, with the values of this instance."""
        attachment = self._definition.attachment()
        if self._definition.start is not None:
            attachment["start"] = self._command(self._definition.start)
        attachment["reset"]["command"] = [self._reset_parts(word) for word in self._reset_command] or None
        values = {name: str(value) for name, value in self._values.built_in.items() if name != "episode"}
        return {**attachment, "values": values}

    @property
    def _reset_command(self) -> tuple[Template, ...]:
        return command(tuple(self._definition.reset.command or ()), "reset.command")

    def _reset_parts(self, word: Template) -> list[str | dict[str, str]]:
        """Return a word in JSON, parsed into text and names of placeholders.

        A word without placeholders may name a file.
        """
        folder = Path(self._definition.folder)
        if len(word.parts) == 1 and isinstance(word.parts[0], str):
            return [resolve_word(word.parts[0], folder)]
        return [{"name": part.name} if isinstance(part, Placeholder) else part for part in word.parts]

    def reset(self, parameters: dict[str, Any], seed: int, controller: str | None = None) -> ArrayLike:
        """Start an episode. Raises InputError for text that would decide what `reset.command` runs."""
        values = Values(dict.fromkeys(INSTANCE_PLACEHOLDERS), parameters, self._choices)
        for word in self._reset_command:
            word.check(values)
        return super().reset(parameters, seed, controller)
