"""The state machines of controllers, as films and pages show them."""

from collections.abc import Mapping
from typing import Any

from swarmwright.controllers.kinds import machine_of
from swarmwright.controllers.teams import is_team, parts_of
from swarmwright.display.machines import Group, Machines


def machines_of(specification: Mapping[str, Any]) -> Machines:
    """Return the state machines of a controller; of a team those of its groups."""
    kind = str(specification.get("kind", ""))
    if not is_team(specification):
        return Machines(kind, machine_of(specification))
    first: int | None = 0
    machines = []
    for group, part in zip(specification["groups"], parts_of(specification).values(), strict=True):
        agents = group.get("agents")
        end = None if first is None or agents is None else first + int(agents)
        machines.append(Group(group["name"], first, end, machine_of(part)))
        first = end
    return Machines(kind, groups=tuple(machines))
