"""What agents of each kind have, of the numbers that are recorded for all of them."""

from collections.abc import Mapping, Sequence
from typing import Any

from swarmwright.core.errors import InputError
from swarmwright.core.groups import Kind, Names
from swarmwright.experiment.robots import mission_of
from swarmwright.simulations import catalogue


def kinds(simulation: str, parameters: dict[str, Any]) -> list[Kind]:
    """Return the kinds of agents of a simulation that is known here, in the order of the agents.

    Empty where all agents are alike, or where it is not known what each kind has.
    """
    try:
        groups = catalogue.groups(simulation, parameters)
        if not groups:
            return []
        whole = catalogue.description(simulation, parameters)
        if catalogue.built_in(simulation) != catalogue.ARENA:
            return [
                Kind(
                    one.name, one.agents,
                    _padded(one.sensor_names, "sensor", one.sensors, whole["sensors"]),
                    _padded(one.actuator_names, "actuator", one.actuators, whole["actuators"]),
                )
                for one in groups
            ]  # fmt: skip
        alone = _alone(simulation, parameters)
        if [one.name for one in groups] != list(alone):
            return []
        return [
            Kind(
                one.name, one.agents,
                _own(one.sensor_names, alone[one.name]["sensor_names"], one.name),
                _own(one.actuator_names, alone[one.name]["actuator_names"], one.name),
            )
            for one in groups
        ]  # fmt: skip
    except InputError:
        return []


def _padded(names: Sequence[str], what: str, count: int, most: int) -> Names:
    known = names or tuple(f"{what} {index}" for index in range(count))
    return (*known, *(None for _ in range(most - len(known))))


def _alone(simulation: str, parameters: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """Return the description of each kind of robots of the arena as if there were no others."""
    given = parameters.get("robots")
    robots = given if isinstance(given, list) else (mission_of(parameters.get("mission")) or {}).get("robots")
    if not isinstance(robots, list):
        return {}
    kept = {key: parameters[key] for key in ("mission", "robot") if key in parameters}

    def described(kind: Mapping[str, Any]) -> dict[str, Any]:
        return catalogue.description(simulation, {**kept, "robots": [kind]})

    found = {}
    for one in robots:
        try:
            found[one["name"]] = described(one)
        except InputError:
            # Without the others, there may be nobody whose messages it hears.
            own = described(_talking(one))
            actuators = [name for name in own["actuator_names"] if not name.startswith(_MESSAGE)]
            found[one["name"]] = {**own, "actuator_names": actuators}
    return found


_MESSAGE = "message "
"""With what names of the numbers of messages begin, both of sensors and of actuators."""


def _talking(kind: Mapping[str, Any]) -> dict[str, Any]:
    """Return a kind whose robots send messages, too. Raises InputError where its actuators are not known."""
    robot = kind.get("robot")
    if not isinstance(robot, Mapping) or not isinstance(robot.get("actuators", []), list):
        raise InputError(f"kind {kind.get('name')}: its actuators are not known")
    actuators = [*robot.get("actuators", []), {"kind": "message", "numbers": 1}]
    return {**kind, "robot": {**robot, "actuators": actuators}}


def _own(together: Sequence[str], own: Sequence[str], kind: str) -> Names:
    """Return what a kind calls the numbers of all kinds.

    together: their names, which may begin with those of the kinds that have them. own: of the kind alone.
    """
    if len(together) == len(own):
        return tuple(own)
    return tuple(_name(name, own, kind) for name in together)


def _name(name: str, own: Sequence[str], kind: str) -> str | None:
    if name in own:
        return name
    # All kinds that hear messages hear the longest one.
    if name.startswith(_MESSAGE) and any(one.startswith(_MESSAGE) for one in own):
        return name
    for one in own:
        owners = name.removesuffix(f" {one}")
        if owners != name and kind in owners.split(" and "):
            return one
    return None
