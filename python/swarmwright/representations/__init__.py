"""Representations: the controller that a genome stands for, and how genomes are varied.

`REPRESENTATIONS.names()` lists the kinds that an experiment's `controller` may have, those of plug-ins
included; `REPRESENTATIONS.get("layered")` is the class of one. An experiment makes its representation by
`Experiment.representation()`, whose `specification(genome)` is a controller. A custom representation is a
class derived from `Representation`: docs/how-to/own-representation.md.
"""

from swarmwright.common.options import Options
from swarmwright.common.random_numbers import Stream, Streams
from swarmwright.common.registry import Registry
from swarmwright.common.typing import Genome, Genomes, Limits
from swarmwright.representations._base import Representation, RepresentationOptions

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
