"""Helpers of methods that compute with genes."""

import numpy as np
from numpy.typing import NDArray

from swarmwright.common.arrays import Genomes, Limits
from swarmwright.controllers import Representation
from swarmwright.controllers.kinds.team import Team

_LARGEST_GENE = float(np.finfo(np.float32).max)


def limits(representation: Representation) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the least and the largest value of each gene, (genome_size,) each, finite."""
    lower, upper = representation.bounds
    return np.maximum(lower, -_LARGEST_GENE), np.minimum(upper, _LARGEST_GENE)


def center_and_reach(representation: Representation) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the middle and half of the width of each gene's initial range."""
    lower, upper = representation.initial_range
    return lower / 2 + upper / 2, upper / 2 - lower / 2


def box(representation: Representation, start: Genomes, reach: float) -> Limits:
    """Return the lowest and highest value of each gene of a search, (genome_size,) each.

    Args:
        representation: has the genes' bounds and initial range.
        start: genomes that are to be inside.
        reach: limit of genes without bounds, as a multiple of their initial range around its middle.
    """
    center, half = center_and_reach(representation)
    lower, upper = representation.bounds
    least, most = limits(representation)
    low, high = center - reach * half, center + reach * half
    if len(start):
        genes = start.astype(np.float64)
        lowest, highest = genes.min(axis=0), genes.max(axis=0)
        low = np.where(lowest < low, lowest - half, low)
        high = np.where(highest > high, highest + half, high)
    return (
        np.where(np.isfinite(lower), lower, np.clip(low, least, most)),
        np.where(np.isfinite(upper), upper, np.clip(high, least, most)),
    )


def explain_discrete(representation: Representation) -> str | None:
    """Return why numeric methods refuse a representation; None if it is continuous."""
    if representation.continuous:
        return None
    subject = "its genes"
    if isinstance(representation, Team):
        parts = representation.parts.items()
        groups = [f"{name} ({part.kind})" for name, part in parts if not part.continuous]
        subject = f"the genes of {', '.join(groups)}"
    grows = representation.kind in ("neat", "hyperneat")
    reason = "describe a structure that grows" if grows else "are choices, not numbers"
    return (
        f"{subject} {reason}; use {'neat, ' if grows else ''}nnga, cea2d, racing or random_search, which "
        "leave variation to the representation"
    )


def explain_too_many_genes(representation: Representation, most: int, instead: str) -> str | None:
    """Return why more than `most` genes are refused and what to use `instead`, or None."""
    genes = representation.genome_size
    if genes <= most:
        return None
    return f"{genes} genes are too many for a covariance matrix; above {most}, use {instead}"
