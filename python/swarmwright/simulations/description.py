"""The description of a user-defined simulation, checked."""

import json
import math
import operator
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from swarmwright.common import metric_names
from swarmwright.common.errors import InputError
from swarmwright.common.groups import DeclaredSide
from swarmwright.common.ranges import Range, ranges_of
from swarmwright.common.suggestions import similar
from swarmwright.simulations.base import (
    BatchSimulation,
    Described,
    Group,
    Simulation,
    check_groups,
    check_sides,
)
from swarmwright.simulations.parameters import Parameter, parse_parameters

_LARGEST_COUNT = 1_000_000
"""Largest number of agents, sensors or actuators."""
_MOST_STEPS = 10**15
"""Largest `most_steps`."""
_DETERMINISMS = ("bitwise", "statistical", "none")
_MISSPELT_LIKENESS = 0.85
"""Smallest similarity of names, up to 1, at which an attribute counts as a misspelling of another."""


@dataclass(frozen=True)
class Description:
    """The description of a simulation; see the attributes of `Simulation`."""

    title: str
    dimensions: int
    max_agents: int | None
    sensors: int
    actuators: int
    sensor_names: tuple[str, ...]
    actuator_names: tuple[str, ...]
    sensor_units: tuple[str, ...]
    actuator_units: tuple[str, ...]
    sensor_ranges: tuple[Range | None, ...]
    actuator_ranges: tuple[Range | None, ...]
    parameters: Mapping[str, Parameter]
    metrics: Mapping[str, str]
    copies: bool
    determinism: str | None
    tolerance: float
    lanes: int
    most_steps: int | None
    frame_seconds: float
    step_seconds: float | None
    """Simulated seconds of a step; None if unknown."""
    takes_controller: bool
    """Whether `reset` receives the controller, because the simulation runs it itself."""
    groups: Mapping[str, Group]
    """Kinds of agents, in the order of the agents; empty if all are alike."""
    sides: tuple[DeclaredSide, ...]
    """Sides of a match; empty unless there are several kinds of agents."""
    padded: bool
    """Whether the rows of all agents are padded to the same length in messages."""
    steers_itself: bool | None
    """Whether no agent is controlled from outside; None: it depends on the parameters."""

    def plain(self) -> dict[str, Any]:
        """Return the description as a dictionary with the keys of `_engine.describe`."""
        return {
            "title": self.title,
            "dimensions": self.dimensions,
            "max_agents": self.max_agents,
            "sensors": self.sensors,
            "actuators": self.actuators,
            "sensor_names": list(self.sensor_names),
            "actuator_names": list(self.actuator_names),
            "sensor_units": list(self.sensor_units),
            "actuator_units": list(self.actuator_units),
            "parameters": {
                name: {
                    "type": parameter.kind,
                    "default": parameter.default,
                    "description": parameter.description,
                }
                for name, parameter in self.parameters.items()
            },
            "metrics": {name: {"unit": "", "description": text} for name, text in self.metrics.items()},
            "determinism": self.determinism,
        }


