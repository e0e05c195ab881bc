"""PGPE: policy gradients with parameter-based exploration."""

from typing import ClassVar, Literal

from pydantic import Field

from swarmwright import _engine
from swarmwright.controllers import Representation
from swarmwright.methods._base import MethodOptions
from swarmwright.methods._gaussian import Pairs


class PgpeOptions(MethodOptions):
    """Policy gradients with parameter-based exploration; sizes are shares of half a gene's initial range."""

    kind: Literal["pgpe"] = "pgpe"
    population: int = Field(default=20, ge=2, le=10_000_000, multiple_of=2)
    """Genomes in each generation, an even number, as they are pairs around the center."""
    noise: float = Field(default=0.07, gt=0, le=1000)
    """Initial standard deviation of the genomes around the center."""
    step: float = Field(default=0.03, gt=0, le=1000)
    """Step size of Adam, which moves the center."""
    rate: float = Field(default=0.1, ge=0, le=10)
    """Learning rate of the standard deviations."""
    change: float = Field(default=0.2, gt=0, lt=1)
    """Maximum relative change of a standard deviation per generation."""


class Pgpe(Pairs):
    """A gradient of the expected fitness, for the center and for the standard deviation of each gene.

    Unlike `openai_es`, the noise of each gene is learned. Fitness is replaced by its rank, from -0.5 to 0.5.
    The rank difference of a pair moves the center; their mean adapts the noise.

    Source: Sehnke et al., "Parameter-exploring policy gradients", Neural Networks 23, 2010, with symmetric
    sampling (section 4.3); Adam and the limit of the change as in Ha, "Evolving stable strategies", 2017, and
    in pgpelib. Ranks have mean 0, which replaces the source's baseline. Equal fitness has equal ranks, failed
    candidates share the lowest, and a generation that failed completely changes nothing.
    """

    kind: ClassVar[str] = "pgpe"
    options_model = PgpeOptions
    options: PgpeOptions

    def __init__(self, options: PgpeOptions, representation: Representation, *, seed: int) -> None:
        super().__init__(options, representation, seed=seed)
        self.population = options.population

    def _begin(self) -> _engine.Search:
        return self._pairs(self.options.noise, self.options.step, [self.options.rate, self.options.change])
