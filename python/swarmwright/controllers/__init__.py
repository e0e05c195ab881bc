"""Representations: the controller that a genome stands for, and how genomes are varied.

`REPRESENTATIONS.names()` lists the kinds that an experiment's `controller` may have, those of plug-ins
included; `REPRESENTATIONS.get("layered")` is the class of one. An experiment makes its representation by
`Experiment.representation()`, whose `specification(genome)` is a controller. A custom representation is a
class derived from `Representation`: docs/how-to/plug-ins.md.
"""

from swarmwright.common.arrays import Genome, Genomes, Limits
from swarmwright.common.options import Options
from swarmwright.common.random_numbers import Stream, Streams
from swarmwright.common.registry import Registry
from swarmwright.controllers._base import Representation, RepresentationOptions
from swarmwright.controllers.kinds import KINDS

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
        name: f"swarmwright.controllers.{kind.representation}"
        for name, kind in KINDS.items()
        if kind.representation
    },
    "swarmwright.controllers:Representation",
)
"""All representations, by the `kind` of an experiment's `controller`."""
