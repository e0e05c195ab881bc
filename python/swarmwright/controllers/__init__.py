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
from swarmwright.controllers._base import Representation, RepresentationOptions

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
        "evostick": "swarmwright.controllers.kinds.evostick.representation:Evostick",
        "fully_meshed": "swarmwright.controllers.kinds.fully_meshed:FullyMeshed",
        "hebbian": "swarmwright.controllers.kinds.hebbian.representation:Hebbian",
        "layered": "swarmwright.controllers.kinds.layered:Layered",
        "mealy_fsm": "swarmwright.controllers.kinds.mealy_fsm:MealyFsm",
        "modules": "swarmwright.controllers.kinds.modules.representation:Modules",
        "neat": "swarmwright.controllers.kinds.neat.representation:Neat",
        "parameter_set": "swarmwright.controllers.kinds.parameter_set:ParameterSet",
        "team": "swarmwright.controllers.kinds.team:Team",
    },
    "swarmwright.controllers:Representation",
)
"""All representations, by the `kind` of an experiment's `controller`."""
