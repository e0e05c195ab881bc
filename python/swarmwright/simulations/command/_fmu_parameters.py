"""Parameters of FMUs, of which more is known than their defaults say."""

from dataclasses import dataclass
from typing import Any

from swarmwright.simulations.command.fmu_definition import FmuOptions
from swarmwright.simulations.fmu.description import Variable
from swarmwright.simulations.fmu.values import expected, fits, native
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
    return {name: FmuParameter.of(one) for name, one in definition.parameters.items()}
