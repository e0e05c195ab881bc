"""PGPE: policy gradients with parameter-based exploration."""

from typing import ClassVar, Literal

from pydantic import Field

from swarmwright import _engine
from swarmwright.controllers import Representation
from swarmwright.methods._base import MethodOptions
from swarmwright.methods._gaussian import Pairs


class PgpeOptions(MethodOptions):
    """Policy gradients with parameter-based exploration, with symmetric samples and Adam.

    Sizes are shares of half the initial range of a gene.
    """

    kind: Literal["pgpe"] = "pgpe"
    population: int = Field(default=20, ge=2, le=10_000_000, multiple_of=2)
    """Genomes in each generation: pairs on opposite sides of the center, so an even number."""
    noise: float = Field(default=0.07, gt=0, le=1000)
    """Initial standard deviation of the genomes around the center."""
    step: float = Field(default=0.03, gt=0, le=1000)
    """Step size of Adam, which moves the center."""
    rate: float = Field(default=0.1, ge=0, le=10)
    """Learning rate of the standard deviations."""
    change: float = Field(default=0.2, gt=0, lt=1)
    """Largest change of a standard deviation in a generation, as a share of it."""


class Pgpe(Pairs):
    """A gradient of the expected fitness, for the center and for the standard deviation of each gene.

    Where `openai_es` keeps its noise, this learns how much of it each gene bears. Fitness becomes its rank,
    from -0.5 to 0.5. The difference of the ranks of a pair says where the center goes; their mean, whether
    the pair's distance from it is a good one.

    Source: Sehnke et al., "Parameter-exploring policy gradients", Neural Networks 23, 2010, with symmetric
    sampling (section 4.3); Adam and the limit of the change as in Ha, "Evolving stable strategies", 2017, and
    in pgpelib. Ranks have the mean 0, which takes the place of the source's baseline. Equal fitness has an
    equal rank, failed candidates share the lowest, and a generation that failed as a whole changes nothing.
    """

    kind: ClassVar[str] = "pgpe"
    options_model = PgpeOptions
    options: PgpeOptions

    def __init__(self, options: PgpeOptions, representation: Representation, *, seed: int) -> None:
        super().__init__(options, representation, seed=seed)
        self.population = options.population

    def _begin(self) -> _engine.Search:
        return self._pairs(self.options.noise, self.options.step, [self.options.rate, self.options.change])
