"""Running time and cost of the servers of each launcher."""

import json
from collections.abc import Mapping
from typing import NamedTuple

from swarmwright.common.json_text import loads


class ServerUse(NamedTuple):
    """Use of the servers of one launcher."""

    seconds: float = 0.0
    """Total running time of its servers."""
    cost: float = 0.0
    """In the currency of `cost_per_hour`; 0 without it."""

    def __add__(self, other: object) -> "ServerUse":
        """Return the sum."""
        assert isinstance(other, ServerUse)
        return ServerUse(self.seconds + other.seconds, self.cost + other.cost)


ServerUses = Mapping[str, ServerUse]
"""Use by launcher; `ssh-2` is the second entry of this kind."""


def add_uses(first: ServerUses, second: ServerUses) -> dict[str, ServerUse]:
    """Add two uses launcher by launcher."""
    names = dict.fromkeys([*first, *second])
    return {name: first.get(name, ServerUse()) + second.get(name, ServerUse()) for name in names}


def to_json(uses: ServerUses) -> str:
    """Serialize uses as JSON."""
    return json.dumps({name: use._asdict() for name, use in uses.items()})


def from_json(text: str) -> dict[str, ServerUse]:
    """Parse uses from JSON. Raises ValueError, KeyError or TypeError for other texts."""
    return {
        str(name): ServerUse(float(use["seconds"]), float(use["cost"]))
        for name, use in dict(loads(text)).items()
    }
