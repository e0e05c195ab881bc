"""FMUs as simulations, stepped by a program in a process of its own."""

import json
from typing import ClassVar

from swarmwright.common.ranges import Range
from swarmwright.common.simulation_names import SimulationName
from swarmwright.simulations.command._fmu_parameters import announced
from swarmwright.simulations.command.definition import CommandOptions
from swarmwright.simulations.command.fmu_definition import ATTACHMENT, FmuOptions
from swarmwright.simulations.command.simulation import CommandSimulation
from swarmwright.simulations.command.stepwise import Start
from swarmwright.simulations.fmu.layout import AGENT


class FmuSimulation(CommandSimulation):
    """A Functional Mock-up Unit: its inputs are actuators, its outputs sensors, its parameters parameters."""

    _is_own_program: ClassVar[bool] = True

    def __init__(self) -> None:
        self._definition = FmuOptions.of(self.adapted)
        known = self._definition.description.variables
        self.metrics = list(self._definition.columns)
        self.parameters = dict(announced(self._definition))
        self.max_agents = self._definition.count
        super().__init__()
        for which in ("sensors", "actuators"):
            names, units, ranges = [], [], []
            for one in self._definition.channels(which):
                unit = one.unit or known[one.variable.replace(AGENT, "1")].unit
                names.append(one.variable)
                # A scaled number has no unit itself, only what it stands for has.
                units.append("" if one.range is not None else unit)
                ranges.append(None if one.range is None else Range(*one.range, unit))
            if which == "sensors":
                self.sensor_names, self.sensor_units, self.sensor_ranges = names, units, ranges
            else:
                self.actuator_names, self.actuator_units, self.actuator_ranges = names, units, ranges
        self.frame_seconds = self._definition.size

    @classmethod
    def _options(cls) -> CommandOptions:
        return FmuOptions.of(cls.adapted).as_command()

    @property
    def _label(self) -> str:
        return SimulationName.parse(self.adapted).label

    def _start(self) -> Start:
        start = super()._start()
        (self.folder / ATTACHMENT).write_text(json.dumps(self._definition.attachment()), "utf-8")
        return start