def describe(simulation: Described | Any, where: str = "") -> Description:  # noqa: ANN401 - or what acts like one
    """Read and check a simulation's attributes. Raises InputError, with class (`where`) and attribute."""
    where = where or type(simulation).__name__
    title: Any = simulation.title or where.lower()
    if not isinstance(title, str) or len(title) > 1000:
        raise InputError(f"{where}.title: {title!r} found, expected text of at most 1000 characters")
    parameters = parse_parameters(simulation.parameters, where)
    for name, parameter in parameters.items():
        try:
            json.dumps(parameter.default, allow_nan=False)
        except (TypeError, ValueError):
            raise InputError(
                f"{where}.parameters[{name!r}]: default: {parameter.default!r} found, expected a JSON value"
            ) from None
    max_agents, steps = simulation.max_agents, getattr(simulation, "most_steps", Described.most_steps)
    groups = check_groups(getattr(simulation, "groups", {}), parameters, where)
    metrics = _metrics(where, simulation.metrics)
    sensors, actuators = (
        _count_channels(where, simulation, groups, name) for name in ("sensors", "actuators")
    )
    if (sensors == 0) != (actuators == 0):
        name, counterpart = ("sensors", "actuators") if sensors == 0 else ("actuators", "sensors")
        raise InputError(
            f"{where}.{name}: 0 found, expected at least 1; if the simulation controls its agents itself, "
            f"set {counterpart} to 0, too"
        )

    def channels(name: str, count: int) -> tuple[str, ...]:
        return _channels(where, name, getattr(simulation, name, ()), count)

    def ranges(name: str, count: int) -> tuple[Range | None, ...]:
        try:
            return ranges_of(getattr(simulation, name, ()), count)
        except ValueError as error:
            raise InputError(f"{where}.{name}: {error}") from None

    return Description(
        title=title,
        dimensions=_count(where, "dimensions", simulation.dimensions, least=0),
        max_agents=None if max_agents is None else _count(where, "max_agents", max_agents),
        sensors=sensors,
        actuators=actuators,
        sensor_names=channels("sensor_names", sensors),
        actuator_names=channels("actuator_names", actuators),
        sensor_units=channels("sensor_units", sensors),
        actuator_units=channels("actuator_units", actuators),
        sensor_ranges=ranges("sensor_ranges", sensors),
        actuator_ranges=ranges("actuator_ranges", actuators),
        parameters=parameters,
        metrics=metrics,
        copies=bool(simulation.copies),
        determinism=_determinism(where, simulation.determinism),
        tolerance=_tolerance(where, simulation.tolerance),
        lanes=_count(where, "lanes", getattr(simulation, "lanes", 1)),
        most_steps=None if steps is None else _count(where, "most_steps", steps, most=_MOST_STEPS),
        frame_seconds=_tolerance(where, simulation.frame_seconds, "frame_seconds"),
        step_seconds=_step_seconds(where, simulation),
        takes_controller=bool(getattr(simulation, "takes_controller", False)),
        groups=groups,
        sides=check_sides(getattr(simulation, "sides", {}), groups, metrics, where),
        padded=bool(getattr(simulation, "padded", False)),
        steers_itself=True if sensors == 0 else getattr(simulation, "steers_itself", None),
    )


def find_misspelt_attributes(kind: type[Described]) -> list[str]:
    """Return messages about attributes that are probably misspelt names of a simulation's attributes.

    The values must be of the same type: `sensor_range = 0.5` is not a misspelling of `sensor_ranges`.
    """
    base = BatchSimulation if issubclass(kind, BatchSimulation) else Simulation
    users = [
        base_class
        for base_class in kind.__mro__
        if not f"{base_class.__module__}.".startswith(("swarmwright.", "abc."))
    ]
    attributes = {name: value for user in reversed(users) for name, value in vars(user).items()}
    base_attributes = {
        name: getattr(base, name, 0)  # sensors and actuators have no default
        for name in (*dir(base), "sensors", "actuators")
        if not name.startswith("_") and name not in attributes
    }
    messages = []
    for name, value in attributes.items():
        if name.startswith("_") or hasattr(base, name):
            continue
        suggestion = similar(name, base_attributes, _MISSPELT_LIKENESS)
        if suggestion is not None and _classify_value(value) == _classify_value(base_attributes[suggestion]):
            messages.append(
                f"{kind.__name__}.{name}: is not an attribute of {base.__name__} and has no effect; "
                f"did you mean {suggestion!r}?"
            )
    return messages


def _classify_value(value: object) -> str:
    """Return the type of an attribute's value: method, values, text or value."""
    if callable(value) or isinstance(value, classmethod | staticmethod):
        return "method"
    if isinstance(value, Iterable) and not isinstance(value, str):
        return "values"
    return "text" if isinstance(value, str) else "value"


