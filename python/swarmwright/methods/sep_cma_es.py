"""Separable CMA-ES: a step size for each gene."""

from typing import ClassVar, Literal

from swarmwright.methods._cma import Cma, CmaOptions


class SepCmaEsOptions(CmaOptions):
    """Separable CMA-ES with the defaults of the library `cma`; cheap for very many genes."""

    kind: Literal["sep_cma_es"] = "sep_cma_es"


class SepCmaEs(Cma):
    """CMA-ES with a diagonal covariance matrix, whose time and memory grow linearly with the genes.

    Source: Ros and Hansen, "A simple modification in CMA-ES achieving linear time and space complexity",
    PPSN 2008; constants of the library `cma` 4.5 with its option CMA_diagonal, where variances change by
    exponential functions.
    """

    kind: ClassVar[str] = "sep_cma_es"
    options_model = SepCmaEsOptions
    diagonal = True
