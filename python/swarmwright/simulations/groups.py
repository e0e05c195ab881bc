"""Kinds of agents in one simulation, as its class declares them."""

import operator
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from swarmwright.common.errors import InputError
from swarmwright.common.groups import DeclaredGroup
from swarmwright.common.ranges import ranges_of
from swarmwright.simulations.parameters import Parameter

_LARGEST_COUNT = 1_000_000
"""Agents, sensors or actuators of a group, at most."""


@dataclass(frozen=True)
class Group:
    """Agents of one kind, of a simulation with several: a value of its `groups`.

    groups = {"predators": Group(agents="numPredators", sensors=4, actuators=2),
              "prey": Group(agents=1, sensors=6, actuators=1)}
    """

    agents: int | str
    """How many there are, or the parameter that says it."""
    sensors: int
    """Sensor values of an agent, at least 1."""
    actuators: int
    """Actuator values of an agent, at least 1."""
    sensor_names: Sequence[str] = ()
    """Names of an agent's sensors, one for each, or none at all."""
    actuator_names: Sequence[str] = ()
    """Names of an agent's actuators, in the same way."""
    sensor_ranges: Sequence[tuple[float, float] | tuple[float, float, str] | None] = field(
        default=(), compare=False
    )
    """What -1 and 1 of an agent's sensors stand for, see `Simulation`."""
    actuator_ranges: Sequence[tuple[float, float] | tuple[float, float, str] | None] = field(
        default=(), compare=False
    )
    """What -1 and 1 of an agent's actuators stand for, in the same way."""

    def __post_init__(self) -> None:
        """Take NumPy's integers for Python's."""
        for name in ("agents", "sensors", "actuators"):
            given = getattr(self, name)
            if not isinstance(given, bool | str) and hasattr(given, "__index__"):
                object.__setattr__(self, name, operator.index(given))

    def count(self, parameters: Mapping[str, Any]) -> int:
        """Return how many there are with these parameters, in which none is missing.

        Raises InputError, `name: why`, for a parameter that is no number of agents.
        """
        if isinstance(self.agents, int):
            return self.agents
        value = parameters.get(self.agents)
        if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value <= _LARGEST_COUNT:
            raise InputError(
                f"{self.agents}: {value!r} found, expected a number of agents, 0 to {_LARGEST_COUNT}"
            )
        return value


def declared(groups: Any, parameters: Mapping[str, Parameter], where: str) -> dict[str, Group]:  # noqa: ANN401 - whatever the class says
    """Return the groups of a class, checked.

    Args:
        groups: name -> Group, in the order of the agents.
        parameters: those of the class.
        where: its name, for messages.

    Raises InputError, naming class and attribute.
    """
    if not isinstance(groups, Mapping):
        raise InputError(f"{where}.groups: {groups!r} found, expected names with Group(..) for each")
    for name, one in groups.items():
        if not isinstance(name, str) or not name:
            raise InputError(f"{where}.groups: the name {name!r} found, expected text")
        at = f"{where}.groups[{name!r}]"
        if not isinstance(one, Group):
            raise InputError(f"{at}: {one!r} found, expected Group(agents=.., sensors=.., actuators=..)")
        _check(one, parameters, at)
    return dict(groups)


def _check(one: Any, parameters: Mapping[str, Parameter], at: str) -> None:  # noqa: ANN401 - fields may be anything
    for key in ("sensors", "actuators"):
        number, names = getattr(one, key), getattr(one, f"{key[:-1]}_names")
        if isinstance(number, bool) or not isinstance(number, int) or not 1 <= number <= _LARGEST_COUNT:
            raise InputError(f"{at}.{key}: {number!r} found, expected an integer from 1 to {_LARGEST_COUNT}")
        if names and len(names) != number:
            raise InputError(f"{at}.{key[:-1]}_names: {len(names)} found, expected {number}")
        try:
            ranges_of(getattr(one, f"{key[:-1]}_ranges"), number)
        except ValueError as error:
            raise InputError(f"{at}.{key[:-1]}_ranges: {error}") from None
    if isinstance(one.agents, str):
        if one.agents not in parameters:
            known = ", ".join(parameters) or "none"
            raise InputError(f"{at}.agents: there is no parameter {one.agents!r}; there are: {known}")
        if parameters[one.agents].kind != "integer":
            raise InputError(f"{at}.agents: the parameter {one.agents!r} is not an integer")
    elif (
        isinstance(one.agents, bool)
        or not isinstance(one.agents, int)
        or not 0 <= one.agents <= _LARGEST_COUNT
    ):
        raise InputError(
            f"{at}.agents: {one.agents!r} found, expected a number from 0 to {_LARGEST_COUNT}, or the name "
            "of a parameter"
        )


def counted(groups: Mapping[str, Group], parameters: Mapping[str, Any]) -> list[DeclaredGroup]:
    """Return the groups with numbers of agents. Raises InputError as `Group.count`."""
    return [
        DeclaredGroup(
            name,
            one.count(parameters),
            one.sensors,
            one.actuators,
            tuple(one.sensor_names),
            tuple(one.actuator_names),
        )
        for name, one in groups.items()
    ]
