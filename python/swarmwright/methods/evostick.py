"""The evolutionary algorithm of EvoStick."""

from typing import ClassVar, Literal

import numpy as np
from pydantic import Field

from swarmwright import _engine
from swarmwright.controllers import Representation
from swarmwright.methods._base import MethodOptions
from swarmwright.methods._numbers import center_and_reach, explain_discrete, limits
from swarmwright.methods.search import SearchMethod


class EvostickOptions(MethodOptions):
    """EvoStick's algorithm: the best survive, and all others are their mutants."""

    kind: Literal["evostick"] = "evostick"
    population: int = Field(default=100, ge=2, le=1_000_000)
    """Genomes in each generation, including survivors."""
    elites: int = Field(default=20, ge=1, le=1_000_000)
    """Number of best genomes that survive and have mutants, limited to the population."""
    step: float = Field(default=0.2, gt=0, le=10)
    """Maximum change of a gene by a mutation, as a share of half of its initial range: 0.2 is 1 for genes
    from -5 to 5."""


class Evostick(SearchMethod):
    """EvoStick's algorithm: the best of a generation survive and are evaluated again; all others are mutants.

    Parents of mutants are drawn from the survivors. In half of the mutants, each gene is moved with
    probability 0.7 and drawn anew, around the middle of its range, with probability 0.2. In the others every
    gene is moved, except in the last fifth of a genome of 10 genes or more, where the probabilities are 0.5
    and 0.2. Both are uniform within the step, and genes are clipped to their bounds.

    Source: Francesca, Brambilla, Brutschy, Trianni and Birattari, "AutoMoDe: a novel approach to the
    automatic design of control software for robot swarms", Swarm Intelligence 8(2), 2014. Its published code
    mutates weights as Stanley and Miikkulainen, "Evolving neural networks through augmenting topologies",
    Evolutionary Computation 10(2), 2002.
    """

    kind: ClassVar[str] = "evostick"
    options_model = EvostickOptions
    options: EvostickOptions
    start_as = "members"

    @classmethod
    def unsuitable(cls, representation: Representation) -> str | None:
        """Refuse genes that are not numbers to compute with."""
        return explain_discrete(representation)

    @property
    def budget(self) -> int:
        """Number of evaluations of the whole run."""
        return self.options.population * self.options.generations

    def _begin(self) -> _engine.Search:
        options = self.options
        middle, reach = center_and_reach(self.representation)
        lower, upper = limits(self.representation)
        return _engine.Search.evostick(
            self.seed,
            self.kind,
            first=np.ascontiguousarray(self.initials(range(options.population)), dtype=np.float32),
            elites=min(options.elites, options.population),
            middle=middle,
            step=options.step * reach,
            lower=lower,
            upper=upper,
        )
