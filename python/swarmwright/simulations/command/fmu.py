"""FMUs as simulations, stepped by a program in a separate process, and their parameters."""

import json
from dataclasses import dataclass
from typing import Any, ClassVar

from swarmwright.common.ranges import Range
from swarmwright.common.simulation_names import SimulationName
from swarmwright.simulations.command.definition import CommandOptions
from swarmwright.simulations.command.fmu_definition import ATTACHMENT, FmuOptions
from swarmwright.simulations.command.simulation import CommandSimulation
from swarmwright.simulations.command.stepwise import Start
from swarmwright.simulations.fmu.description import AGENT, Variable, convert_native, describe_expected, fits
from swarmwright.simulations.parameters import Parameter

_KINDS = {"Boolean": "boolean", "String": "string"}


@dataclass(frozen=True)
class FmuParameter(Parameter):
    """A parameter within the limits of its variable's type.

    0 and 1 are accepted as booleans, because parameter sets evolve numbers and texts.
    """

    variable: Variable | None = None
    """The variable."""

    @classmethod
    def from_variable(cls, variable: Variable) -> "FmuParameter":
        """Return the parameter for a variable."""
        return cls(variable.start, variable.unit, variable=variable)

    @property
    def kind(self) -> str:
        """See `Parameter`."""
        assert self.variable is not None
        return _KINDS.get(self.variable.type, "number" if self.variable.is_real else "integer")

    def problem(self, value: Any) -> str | None:  # noqa: ANN401 - any JSON value
        """See `Parameter`; the FMU's own start value is always valid."""
        assert self.variable is not None
        same = type(value) is type(self.default) and value == self.default
        if same or fits(self.variable, value):
            return None
        return f"{value!r} found, expected {describe_expected(self.variable) or 'nothing, it cannot be set'}"

    def convert(self, value: Any) -> Any:  # noqa: ANN401 - any JSON value
        """See `Parameter`."""
        assert self.variable is not None
        if value is None or isinstance(value, str):
            return value
        return float(value) if self.variable.is_real else convert_native(self.variable, value)


def make_parameters(definition: FmuOptions) -> dict[str, FmuParameter]:
    """Return the parameters that the simulation of an FMU declares."""
    return {name: FmuParameter.from_variable(parameter) for name, parameter in definition.parameters.items()}


class FmuSimulation(CommandSimulation):
    """A Functional Mock-up Unit: inputs are actuators, outputs are sensors, parameters are parameters."""

    _is_own_program: ClassVar[bool] = True

    def __init__(self) -> None:
        self._definition = FmuOptions.parse(self.adapted)
        variables = self._definition.description.variables
        self.metrics = list(self._definition.columns)
        self.parameters = dict(make_parameters(self._definition))
        self.max_agents = self._definition.count
        super().__init__()
        for kind in ("sensors", "actuators"):
            names, units, ranges = [], [], []
            for channel in self._definition.channels(kind):
                unit = channel.unit or variables[channel.variable.replace(AGENT, "1")].unit
                names.append(channel.variable)
                # A scaled number has no unit; its unscaled value has.
                units.append("" if channel.range is not None else unit)
                ranges.append(None if channel.range is None else Range(*channel.range, unit))
            if kind == "sensors":
                self.sensor_names, self.sensor_units, self.sensor_ranges = names, units, ranges
            else:
                self.actuator_names, self.actuator_units, self.actuator_ranges = names, units, ranges
        self.frame_seconds = self._definition.size

    @classmethod
    def _options(cls) -> CommandOptions:
        return FmuOptions.parse(cls.adapted).as_command()

    @property
    def _label(self) -> str:
        return SimulationName.parse(self.adapted).label

    def _start(self) -> Start:
        start = super()._start()
        (self.folder / ATTACHMENT).write_text(json.dumps(self._definition.attachment()), "utf-8")
        return start
