"""Methods that search a box with members which stay until something better replaces them."""

import numpy as np
from pydantic import Field

from swarmwright.common.arrays import Genomes, Limits
from swarmwright.controllers import Representation
from swarmwright.methods._base import MethodOptions
from swarmwright.methods._numbers import center_and_reach, discrete, limits
from swarmwright.methods.search import KeepsMembers


class BoxOptions(MethodOptions):
    """Options of methods that search a box."""

    population: int
    reach: float = Field(default=5.0, ge=1, le=1e6)
    """Genes without bounds stay within this many times their initial range around its middle. Where a given
    controller is outside of that, up to half of the initial range farther."""


class Box(KeepsMembers):
    """Members in a box, and as many candidates that compete with them in each generation.

    The box is made of the genes' bounds and, where there are none, of their initial range times `reach`;
    where a genome to start from is outside of that, the box ends half of the initial range beyond it. The
    first generation are random genomes of the representation, as with every method here, not points of the
    whole box. A candidate takes the place of its member when it is better; a failed one is worse than all
    others.
    """

    options: BoxOptions
    generational_because = "it replaces whole generations"

    @classmethod
    def unsuitable(cls, representation: Representation) -> str | None:
        """Refuse genes that are not numbers to compute with."""
        return discrete(representation)

    @property
    def budget(self) -> int:
        """Number of evaluations of the whole run."""
        return self.options.population * self.options.generations

    @property
    def box(self) -> Limits:
        """Where genes are searched: the lowest and highest value of each."""
        center, reach = center_and_reach(self.representation)
        lower, upper = self.representation.bounds
        least, most = limits(self.representation)
        wide = self.options.reach * reach
        low, high = center - wide, center + wide
        if len(self.start):
            given = self.start.astype(np.float64)
            lowest, highest = given.min(axis=0), given.max(axis=0)
            low = np.where(lowest < low, lowest - reach, low)
            high = np.where(highest > high, highest + reach, high)
        return (
            np.where(np.isfinite(lower), lower, np.clip(low, least, most)),
            np.where(np.isfinite(upper), upper, np.clip(high, least, most)),
        )

    @property
    def _first(self) -> Genomes:
        """The first generation, random genomes."""
        return np.ascontiguousarray(self.initials(range(self.options.population)), dtype=np.float32)
