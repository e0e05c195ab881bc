"""Sensors and actuators of an FMU, as an experiment names them."""

from typing import Annotated, Any

from pydantic import BeforeValidator, WithJsonSchema, field_validator, model_validator

from swarmwright.common.options import Options
from swarmwright.common.problems import shown
from swarmwright.simulations.fmu.layout import AGENT


class Channel(Options):
    """A variable of an FMU, or all those of a terminal, as sensors or actuators.

    With a range, their lowest and highest values are -1 and 1 for the controller.
    """

    variable: str = ""
    """The name of the variable; {agent} stands for the number of the agent, from 1. An array of FMI 3.0 gives
    as many sensors or actuators as it has elements, `x[{agent}]` the elements of a row for each agent."""
    terminal: str = ""
    """In the place of a variable: a terminal of FMI 3.0, all outputs of which are sensors, or all inputs
    actuators."""
    unit: str = ""
    """The unit of the values and of the range, which the FMU's unit definitions convert. Default: the
    variable's."""
    range: tuple[float, float] | None = None
    """Lowest and highest value. Default for actuators: the variable's own min and max where it has both;
    otherwise values are what they are."""

    @model_validator(mode="after")
    def _is_one(self) -> "Channel":
        if bool(self.variable) == bool(self.terminal):
            raise ValueError("write a variable or a terminal, one of them")
        if AGENT in self.terminal:
            raise ValueError(f"terminal: cannot hold {AGENT}; name its variables")
        return self

    @field_validator("range")
    @classmethod
    def _ordered(cls, value: tuple[float, float] | None) -> tuple[float, float] | None:
        if value is not None and not value[0] < value[1]:
            raise ValueError(f"the lowest value must be below the highest, not {value[0]:g} and {value[1]:g}")
        return value


def _channels(value: Any) -> Any:  # noqa: ANN401 - whatever the file says
    if value is None:
        return value
    if not isinstance(value, list):
        raise ValueError(f"must be a list of variables, not {shown(value)}")
    return [{"variable": one} if isinstance(one, str) else one for one in value]


def _pairs(value: Any) -> Any:  # noqa: ANN401 - whatever the file says
    """Take lists of two numbers, as YAML has them, for tuples."""
    for one in value if isinstance(value, list) else []:
        if isinstance(one, dict) and isinstance(one.get("range"), list) and len(one["range"]) == 2:
            one["range"] = tuple(float(part) if isinstance(part, int) else part for part in one["range"])
    return value


Channels = Annotated[
    list[Channel] | None,
    BeforeValidator(lambda value: _pairs(_channels(value))),
    WithJsonSchema(
        {
            "type": "array",
            "items": {
                "anyOf": [
                    {"type": "string"},
                    {
                        "type": "object",
                        "properties": {
                            "variable": {"type": "string"},
                            "terminal": {"type": "string"},
                            "unit": {"type": "string"},
                            "range": {"type": "array", "items": {"type": "number"}},
                        },
                        "oneOf": [{"required": ["variable"]}, {"required": ["terminal"]}],
                        "additionalProperties": False,
                    },
                ]
            },
        }
    ),
]
