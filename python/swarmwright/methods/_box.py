"""Methods that search a box with members that survive until a better candidate replaces them."""

import numpy as np
from pydantic import Field

from swarmwright.common.arrays import Genomes, Limits
from swarmwright.controllers import Representation
from swarmwright.methods._base import MethodOptions
from swarmwright.methods._numbers import box, explain_discrete
from swarmwright.methods.search import KeepsMembers


class BoxOptions(MethodOptions):
    """Options of methods that search a box."""

    population: int
    reach: float = Field(default=5.0, ge=1, le=1e6)
    """Limit of genes without bounds, as a multiple of their initial range around its middle; extended for
    given controllers outside."""


class Box(KeepsMembers):
    """Members in a box, each of which competes with one candidate per generation.

    The box consists of the genes' bounds or, without bounds, of their initial range times `reach`, extended
    to half of the initial range beyond given genomes. The first generation consists of random genomes of the
    representation, not of points of the whole box. A better candidate replaces its member; failed candidates
    are worse than all others.
    """

    options: BoxOptions
    generational_because = "it replaces whole generations"

    @classmethod
    def unsuitable(cls, representation: Representation) -> str | None:
        """Refuse genes that are not numbers to compute with."""
        return explain_discrete(representation)

    @property
    def budget(self) -> int:
        """Number of evaluations of the whole run."""
        return self.options.population * self.options.generations

    @property
    def box(self) -> Limits:
        """The lowest and highest value of each gene."""
        return box(self.representation, self.start, self.options.reach)

    @property
    def _first(self) -> Genomes:
        """The first generation, random genomes."""
        return np.ascontiguousarray(self.initials(range(self.options.population)), dtype=np.float32)
