"""What agents of each kind have, of the numbers that are recorded for all of them."""

from collections.abc import Sequence
from typing import Any

from swarmwright.common.errors import InputError
from swarmwright.common.groups import Kind, Names
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
    except InputError:
        return []
    return [
        Kind(
            one.name, one.agents,
            one.own_sensor_names or _padded(one.sensor_names, "sensor", one.sensors, whole["sensors"]),
            one.own_actuator_names
            or _padded(one.actuator_names, "actuator", one.actuators, whole["actuators"]),
        )
        for one in groups
    ]  # fmt: skip


def _padded(names: Sequence[str], what: str, count: int, most: int) -> Names:
    known = names or tuple(f"{what} {index}" for index in range(count))
    return (*known, *(None for _ in range(most - len(known))))
