"""How a genome becomes a controller: one file and one line below for each representation."""

from swarmwright._registry import Registry
from swarmwright.representations._base import Representation

__all__ = ["REPRESENTATIONS", "Representation"]

REPRESENTATIONS: Registry[Representation] = Registry(
    "controller",
    "swarmwright.representations",
    {
        "fully_meshed": "swarmwright.representations.fully_meshed:FullyMeshed",
        "layered": "swarmwright.representations.layered:Layered",
    },
    "swarmwright.representations:Representation",
)
"""All representations, by the `kind` of an experiment's `controller`."""
