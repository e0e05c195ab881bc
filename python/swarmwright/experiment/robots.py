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
    of_mission = mission_of(parameters.get("mission")) or {}
    robots = parameters.get("robots")
    if isinstance(robots, list) or (robots is None and isinstance(of_mission.get("robots"), list)):
        return None
    own = parameters.get("robot")
    return of_mission.get("robot", DEFAULT) if own is None else own


def mission_of(given: Any) -> Mapping[str, Any] | None:  # noqa: ANN401 - as the arena's parameter has it
    """Return a mission as a mapping, also for a built-in name; None if it does not exist."""
    if isinstance(given, Mapping):
        return given
    if given is None:
        given = catalogue.description(catalogue.ARENA)["parameters"]["mission"]["default"]
    texts = (mission["text"] for mission in _engine.missions() if given in (mission["name"], mission["also"]))
    return next((parse(text, "").values for text in texts), None)


def subject_of(simulation: str, label: str, parameters: Mapping[str, Any]) -> str:
    """Return the name of a simulation in titles of figures: its label and the title of its mission, if any.

    Args:
        simulation: its name.
        label: of the simulation, as `Experiment.label`.
        parameters: of the experiment.
    """
    given = parameters.get("mission")
    if catalogue.find_built_in(simulation) == catalogue.ARENA:
        found = mission_of(given)
        given = (found or {}).get("title") or (given if isinstance(given, str) else None)
    return f"{label}, {given}" if isinstance(given, str) and given else label


def mission_name(given: Any) -> Any:  # noqa: ANN401 - as the arena's parameter has it
    """Return the longer name of a built-in mission; other values unchanged."""
    long = (mission["also"] for mission in _engine.missions() if mission["also"] and mission["name"] == given)
    return next(long, given)


def written_out(
    values: dict[str, Any], paths: Iterable[tuple[str, ...]], folder: Callable[[Path_], Path]
) -> dict[str, Any]:
    """Expand the robot in an experiment's values to a mapping if its components will be set.

    Values stay unchanged if another robot is set, or if the robot or the mission is invalid.

    Args:
        values: of the experiment.
        paths: of the settings.
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
    wrong: list[Path_] = []
    found, _ = resolve(simulation, parameters, folder, lambda path, _: wrong.append(path), ask=False)
    if wrong or mission_of(found.get("mission")) is None:
        return values
    robot = robot_of(found)
    if isinstance(robot, Mapping):
        parts = dict(robot)
    elif robot in _engine.robots():
        parts = {"preset": robot}
    else:
        return values
    return {**values, "parameters": {**parameters, "robot": parts}}


def kinds_instead(
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
    found, _ = resolve(simulation, parameters, folder, lambda *_: None, ask=False)
    if isinstance(found.get("robots"), list):
        return "parameters.robots"
    of_mission = mission_of(found.get("mission")) or {}
    several = found.get("robots") is None and isinstance(of_mission.get("robots"), list)
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


def kinds(simulation: str, parameters: dict[str, Any]) -> list[Kind]:
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
            group.name, group.agents,
            group.own_sensor_names or _padded(group.sensor_names, "sensor", group.sensors, whole["sensors"]),
            group.own_actuator_names
            or _padded(group.actuator_names, "actuator", group.actuators, whole["actuators"]),
        )
        for group in groups
    ]  # fmt: skip


def _padded(names: Sequence[str], what: str, count: int, most: int) -> Names:
    known = names or tuple(f"{what} {index}" for index in range(count))
    return (*known, *(None for _ in range(most - len(known))))
