"""Parameters of a user-defined simulation: declared, checked, filled in."""

import copy
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from swarmwright.common.errors import InputError

_KINDS = {bool: "boolean", int: "integer", float: "number", str: "string", list: "list", dict: "object"}


@dataclass(frozen=True)
class Parameter:
    """A parameter of a simulation.

    Its type is that of its default: integer, number, boolean, string, list or object. A default of None
    permits any type.

        parameters = {"gravity": Parameter(9.81, "Metres per second squared.", minimum=0.0)}
    """

    default: Any
    """The value if the experiment does not set it; a JSON value."""
    description: str = ""
    """Meaning and unit, in a sentence."""
    minimum: float | None = None
    """The smallest permitted value."""
    maximum: float | None = None
    """The largest permitted value."""
    choices: Sequence[Any] | None = None
    """All permitted values."""

    @property
    def kind(self) -> str:
        """Its type in words: boolean, integer, number, string, list, object, or any."""
        plain = list if isinstance(self.default, tuple) else type(self.default)
        return _KINDS.get(plain, "any")

    def problem(self, value: Any) -> str | None:  # noqa: ANN401 - any JSON value
        """Return the problem with a value; None if it is valid."""
        kind = self.kind
        fits = {
            "any": True,
            "boolean": isinstance(value, bool),
            "integer": _is_number(value) and float(value).is_integer(),
            "number": _is_number(value),
            "string": isinstance(value, str),
            "list": isinstance(value, list | tuple),
            "object": isinstance(value, Mapping),
        }[kind]
        if not fits:
            return f"{value!r} found, expected {'an' if kind[0] in 'aio' else 'a'} {kind}"
        if self.choices is not None and value not in self.choices:
            return f"{value!r} found, expected one of {', '.join(map(repr, self.choices))}"
        if self.minimum is not None and value < self.minimum:
            return f"{value!r} found, expected at least {self.minimum}"
        if self.maximum is not None and value > self.maximum:
            return f"{value!r} found, expected at most {self.maximum}"
        return None

    def convert(self, value: Any) -> Any:  # noqa: ANN401 - any JSON value
        """Convert a checked value for `reset`: 3.0 to 3 for an integer, 3 to 3.0 for a number."""
        if self.kind == "integer":
            return int(value)
        return float(value) if self.kind == "number" else value


def _is_number(value: Any) -> bool:  # noqa: ANN401 - any JSON value
    if not isinstance(value, int | float) or isinstance(value, bool):
        return False
    try:
        return math.isfinite(value)
    except OverflowError:  # an integer beyond binary64
        return False


def parse_parameters(parameters: Mapping[str, Any], where: str) -> dict[str, Parameter]:
    """Return a class's `parameters` as Parameter objects.

    Raises InputError, beginning with `where`, for a default that does not fit its declaration.
    """
    if not isinstance(parameters, Mapping):
        raise InputError(
            f"{where}.parameters: {parameters!r} found, expected a mapping from names to defaults or "
            "Parameter(..)"
        )
    declarations = {}
    for name, value in parameters.items():
        if not isinstance(name, str):
            raise InputError(f"{where}.parameters: the name {name!r} found, expected text")
        if name == "seed":
            raise InputError(f"{where}.parameters: leave out 'seed', which reset receives as an argument")
        declaration = value if isinstance(value, Parameter) else Parameter(value)
        problem = declaration.problem(declaration.default)
        if problem is not None:
            raise InputError(f"{where}.parameters[{name!r}]: default: {problem}")
        declarations[name] = declaration
    return declarations


def fill_parameters(
    declarations: Mapping[str, Parameter], values: Mapping[str, Any], *, sent: bool = False
) -> dict[str, Any]:
    """Check values and add defaults for missing parameters; return the parameters for `reset`.

    sent: whether a tool has sent the values; evolved booleans are then 0 and 1.

    Raises InputError, "name: reason".
    """
    if sent:
        values = {
            name: bool(value)
            if name in declarations
            and declarations[name].kind == "boolean"
            and type(value) is int
            and value in (0, 1)
            else value
            for name, value in values.items()
        }
    for mistake in find_mistakes(declarations, values):
        raise InputError(str(mistake))
    defaults = {name: copy.deepcopy(parameter.default) for name, parameter in declarations.items()}
    converted = {
        name: declarations[name].convert(value) if name in declarations else value
        for name, value in values.items()
    }
    return defaults | converted


class ParameterMistake(NamedTuple):
    """An invalid parameter of a simulation."""

    field: str
    """The parameter, or a field in it: `mission.robots`, `robots[0].count`."""
    reason: str

    @property
    def parameter(self) -> str:
        """The parameter's name."""
        return re.split(r"[.[]", self.field, maxsplit=1)[0]

    def __str__(self) -> str:
        return f"{self.field}: {self.reason}"


def find_mistakes(
    declarations: Mapping[str, Parameter], values: Mapping[str, Any]
) -> Iterator[ParameterMistake]:
    """Yield mistakes in values of the parameters that a class declares."""
    for name, value in values.items():
        problem = declarations[name].problem(value) if name in declarations else None
        if problem is not None:
            yield ParameterMistake(name, problem)
