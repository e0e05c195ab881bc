"""Simulated binary crossover and polynomial mutation of numeric genes."""

import numpy as np
from numpy.typing import NDArray

from swarmwright import _engine
from swarmwright.common.arrays import Genomes
from swarmwright.common.random_numbers import Streams
from swarmwright.controllers import Representation
from swarmwright.methods._numbers import center_and_reach, limits
from swarmwright.methods.archive import Values


def cross(
    mothers: Genomes,
    fathers: Genomes,
    streams: Streams,
    representation: Representation,
    index: float,
    *,
    second: NDArray[np.bool_],
) -> Genomes:
    """Return a child of each mother by simulated binary crossover, (n, genome_size), within the bounds.

    Half of the genes are crossed, and come from near either parent; the others are the mother's.

    Source: Deb and Agrawal, "Simulated binary crossover for continuous search space", Complex Systems 9(2),
    1995, with bounds as in the code of NSGA-II and in pymoo.

    Args:
        mothers: (n, genome_size).
        fathers: (n, genome_size).
        streams: n streams.
        representation: of the genomes, with numeric genes.
        index: distribution index; the larger, the closer children are to parents.
        second: whether each is the second child of a pair, (n,), whose crossed genes come from near the other
            parent than those of the first, with the same stream and parents in the other order.
    """
    count, genes = mothers.shape
    drawn = streams.units(3 * genes).reshape(count, 3, genes)
    first, other = mothers.astype(np.float64), fathers.astype(np.float64)
    low, high = np.minimum(first, other), np.maximum(first, other)
    lower, upper = representation.bounds
    is_crossed = (drawn[:, 0] < 0.5) & (high > low)
    width = np.where(is_crossed, high - low, 1.0)
    takes_low = (drawn[:, 1] < 0.5) ^ second[:, np.newaxis]
    margin = np.where(takes_low, low - lower, upper - high)
    alpha = 2.0 - _power(1.0 + 2.0 * np.maximum(margin, 0.0) / width, -(index + 1.0))
    share = drawn[:, 2] * alpha
    spread = _power(np.where(share <= 1.0, share, 1.0 / (2.0 - share)), 1.0 / (index + 1.0))
    middle = low / 2 + high / 2
    children = np.where(takes_low, middle - spread * width / 2, middle + spread * width / 2)
    return _limit(np.where(is_crossed, children, first), representation)


def mutate(genomes: Genomes, streams: Streams, representation: Representation, index: float) -> Genomes:
    """Return mutants by polynomial mutation, (n, genome_size), within the bounds.

    A gene changes with a probability of 1 / genome_size, at most 1/2. Genes without bounds change on the
    scale of their initial range.

    Source: Deb and Goyal, "A combined genetic adaptive search (GeneAS) for engineering design", Computer
    Science and Informatics 26(4), 1996, with bounds as in the code of NSGA-II and in pymoo.

    Args:
        genomes: (n, genome_size).
        streams: n streams.
        representation: of the genomes, with numeric genes.
        index: distribution index; the larger, the smaller changes are.
    """
    count, genes = genomes.shape
    drawn = streams.units(2 * genes).reshape(count, 2, genes)
    values = genomes.astype(np.float64)
    lower, upper = representation.bounds
    has_bounds = np.isfinite(upper - lower)
    _, reach = center_and_reach(representation)
    width = np.where(has_bounds, upper - lower, 2 * reach)
    falls = drawn[:, 1] < 0.5
    share = np.where(falls, drawn[:, 1], 1.0 - drawn[:, 1])
    distance = np.where(falls, values - lower, upper - values) / np.where(width > 0, width, 1.0)
    rest = _power(np.where(has_bounds, np.clip(1.0 - distance, 0.0, 1.0), 0.0), index + 1.0)
    change = width * (1.0 - _power(2.0 * share + (1.0 - 2.0 * share) * rest, 1.0 / (index + 1.0)))
    changed = np.where(falls, values - change, values + change)
    return _limit(np.where(drawn[:, 0] < min(1 / genes, 0.5), changed, values), representation)


def _power(base: Values, exponent: float) -> Values:
    """Return a power of values of at least 0, the same bits on every machine."""
    logarithms = _engine.log(np.ascontiguousarray(base).ravel())
    return _engine.exp(exponent * logarithms).reshape(base.shape)


def _limit(values: NDArray[np.float64], representation: Representation) -> Genomes:
    lower, upper = limits(representation)
    return np.clip(values, lower, upper).astype(np.float32)
