"""FMUs as simulations, stepped by a program in a process of its own.

Parameters of FMUs, of which more is known than their defaults say.
"""

import json
from dataclasses import dataclass
from typing import Any, ClassVar

from swarmwright.common.ranges import Range
from swarmwright.common.simulation_names import SimulationName
from swarmwright.simulations.command.definition import CommandOptions
from swarmwright.simulations.command.fmu_definition import ATTACHMENT, FmuOptions
from swarmwright.simulations.command.simulation import CommandSimulation
from swarmwright.simulations.command.stepwise import Start
from swarmwright.simulations.fmu.description import AGENT, Variable, expected, fits, native
from swarmwright.simulations.parameters import Parameter

_KINDS = {"Boolean": "boolean", "String": "string"}


@dataclass(frozen=True)
class FmuParameter(Parameter):
    """A parameter within the limits of its variable's type; 0 and 1 are booleans, too.

    With 0 and 1 a parameter set evolves a boolean, since it has numbers and texts.
    """

    variable: Variable | None = None
    """The variable."""

    @classmethod
    def of(cls, variable: Variable) -> "FmuParameter":
        """Return what a variable is as a parameter of a simulation."""
        return cls(variable.start, variable.unit, variable=variable)

    @property
    def kind(self) -> str:
        """See `Parameter`."""
        assert self.variable is not None
        return _KINDS.get(self.variable.type, "number" if self.variable.is_real else "integer")

    def problem(self, value: Any) -> str | None:  # noqa: ANN401 - any JSON value
        """See `Parameter`; the FMU's own start value fits whatever it is."""
        assert self.variable is not None
        same = type(value) is type(self.default) and value == self.default
        if same or fits(self.variable, value):
            return None
        return f"{value!r} found, expected {expected(self.variable) or 'nothing, it cannot be set'}"

    def taken(self, value: Any) -> Any:  # noqa: ANN401 - any JSON value
        """See `Parameter`."""
        assert self.variable is not None
        if value is None or isinstance(value, str):
            return value
        return float(value) if self.variable.is_real else native(self.variable, value)


def announced(definition: FmuOptions) -> dict[str, FmuParameter]:
    """Return the parameters of an FMU, as its simulation declares them."""
    return {name: FmuParameter.of(parameter) for name, parameter in definition.parameters.items()}


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
            for channel in self._definition.channels(which):
                unit = channel.unit or known[channel.variable.replace(AGENT, "1")].unit
                names.append(channel.variable)
                # A scaled number has no unit itself, only what it stands for has.
                units.append("" if channel.range is not None else unit)
                ranges.append(None if channel.range is None else Range(*channel.range, unit))
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
