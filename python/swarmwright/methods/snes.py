"""SNES: separable natural evolution strategy."""

import math
from typing import ClassVar, Literal

from swarmwright.methods._gaussian import logarithm
from swarmwright.methods._nes import Nes, NesOptions


class SnesOptions(NesOptions):
    """Separable natural evolution strategy, with the learning rates of its paper."""

    kind: Literal["snes"] = "snes"


class Snes(Nes):
    """A natural evolution strategy with a standard deviation for each gene.

    Memory and time grow linearly with the number of genes, so it suits large networks.

    Source: Wierstra, Schaul, Glasmachers, Sun, Peters and Schmidhuber, "Natural evolution strategies",
    Journal of Machine Learning Research 15, 2014, algorithm 6; `ipop` as in Auger and Hansen, "A restart
    CMA evolution strategy with increasing population size", CEC 2005.
    """

    kind: ClassVar[str] = "snes"
    options_model = SnesOptions
    options: SnesOptions
    separable = True

    @staticmethod
    def _default_rate(genes: int) -> float:
        return (3 + logarithm(genes)) / (5 * math.sqrt(genes))
