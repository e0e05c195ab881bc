"""xNES: exponential natural evolution strategy."""

import math
from typing import ClassVar, Literal

import numpy as np

from swarmwright import _engine
from swarmwright.methods._gaussian import Numbers, limited, logarithm
from swarmwright.methods._nes import Nes, NesOptions
from swarmwright.methods._numbers import beyond_covariance
from swarmwright.representations._base import Representation
from swarmwright.typing import Genomes

_LARGEST = 500


class XnesOptions(NesOptions):
    """The exponential natural evolution strategy, with the source's learning rates. For up to 500 genes."""

    kind: Literal["xnes"] = "xnes"


class Xnes(Nes):
    """The natural gradient of a normal distribution with a full covariance matrix.

    It learns which genes must change together, as `cma_es` does, but without evolution paths.

    Source: Glasmachers, Schaul, Sun, Wierstra and Schmidhuber, "Exponential natural evolution strategies",
    GECCO 2010; Wierstra et al., "Natural evolution strategies", JMLR 15, 2014, algorithm 5; `ipop` as in
    Auger and Hansen, "A restart CMA evolution strategy with increasing population size", CEC 2005.
    """

    kind: ClassVar[str] = "xnes"
    options_model = XnesOptions
    options: XnesOptions

    @classmethod
    def unsuitable(cls, representation: Representation) -> str | None:
        """Refuse discrete representations, and genomes whose covariance matrix would be too large."""
        return beyond_covariance(
            representation, _LARGEST, "snes, sep_cma_es or openai_es"
        ) or super().unsuitable(representation)

    def _begin(self) -> None:
        self._step = np.full(1, self.options.step)
        self._shape = np.eye(len(self._center))

    @staticmethod
    def _default_rate(genes: int) -> float:
        return (9 + 3 * logarithm(genes)) / (5 * genes * math.sqrt(genes))

    def _ask(self) -> Genomes:
        self._directions = self._draw()
        return self._sample(self._turned(self._directions), np.repeat(self._step, len(self._center)))

    def _turned(self, directions: Numbers) -> Numbers:
        """Return each row, (n, genome_size), times the shape of the distribution."""
        return _engine.matrix_product(directions, np.ascontiguousarray(self._shape.T))

    def _follow(self, weights: Numbers) -> None:
        toward = _engine.weighted_sum(self._directions, weights)
        self._move(self._step * self._turned(toward[np.newaxis])[0])
        # The weights add up to 0, so that the identity matrix has no part in the gradient.
        gradient = _engine.weighted_products(self._directions, weights)
        mean = math.fsum(np.diagonal(gradient)) / len(gradient)
        self._step = limited(self._step * _engine.exp(np.array([self._rate / 2 * mean])))
        turn = _engine.matrix_exponential(self._rate / 2 * (gradient - mean * np.eye(len(gradient))))
        if turn is not None:
            self._shape = _engine.matrix_product(self._shape, turn)

    def _widest(self) -> float:
        squares = [math.fsum(row * row) for row in self._shape]
        return float(self._step[0]) * math.sqrt(max(squares))
