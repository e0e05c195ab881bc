"""OpenAI's evolution strategy: a gradient from antithetic samples, for large networks."""

from typing import ClassVar, Literal

from pydantic import Field

from swarmwright import _engine
from swarmwright.controllers import Representation
from swarmwright.methods._base import MethodOptions
from swarmwright.methods._gaussian import Pairs


class OpenaiEsOptions(MethodOptions):
    """Evolution strategy of Salimans et al.; sizes are shares of half a gene's initial range."""

    kind: Literal["openai_es"] = "openai_es"
    population: int = Field(default=20, ge=2, le=10_000_000, multiple_of=2)
    """Genomes in each generation, an even number, as they are pairs around the center."""
    noise: float = Field(default=0.07, gt=0, le=1000)
    """Standard deviation of the genomes around the center."""
    step: float = Field(default=0.03, gt=0, le=1000)
    """Step size of Adam, which moves the center."""
    decay: float = Field(default=0.005, ge=0, le=1)
    """Weight decay, towards the middle of the initial range."""


class OpenaiEs(Pairs):
    """An evolution strategy whose center follows a gradient estimated from the ranks of samples around it.

    For every pair of a generation, a normally distributed direction is drawn, and the center plus and minus
    `noise` times it are evaluated: candidates 2 i and 2 i + 1. Fitness is replaced by its rank, from -0.5 to
    0.5. Adam ascends the sum of the directions, weighted by the rank differences of their pairs, less the
    decay. The search starts from the middle of the initial range, as in evosax.

    Source: Salimans, Ho, Chen, Sidor and Sutskever, "Evolution strategies as a scalable alternative to
    reinforcement learning", 2017 (arXiv:1703.03864), and Kingma and Ba, "Adam", ICLR 2015, with three
    differences. Equal fitness has equal ranks, so plateaus do not move the center. Failed candidates share
    the lowest rank, and a generation that failed completely does not move the center. Sizes are relative to
    the initial range of each gene, so that weights, biases and bounded parameters need no separate settings;
    genes are clipped to their bounds.
    """

    kind: ClassVar[str] = "openai_es"
    options_model = OpenaiEsOptions
    options: OpenaiEsOptions

    def __init__(self, options: OpenaiEsOptions, representation: Representation, *, seed: int) -> None:
        super().__init__(options, representation, seed=seed)
        self.population = options.population

    def _begin(self) -> _engine.Search:
        return self._pairs(self.options.noise, self.options.step, [self.options.decay])
