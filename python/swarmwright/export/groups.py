"""One controller of a team, to be exported by itself."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from swarmwright.common.errors import InputError
from swarmwright.common.suggestions import did_you_mean
from swarmwright.common.teams import is_team, parts_of


@dataclass(frozen=True)
class Member:
    """The controller of a group of agents."""

    name: str
    """Of the group."""
    specification: Mapping[str, Any]
    """With its weights."""
    first: int
    """The first agent that has it."""
    last: float
    """The agent after the last one; infinite where all other agents have it."""


def member_of(specification: Mapping[str, Any], group: str | None, where: str) -> Member | None:
    """Return the controller of a group; None where agents do not differ.

    Args:
        specification: the whole controller.
        group: its name, None where none was given.
        where: what has the controller, for messages.

    Raises InputError for a group that there is not, or none for a team.
    """
    if not is_team(specification):
        if group is not None:
            raise InputError(
                f"group: {where} has one controller for all agents; leave the group {group!r} out"
            )
        return None
    names = [str(one["name"]) for one in specification["groups"]]
    if group is None:
        raise InputError(
            f"group: {where} has a controller for each group of agents; name one of {', '.join(names)} "
            "(--group NAME)"
        )
    if group not in names:
        hint = did_you_mean(group, names) or f"; there are {', '.join(names)}"
        raise InputError(f"group: {where} has no group {group!r}{hint}")
    first = 0
    for one in specification["groups"]:
        last = float("inf") if one["agents"] is None else first + int(one["agents"])
        if one["name"] == group:
            return Member(group, parts_of(specification)[group], first, last)
        first = int(last)
    raise AssertionError(group)
