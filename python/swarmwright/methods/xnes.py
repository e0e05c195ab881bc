"""xNES: exponential natural evolution strategy."""

import math
from typing import ClassVar, Literal

from swarmwright.controllers import Representation
from swarmwright.methods._gaussian import logarithm
from swarmwright.methods._nes import Nes, NesOptions
from swarmwright.methods._numbers import explain_too_many_genes

_MOST_GENES = 500
"""Genes for which a matrix exponential is affordable."""


class XnesOptions(NesOptions):
    """Exponential natural evolution strategy, with the learning rates of its paper, for up to 500 genes."""

    kind: Literal["xnes"] = "xnes"


class Xnes(Nes):
    """A natural evolution strategy with a full covariance matrix.

    It learns correlations of genes like `cma_es`, but without evolution paths.

    Source: Glasmachers, Schaul, Sun, Wierstra and Schmidhuber, "Exponential natural evolution strategies",
    GECCO 2010; Wierstra et al., "Natural evolution strategies", JMLR 15, 2014, algorithm 5; `ipop` as in
    Auger and Hansen, "A restart CMA evolution strategy with increasing population size", CEC 2005.
    """

    kind: ClassVar[str] = "xnes"
    options_model = XnesOptions
    options: XnesOptions
    separable = False

    @classmethod
    def unsuitable(cls, representation: Representation) -> str | None:
        """Refuse discrete representations, and genomes whose covariance matrix would be too large."""
        return explain_too_many_genes(
            representation, _MOST_GENES, "snes, sep_cma_es or openai_es"
        ) or super().unsuitable(representation)

    @staticmethod
    def _default_rate(genes: int) -> float:
        return (9 + 3 * logarithm(genes)) / (5 * genes * math.sqrt(genes))
