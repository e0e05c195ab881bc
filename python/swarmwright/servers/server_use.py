"""How long the servers of each launcher have run, and what that has cost."""

import json
from collections.abc import Mapping
from typing import NamedTuple

from swarmwright.common.json_text import loads


class ServerUse(NamedTuple):
    """Use of the servers of one launcher.

    seconds: for which they ran, all together. cost: in the currency of `cost_per_hour`; 0 without it.
    """

    seconds: float = 0.0
    cost: float = 0.0

    def __add__(self, other: object) -> "ServerUse":
        """Return both together."""
        assert isinstance(other, ServerUse)
        return ServerUse(self.seconds + other.seconds, self.cost + other.cost)


ServerUses = Mapping[str, ServerUse]
"""By launcher; `ssh-2` is the second entry of this kind."""


def together(one: ServerUses, other: ServerUses) -> dict[str, ServerUse]:
    """Return the sum of both."""
    names = dict.fromkeys([*one, *other])
    return {name: one.get(name, ServerUse()) + other.get(name, ServerUse()) for name in names}


def written(uses: ServerUses) -> str:
    """Return uses as JSON."""
    return json.dumps({name: use._asdict() for name, use in uses.items()})


def read(text: str) -> dict[str, ServerUse]:
    """Return what `written` wrote; raises ValueError, KeyError or TypeError for something else."""
    return {
        str(name): ServerUse(float(use["seconds"]), float(use["cost"]))
        for name, use in dict(loads(text)).items()
    }
