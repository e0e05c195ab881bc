"""What methods share that compute with genes."""

import numpy as np
from numpy.typing import NDArray

from swarmwright.controllers import Representation
from swarmwright.controllers.kinds.team import Team

_LARGEST_GENE = float(np.finfo(np.float32).max)


def limits(representation: Representation) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the least and the largest value of each gene, (genome_size,) each, finite."""
    lower, upper = representation.bounds
    return np.maximum(lower, -_LARGEST_GENE), np.minimum(upper, _LARGEST_GENE)


def center_and_reach(representation: Representation) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the middle of each gene's initial range, and half of its width."""
    lower, upper = representation.initial_range
    return lower / 2 + upper / 2, upper / 2 - lower / 2


def discrete(representation: Representation) -> str | None:
    """Return why methods that add and scale genes refuse a representation; None where it is continuous."""
    if representation.continuous:
        return None
    whose = "its genes"
    if isinstance(representation, Team):
        parts = representation.parts.items()
        groups = [f"{name} ({part.kind})" for name, part in parts if not part.continuous]
        whose = f"the genes of {', '.join(groups)}"
    return (
        f"{whose} are choices, not numbers to compute with; take nnga, cea2d, racing or random_search, which "
        "leave variation to the representation"
    )


def beyond_covariance(representation: Representation, most: int, instead: str) -> str | None:
    """Return why more than `most` genes are refused, and what to take `instead`; None if they are not."""
    genes = representation.genome_size
    if genes <= most:
        return None
    return f"{genes} genes need a covariance matrix of as many rows and columns; above {most} take {instead}"
