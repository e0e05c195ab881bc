"""Whether candidates keep their order from one simulation to another."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

_FEWEST_CANDIDATES = 4
"""Candidates from which on there is an interval of a rank correlation."""
_Z = 1.959963984540054
"""Of the standard normal distribution, 95 % are within +-_Z."""


@dataclass(frozen=True)
class Correlation:
    """Spearman's rank correlation of candidates' mean fitness in two simulations, -1 to 1."""

    rho: float
    low: float | None
    """Lower end of the 95 % confidence interval, after Bonett and Wright (2000), doi:10.1007/BF02294183; None
    below four candidates. A correlation of 1 or -1 has the interval of the next one that as many candidates
    without ties can have, extended to 1 or -1."""
    high: float | None
    """Its upper end."""
    candidates: int


def rank_correlation(source: Sequence[float], target: Sequence[float]) -> Correlation | None:
    """Return the rank correlation; None where fewer than three candidates, or none, differ."""
    pairs = [(a, b) for a, b in zip(source, target, strict=True) if math.isfinite(a) and math.isfinite(b)]
    if len(pairs) < 3:
        return None
    one, other = (doubled_midranks(np.array(values)) for values in zip(*pairs, strict=True))
    if np.ptp(one) == 0 or np.ptp(other) == 0:
        return None
    rho = float(np.clip(np.corrcoef(one, other)[0, 1], -1, 1))
    if len(pairs) < _FEWEST_CANDIDATES:
        return Correlation(rho, None, None, len(pairs))
    count = len(pairs)
    # At 1 the interval would be a point, as if few candidates in the same order proved that all are.
    largest = 1 - 12 / (count**3 - count)
    used = min(max(rho, -largest), largest)
    reach = _Z * math.sqrt((1 + used**2 / 2) / (count - 3))
    low, high = (math.tanh(math.atanh(used) + side) for side in (-reach, reach))
    return Correlation(rho, min(low, rho), max(high, rho), count)


def doubled_midranks(values: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return twice the rank of each value, from 1; equal ones share the mean of theirs."""
    ordered = np.sort(values)
    low = np.searchsorted(ordered, values, side="left")
    high = np.searchsorted(ordered, values, side="right")
    return (low + high + 1).astype(np.int64)