def _count_channels(where: str, simulation: Any, groups: Mapping[str, Group], name: str) -> int:  # noqa: ANN401 - as above
    """Return the number of sensors or actuators, with groups the largest."""
    declared = getattr(simulation, name, None)
    if not groups:
        return _count(where, name, declared, least=int(isinstance(simulation, BatchSimulation)))
    most = max(getattr(group, name) for group in groups.values())
    if declared is not None and declared != most:
        raise InputError(f"{where}.{name}: {declared!r} found, but groups have up to {most}; leave it out")
    return int(most)


def _channels(where: str, name: str, value: Any, count: int) -> tuple[str, ...]:  # noqa: ANN401 - whatever it says
    """Return names or units of sensors or actuators: all of them, or none."""
    noun = name.partition("_")[2]
    if isinstance(value, str) or not isinstance(value, Iterable):
        raise InputError(f"{where}.{name}: {value!r} found, expected a list of {count} {noun}")
    names = tuple(value)
    if not all(isinstance(name_, str) for name_ in names):
        raise InputError(f"{where}.{name}: {list(names)!r} found, expected text only")
    if names and len(names) != count:
        raise InputError(f"{where}.{name}: {len(names)} {noun} found, expected {count}")
    return names


def check_determinism(where: str, name: Any, tolerance: Any) -> tuple[str | None, float]:  # noqa: ANN401 - whatever the class says
    """Check `determinism` and `tolerance`. Raises InputError, with class (`where`) and attribute."""
    return _determinism(where, name), _tolerance(where, tolerance)


def _determinism(where: str, value: Any) -> str | None:  # noqa: ANN401 - whatever the class says
    if value is not None and value not in _DETERMINISMS:
        expected = ", ".join(_DETERMINISMS)
        raise InputError(f"{where}.determinism: {value!r} found, expected one of {expected}, or None")
    return None if value is None else str(value)


def _tolerance(where: str, value: Any, name: str = "tolerance") -> float:  # noqa: ANN401 - whatever it says
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 <= value < math.inf:
        raise InputError(f"{where}.{name}: {value!r} found, expected a number, 0 or more")
    return float(value)


def _step_seconds(where: str, simulation: Any) -> float | None:  # noqa: ANN401 - as above
    """Return the class's `step_seconds`, or else its `frame_seconds` if it sets that."""
    declared = getattr(simulation, "step_seconds", None)
    if declared is not None:
        seconds = _tolerance(where, declared, "step_seconds")
        if seconds == 0:
            raise InputError(f"{where}.step_seconds: {declared!r} found, expected seconds above 0, or None")
        return seconds
    owners = [vars(simulation), *(vars(kind) for kind in type(simulation).__mro__ if kind is not Described)]
    if any("frame_seconds" in owner for owner in owners):
        return _tolerance(where, simulation.frame_seconds, "frame_seconds") or None
    return None


def _metrics(where: str, metrics: Any) -> dict[str, str]:  # noqa: ANN401 - whatever the class says
    """Return name -> description."""
    if isinstance(metrics, str) or not isinstance(metrics, Iterable):
        raise InputError(f"{where}.metrics: {metrics!r} found, expected names, or names with descriptions")
    named = dict(metrics) if isinstance(metrics, Mapping) else dict.fromkeys(metrics, "")
    for name, text in named.items():
        if name == "fitness":
            raise InputError(f"{where}.metrics: {name!r} is the name of the fitness; choose another name")
        if metric_names.problem_of(name):
            raise InputError(
                f"{where}.metrics: {name!r} found, expected a letter (A-Z, a-z) or _, then letters, digits "
                "and _"
            )
        if not isinstance(text, str):
            raise InputError(f"{where}.metrics[{name!r}]: {text!r} found, expected a description")
    return named


def _count(where: str, name: str, value: Any, *, least: int = 1, most: int = _LARGEST_COUNT) -> int:  # noqa: ANN401 - whatever it says
    with suppress(TypeError):
        if not isinstance(value, bool) and least <= operator.index(value) <= most:
            return operator.index(value)
    raise InputError(f"{where}.{name}: {value!r} found, expected an integer from {least} to {most}")
