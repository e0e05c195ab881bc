"""Specifications of the kind `team`: a controller for each group of agents."""

from collections.abc import Mapping
from typing import Any

from swarmwright import _engine
from swarmwright.common.errors import engine_errors

TEAM = "team"
"""Kind of these specifications."""


def is_team(specification: Mapping[str, Any]) -> bool:
    """Whether the specification has a controller for each group of agents."""
    return specification.get("kind") == TEAM


def parts_of(specification: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """Return the controller of each group of a team, with its weights; empty for other controllers.

    Raises InputError for an invalid specification.
    """
    if not is_team(specification):
        return {}
    parts, first = {}, 0
    with engine_errors("controller: "):
        for group in specification["groups"]:
            last = first + _engine.genome_size(group["controller"])
            parts[str(group["name"])] = {
                **group["controller"],
                "weights": list(specification["weights"][first:last]),
            }
            first = last
    return parts
