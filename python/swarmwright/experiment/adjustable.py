"""Parameters of a simulation that a user can change individually: numbers, texts, choices."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal

from swarmwright.experiment.experiment import Experiment
from swarmwright.experiment.ranges import E_PUCKS, PRESETS
from swarmwright.experiment.robots import mission_of, robot_of
from swarmwright.simulations import catalogue

Kind = Literal["integer", "number", "boolean", "string"]
_KINDS: dict[type, Kind] = {bool: "boolean", int: "integer", float: "number", str: "string"}
_MISSION_DEFAULTS = {"robots": 20, "duration": 120}
"""Defaults of the arena for missions that do not set them."""
_FRAME_TIME = "stepSize"
"""Parameter that only changes the speed of pictures; listed last."""
_MOST = 1000
"""Largest number of parameters of an experiment that are listed."""


@dataclass(frozen=True)
class Adjustable:
    """A parameter that can be changed, as for `Run.replay` and `post_evaluate`."""

    key: str
    """`robots`, or `robot.drive.noise` for a part of one."""
    kind: Kind
    value: Any
    """Value in the experiment, or the default; None if the simulation decides."""
    is_set: bool = False
    """Whether the experiment sets it."""
    minimum: float | None = None
    """The smallest permitted value, if the simulation declares it."""
    maximum: float | None = None
    """The largest permitted value, if the simulation declares it."""
    choices: tuple[Any, ...] = ()
    """All permitted values, if the simulation declares them."""
    description: str = ""
    """Meaning and unit."""


def list_adjustable(experiment: Experiment) -> list[Adjustable]:
    """Return the parameters of an experiment that are numbers, texts or choices, and the numbers in others.

    Parameters that the experiment sets come first; the seed is excluded. If the description of the simulation
    is not available on this machine, only the parameters that the experiment sets are returned. Raises
    InputError for a class that cannot be loaded.
    """
    parameters = {name: value for name, value in experiment.parameters.items() if name != "seed"}
    adjustables = [*_iter_declared(experiment.simulation, parameters), *_iter_parts(parameters, ())]
    if catalogue.find_built_in(experiment.simulation) == catalogue.ARENA:
        adjustables = [*_iter_arena(adjustables, parameters)]
    unique: dict[str, Adjustable] = {}
    for adjustable in adjustables:
        unique.setdefault(adjustable.key, adjustable)
    ordered = sorted(
        unique.values(), key=lambda adjustable: (not adjustable.is_set, adjustable.key == _FRAME_TIME)
    )
    return ordered[:_MOST]


def _iter_declared(simulation: str, parameters: Mapping[str, Any]) -> Iterator[Adjustable]:
    if not catalogue.has_description(simulation):
        return
    announced = catalogue.description(simulation)["parameters"]
    for name, parameter in catalogue.list_parameters(simulation).items():
        value = parameters.get(name, parameter.default)
        if value is None or type(value) not in _KINDS or not _is_name(name):
            continue
        yield Adjustable(
            _format_key((name,)),
            "number" if announced[name]["type"] == "number" else _KINDS[type(value)],
            value,
            name in parameters,
            parameter.minimum,
            parameter.maximum,
            tuple(parameter.choices or ()),
            parameter.description,
        )


def _iter_parts(value: Any, path: tuple[str | int, ...]) -> Iterator[Adjustable]:  # noqa: ANN401 - any value of a file
    """Yield the numbers and booleans in a value with their keys, and a text that is a whole parameter."""
    if isinstance(value, Mapping):
        items = [(key, part) for key, part in value.items() if _is_name(key)]
    elif isinstance(value, list):
        items = list(enumerate(value))
    else:
        kind = _KINDS.get(type(value))
        if kind is not None and (kind != "string" or len(path) == 1):
            # An integer in a part may be declared as a number; nothing tells which.
            part_kind = "number" if kind == "integer" and len(path) > 1 else kind
            yield Adjustable(_format_key(path), part_kind, value, is_set=True)
        return
    for key, part in items:
        yield from _iter_parts(part, (*path, key))


def _is_name(key: Any) -> bool:  # noqa: ANN401 - any key of a file
    """Return whether a key can be part of a dotted key."""
    return isinstance(key, str) and key != "" and '"' not in key


def _format_key(path: tuple[str | int, ...]) -> str:
    """Return a key as in settings; names with special characters such as dots are quoted."""
    return ".".join(f'"{part}"' if set(str(part)) & set(".[]=") else str(part) for part in path)


def _iter_arena(adjustables: list[Adjustable], parameters: Mapping[str, Any]) -> Iterator[Adjustable]:
    """Yield parameters of the arena; defaults come from the mission."""
    mission = mission_of(parameters.get("mission")) or {}
    missions = tuple(catalogue.mission_names())
    for adjustable in adjustables:
        yield replace(adjustable, choices=missions) if adjustable.key == "mission" else adjustable
    declared = catalogue.list_parameters(catalogue.ARENA)
    for name, default in _MISSION_DEFAULTS.items():
        value = mission.get(name, default)
        if name not in parameters and isinstance(value, int | float):
            kind: Kind = "integer" if name == "robots" else "number"
            yield Adjustable(name, kind, value, description=declared[name].description)
    robot = robot_of(parameters)
    preset = robot.get("preset") if isinstance(robot, Mapping) else robot
    if preset in PRESETS:
        for item in E_PUCKS:
            key = _format_key(item.path[1:])
            yield Adjustable(key, "number", item.reference, minimum=0.0, maximum=1.0)
    # Of a mission by name, the parts that can be set.
    parts = _iter_parts({key: mission[key] for key in mission if key not in parameters}, ("mission",))
    yield from (replace(part, is_set=False) for part in parts)
