"""OpenAI's evolution strategy: a gradient from antithetic samples, for large networks."""

from typing import ClassVar, Literal

from pydantic import Field

from swarmwright import _engine
from swarmwright.controllers import Representation
from swarmwright.methods._base import MethodOptions
from swarmwright.methods._gaussian import Pairs


class OpenaiEsOptions(MethodOptions):
    """The evolution strategy of Salimans et al. with defaults for small networks.

    Sizes are shares of half the initial range of a gene.
    """

    kind: Literal["openai_es"] = "openai_es"
    population: int = Field(default=20, ge=2, le=10_000_000, multiple_of=2)
    """Genomes in each generation: pairs on opposite sides of the center, so an even number."""
    noise: float = Field(default=0.07, gt=0, le=1000)
    """Standard deviation of the genomes around the center."""
    step: float = Field(default=0.03, gt=0, le=1000)
    """Step size of Adam, which moves the center."""
    decay: float = Field(default=0.005, ge=0, le=1)
    """Weight decay: pulls genes towards the middle of their initial range."""


class OpenaiEs(Pairs):
    """A center moves along a gradient that is estimated from the ranks of samples around it.

    For every pair of a generation a normally distributed direction is drawn, and the center plus and minus
    `noise` times it are evaluated: candidates 2 i and 2 i + 1. Fitness becomes its rank, from -0.5 to 0.5.
    The sum of the directions, each times the difference of its pair's ranks, less the decay, is what Adam
    climbs. It starts from the middle of the initial range, as evosax does.

    Source: Salimans, Ho, Chen, Sidor and Sutskever, "Evolution strategies as a scalable alternative to
    reinforcement learning", 2017 (arXiv:1703.03864), and Kingma and Ba, "Adam", ICLR 2015. It differs in
    three points. Equal fitness has an equal rank, so a plateau does not move the center. Failed candidates
    share the lowest rank, and a generation that failed as a whole does not move the center. And sizes are
    relative to the initial range of each gene, so that weights, biases and bounded parameters need no
    settings of their own; genes with bounds are cut to them.
    """

    kind: ClassVar[str] = "openai_es"
    options_model = OpenaiEsOptions
    options: OpenaiEsOptions

    def __init__(self, options: OpenaiEsOptions, representation: Representation, *, seed: int) -> None:
        super().__init__(options, representation, seed=seed)
        self.population = options.population

    def _begin(self) -> _engine.Search:
        return self._pairs(self.options.noise, self.options.step, [self.options.decay])
