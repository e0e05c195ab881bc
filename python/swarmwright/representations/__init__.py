"""Representations: the controller that a genome stands for. `REPRESENTATIONS` has all kinds by name."""

from swarmwright.core.options import Options
from swarmwright.core.random_numbers import Stream, Streams
from swarmwright.core.registry import Registry
from swarmwright.representations._base import Representation, RepresentationOptions
from swarmwright.typing import Genome, Genomes, Limits

__all__ = [
    "REPRESENTATIONS",
    "Genome",
    "Genomes",
    "Limits",
    "Options",
    "Representation",
    "RepresentationOptions",
    "Stream",
    "Streams",
]

REPRESENTATIONS: Registry[Representation] = Registry(
    "controller",
    "swarmwright.representations",
    {
        "evostick": "swarmwright.representations.evostick:Evostick",
        "fully_meshed": "swarmwright.representations.fully_meshed:FullyMeshed",
        "hebbian": "swarmwright.representations.hebbian:Hebbian",
        "layered": "swarmwright.representations.layered:Layered",
        "mealy_fsm": "swarmwright.representations.mealy_fsm:MealyFsm",
        "modules": "swarmwright.representations.modules:Modules",
        "neat": "swarmwright.representations.neat:Neat",
        "parameter_set": "swarmwright.representations.parameter_set:ParameterSet",
        "team": "swarmwright.representations.team:Team",
    },
    "swarmwright.representations:Representation",
)
"""All representations, by the `kind` of an experiment's `controller`."""
