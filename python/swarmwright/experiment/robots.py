"""The robot of an experiment in the arena, whose components can be set or varied."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from swarmwright import _engine
from swarmwright.common.errors import InputError
from swarmwright.common.groups import Kind, Names
from swarmwright.common.yaml import Path_, parse
from swarmwright.experiment.parameter_files import resolve
from swarmwright.simulations import catalogue

DEFAULT = "e-puck-rm1.1"
"""Default robot of missions."""
_KEY = ("parameters", "robot")


def robot_of(parameters: Mapping[str, Any]) -> Any:  # noqa: ANN401 - as the arena's parameter has it
    """Return the robot of the arena: that of the parameters, of the mission, or the default.

    None for several kinds.
    """
    mission = mission_of(parameters.get("mission")) or {}
    robots = parameters.get("robots")
    if isinstance(robots, list) or (robots is None and isinstance(mission.get("robots"), list)):
        return None
    explicit = parameters.get("robot")
    return mission.get("robot", DEFAULT) if explicit is None else explicit


def mission_of(mission: Any) -> Mapping[str, Any] | None:  # noqa: ANN401 - as the arena's parameter has it
    """Return a mission as a mapping, also for a built-in name; None if it does not exist."""
    if isinstance(mission, Mapping):
        return mission
    if mission is None:
        mission = catalogue.description(catalogue.ARENA)["parameters"]["mission"]["default"]
    texts = (entry["text"] for entry in _engine.missions() if mission in (entry["name"], entry["also"]))
    return next((parse(text, "").values for text in texts), None)


def subject_of(simulation: str, label: str, parameters: Mapping[str, Any]) -> str:
    """Return the name of a simulation in titles of figures: its label and the title of its mission, if any.

    Args:
        simulation: its name.
        label: label of the simulation, as `Experiment.label`.
        parameters: parameters of the experiment.
    """
    mission = parameters.get("mission")
    if catalogue.find_built_in(simulation) == catalogue.ARENA:
        definition = mission_of(mission)
        mission = (definition or {}).get("title") or (mission if isinstance(mission, str) else None)
    return f"{label}, {mission}" if isinstance(mission, str) and mission else label


def find_colors(simulation: str, parameters: Mapping[str, Any]) -> dict[str, str]:
    """Return the colours that a mission of the arena gives its kinds of robots, by the name of the kind."""
    if catalogue.find_built_in(simulation) != catalogue.ARENA:
        return {}
    robots = (mission_of(parameters.get("mission")) or {}).get("robots")
    kinds = [kind for kind in robots if isinstance(kind, Mapping)] if isinstance(robots, list) else []
    return {str(kind.get("name")): str(kind["color"]) for kind in kinds if "color" in kind}


def mission_name(mission: Any) -> Any:  # noqa: ANN401 - as the arena's parameter has it
    """Return the longer name of a built-in mission; other values unchanged."""
    long = (entry["also"] for entry in _engine.missions() if entry["also"] and entry["name"] == mission)
    return next(long, mission)


def expand_robot(
    values: dict[str, Any], paths: Iterable[tuple[str, ...]], folder: Callable[[Path_], Path]
) -> dict[str, Any]:
    """Expand the robot in an experiment's values to a mapping if its components will be set.

    Values stay unchanged if another robot is set, or if the robot or the mission is invalid.

    Args:
        values: the experiment's values.
        paths: paths of the settings.
        folder: returns the base folder of paths at a key of the parameters.
    """
    set_ = list(paths)
    simulation, parameters = values.get("simulation"), values.get("parameters") or {}
    if not any(map(is_part, set_)) or any(map(_is_other, set_)):
        return values
    if not isinstance(simulation, str) or catalogue.find_built_in(simulation) != catalogue.ARENA:
        return values
    if not isinstance(parameters, Mapping):
        return values
    invalid: list[Path_] = []
    resolved, _ = resolve(simulation, parameters, folder, lambda path, _: invalid.append(path), ask=False)
    if invalid or mission_of(resolved.get("mission")) is None:
        return values
    robot = robot_of(resolved)
    if isinstance(robot, Mapping):
        parts = dict(robot)
    elif robot in _engine.robots():
        parts = {"preset": robot}
    else:
        return values
    return {**values, "parameters": {**parameters, "robot": parts}}


def find_kinds_instead(
    values: Mapping[str, Any], paths: Iterable[tuple[str, ...]], folder: Callable[[Path_], Path]
) -> str | None:
    """Return the key of the kinds of robots if settings address components of a single robot.

    None without kinds, or if the robot is given or set explicitly. Arguments as for `written_out`.
    """
    set_ = list(paths)
    simulation, parameters = values.get("simulation"), values.get("parameters") or {}
    if not any(map(is_part, set_)) or any(map(_is_other, set_)) or (*_KEY, "radius") in set_:
        return None
    if not isinstance(simulation, str) or catalogue.find_built_in(simulation) != catalogue.ARENA:
        return None
    if not isinstance(parameters, Mapping) or parameters.get("robot") is not None:
        return None
    resolved, _ = resolve(simulation, parameters, folder, lambda *_: None, ask=False)
    if isinstance(resolved.get("robots"), list):
        return "parameters.robots"
    mission = mission_of(resolved.get("mission")) or {}
    several = resolved.get("robots") is None and isinstance(mission.get("robots"), list)
    return "parameters.mission.robots" if several else None


def is_part(path: tuple[str, ...]) -> bool:
    """Return whether a key is a component of the single robot."""
    return path[:2] == _KEY and len(path) > 2


def _is_other(path: tuple[str, ...]) -> bool:
    """Whether another robot is set, directly or by the mission."""
    whole = {("simulation",), ("parameters",), _KEY, (*_KEY, "preset"), ("parameters", "mission")}
    below = {
        ("parameters", "robots"),
        ("parameters", "mission", "robot"),
        ("parameters", "mission", "robots"),
    }
    return path in whole or any(path[: len(prefix)] == prefix for prefix in below)


def list_kinds(simulation: str, parameters: dict[str, Any]) -> list[Kind]:
    """Return the kinds of agents of a simulation, in the order of the agents.

    Empty if all agents are alike or the kinds are unknown.
    """
    try:
        groups = catalogue.groups(simulation, parameters)
        if not groups:
            return []
        whole = catalogue.description(simulation, parameters)
    except InputError:
        return []
    return [
        Kind(
            group.name, group.agents, group.own_sensor_names or _pad_names(group.sensor_names, "sensor",
            group.sensors, whole["sensors"]), group.own_actuator_names or _pad_names(group.actuator_names,
            "actuator", group.actuators, whole["actuators"]),
        )
        for group in groups
    ]  # fmt: skip


def _pad_names(names: Sequence[str], label: str, count: int, most: int) -> Names:
    listed = names or tuple(f"{label} {index}" for index in range(count))
    return (*listed, *(None for _ in range(most - len(listed))))
