"""Between genomes with fitness and libraries that minimize in binary64: what such methods share."""

from contextlib import AbstractContextManager
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from swarmwright.representations._base import Representation
from swarmwright.typing import Fitness, Genomes

if TYPE_CHECKING:
    from threadpoolctl import ThreadpoolController

LARGEST = 1e100
"""Up to here costs are minus the fitness; beyond, they grow with its logarithm."""
FAILED = 1e200
"""Larger than every other cost."""
_LARGEST_GENE = float(np.finfo(np.float32).max)


def costs(fitness: Fitness) -> NDArray[np.float64]:
    """Return what a minimizer is told: minus the fitness, and `FAILED` for failed candidates.

    The order is that of the fitness. Beyond +-1e100 values are drawn together, in order, so that sums,
    differences and means that a library computes stay finite: 1e300 becomes 201e100.
    """
    sizes = np.abs(fitness)
    large = sizes > LARGEST  # False for NaN
    shown = np.where(large, LARGEST, sizes)
    shown[large] += LARGEST * (np.log10(sizes[large]) - 100)
    return np.where(np.isnan(fitness), FAILED, np.copysign(shown, -fitness) + 0.0)


def costs_near(fitness: Fitness) -> NDArray[np.float64]:
    """Return `costs` with failed candidates just behind the worst of the others, of which there is one.

    For libraries that look at the spread of the costs of a generation: the next binary64 number leaves it as
    it is.
    """
    values = costs(fitness)
    failed = values == FAILED
    values[failed] = np.nextafter(values[~failed].max(), np.inf)
    return values


def rounded(points: NDArray[np.float64], representation: Representation) -> Genomes:
    """Return (n, genome_size) points as genomes: within bounds, finite, rounded to binary32."""
    # Bounds are binary32 numbers, so rounding does not leave them.
    return np.clip(points, *limits(representation)).astype(np.float32)


def limits(representation: Representation) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the least and the largest value of each gene, (genome_size,) each, finite."""
    lower, upper = representation.bounds
    return np.maximum(lower, -_LARGEST_GENE), np.minimum(upper, _LARGEST_GENE)


def center_and_reach(representation: Representation) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the middle of each gene's initial range, and half of its width."""
    lower, upper = representation.initial_range
    return lower / 2 + upper / 2, upper / 2 - lower / 2


DISCRETE = (
    "its genes are choices, not numbers to compute with; take nnga, cea2d or random_search, "
    "which leave variation to the representation"
)
"""Why methods that add and scale genes refuse a representation that is not continuous."""


def beyond_covariance(representation: Representation, most: int, instead: str) -> str | None:
    """Return why more than `most` genes are refused, and what to take `instead`; None if they are not."""
    genes = representation.genome_size
    if genes <= most:
        return None
    return f"{genes} genes need a covariance matrix of as many rows and columns; above {most} take {instead}"


def one_thread() -> AbstractContextManager[Any]:
    """Return a context in which NumPy's linear algebra runs in one thread.

    How a matrix product is split among threads changes its last bits, so a run would depend on the number of
    processors; and for matrices of this size threads cost more than they gain.
    """
    limits: AbstractContextManager[Any] = _thread_pools().limit(limits=1, user_api="blas")
    return limits


@cache
def _thread_pools() -> "ThreadpoolController":
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()
