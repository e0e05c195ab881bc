"""NEAT: networks that grow, in species."""

from typing import ClassVar, Literal

import numpy as np
from pydantic import Field

from swarmwright import _engine
from swarmwright.controllers import Representation
from swarmwright.methods._base import MethodOptions
from swarmwright.methods.search import SearchMethod


class NeatOptions(MethodOptions):
    """NEAT: networks grow in species, which protect new structures. Its controllers: `kind: neat`."""

    kind: Literal["neat"] = "neat"
    population: int = Field(default=150, ge=2, le=100_000)
    """Networks in each generation."""
    disjoint: float = Field(default=1.0, ge=0, le=1000)
    """Compatibility distance: coefficient of the connections that only one of two networks has, as a share of
    the larger network's connections if these are 20 or more. The paper's c1 and c2."""
    weights: float = Field(default=0.4, ge=0, le=1000)
    """Compatibility distance: coefficient of the mean difference of weights of matching connections, c3."""
    threshold: float = Field(default=3.0, gt=0, le=1e6)
    """Largest distance from a species' representative; with `species`, at the start. Beyond 1,000 species,
    networks join the nearest one instead of founding another."""
    species: int | None = Field(default=None, ge=1, le=1000)
    """Number of species towards which the threshold is adapted, by 0.3 in each generation. Default: none."""
    survival: float = Field(default=0.2, ge=0, le=1)
    """Share of a species, its best, that may be parents."""
    stagnation: int = Field(default=15, ge=1, le=1_000_000_000)
    """Generations without progress after which a species has no children, unless it is the best."""
    mutate_only: float = Field(default=0.25, ge=0, le=1)
    """Share of children with one parent; all others are crossed, and mutated too."""
    interspecies: float = Field(default=0.001, ge=0, le=1)
    """Probability that the second parent is the best of any species."""
    mutate_weights: float = Field(default=0.8, ge=0, le=1)
    """Probability that the weights of a child are mutated."""
    mutate_each: float = Field(default=0.7, ge=0, le=1)
    """Probability that such a mutation changes a weight; one time in ten, it starts from 0."""
    severity: float = Field(default=2.5, ge=0, le=1000)
    """Largest change of a weight, relative to `weight_range`."""


class Neat(SearchMethod):
    """NEAT (NeuroEvolution of Augmenting Topologies), which evolves weights and structure of networks.

    Networks start without hidden nodes, and mutations add nodes and connections, see `GrowingNeat`. Each
    network belongs to the first species whose representative, a random member of the last generation, is
    compatible. The number of a species' children is proportional to the mean of its members' fitness, minus
    the lowest fitness of all if that is negative. The best network of a species with more than five is copied
    unchanged; others are children of the best.

    Source: Stanley and Miikkulainen, "Evolving neural networks through augmenting topologies", Evolutionary
    Computation 10(2), 2002, whose values are the defaults. Differences: innovation numbers identify a
    structure in the whole run, not in a generation. A mutation changes 70 % of the weights, as the authors'
    code does in half of the cases, and the largest weight is eight times `weight_range`, as in their later
    code; small networks mostly split their oldest connections, as in both. Stagnation of all species has no
    effect: to reduce them to two made one in twelve runs on XOR fail. Fitness may be negative.
    """

    kind: ClassVar[str] = "neat"
    options_model = NeatOptions
    options: NeatOptions
    start_as = "members"

    @classmethod
    def unsuitable(cls, representation: Representation) -> str | None:
        """Refuse all but growing networks."""
        if isinstance(representation.operators, _engine.GrowingNetwork):
            return None
        return "it evolves networks that grow; use controller: {kind: neat} without sources"

    @property
    def budget(self) -> int:
        """Number of evaluations of the whole run."""
        return self.options.population * self.options.generations

    def _begin(self) -> _engine.Search:
        options, operators = self.options, self.representation.operators
        assert isinstance(operators, _engine.GrowingNetwork)
        return _engine.Search.neat(
            self.seed,
            self.kind,
            first=np.ascontiguousarray(self.initials(range(options.population)), dtype=np.float32),
            operators=operators,
            compatibility=(options.disjoint, options.weights),
            threshold=options.threshold,
            species=options.species,
            survival=options.survival,
            stagnation=options.stagnation,
            mutate_only=options.mutate_only,
            interspecies=options.interspecies,
            weights=(options.mutate_weights, options.mutate_each, options.severity),
        )
