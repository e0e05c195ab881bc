"""CMA-ES: evolution strategy with covariance matrix adaptation."""

from typing import ClassVar, Literal

from swarmwright.controllers import Representation
from swarmwright.methods._cma import Cma, CmaOptions
from swarmwright.methods._numbers import explain_too_many_genes

_MOST_GENES = 5000
"""Genes for which a covariance matrix is affordable."""


class CmaEsOptions(CmaOptions):
    """CMA-ES with the defaults of the library `cma`; learns correlations of up to 5000 genes."""

    kind: Literal["cma_es"] = "cma_es"


class CmaEs(Cma):
    """CMA-ES with a full covariance matrix, the standard for continuous search without gradients.

    Source: Hansen and Ostermeier, "Completely derandomized self-adaptation in evolution strategies",
    Evolutionary Computation 9(2), 2001; Hansen, "The CMA evolution strategy: a tutorial" (arXiv:1604.00772);
    constants, bounds and criteria for stopping of the library `cma` 4.5 (doi:10.5281/zenodo.2559634).
    """

    kind: ClassVar[str] = "cma_es"
    options_model = CmaEsOptions
    diagonal = False

    @classmethod
    def unsuitable(cls, representation: Representation) -> str | None:
        """Refuse discrete representations, and genomes whose covariance matrix would be too large."""
        return explain_too_many_genes(
            representation, _MOST_GENES, "sep_cma_es or openai_es"
        ) or super().unsuitable(representation)
