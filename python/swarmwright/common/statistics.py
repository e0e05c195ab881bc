"""Figures of a generation, computed the same way on every machine."""

import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from swarmwright import _engine
from swarmwright.common.arrays import Fitness


@dataclass(frozen=True, kw_only=True)
class Summary:
    """Statistics of the population after a generation."""

    generation: int
    evaluations: int
    """Candidates evaluated since the start of the run."""
    best: float
    """Best fitness in the population; NaN when all failed."""
    mean: float
    """Mean fitness of the population, failed members left out."""
    best_so_far: float
    """Best fitness since the start of the run."""
    lower_quartile: float
    median: float
    upper_quartile: float
    failed: int
    """Candidates of this generation whose evaluation failed: in at least one episode."""


Figures = tuple[float, float, float, float, float]
"""Best, mean, lower quartile, median and upper quartile of fitness, failed members left out; NaN of none."""


def figures_of(population: Fitness) -> Figures:
    """Return the figures of a population's fitness; NaN: it has failed."""
    return _engine.figures(population)


def summarize(
    figures: Figures, *, generation: int, evaluations: int, best_so_far: float, failed: int
) -> Summary:
    """Return the summary of a generation whose population has these figures."""
    best, mean, lower_quartile, median, upper_quartile = figures
    return Summary(
        generation=generation,
        evaluations=evaluations,
        best=best,
        mean=mean,
        best_so_far=best_so_far,
        lower_quartile=lower_quartile,
        median=median,
        upper_quartile=upper_quartile,
        failed=failed,
    )


def mean(values: Sequence[float]) -> float:
    """Return the mean of finite values, whose exact sum is rounded once; NaN of none."""
    try:
        return math.fsum(values) / len(values) if values else math.nan
    except OverflowError:  # the sum is too large, the mean is not: penalties may be the largest number
        scaled = math.fsum(value * _SCALE for value in values) / len(values)
        # Rounding may lead out of the values, whose largest may be the largest number.
        return min(max(scaled, min(values) * _SCALE), max(values) * _SCALE) / _SCALE


def means(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the means over episodes, as `mean`: (n, e, k) to (n, k).

    Episodes without a value, NaN, are left out; NaN where all are, and where a value is infinite: a finite
    mean of the others would make a candidate better than it is.
    """
    if values.shape[1] == 1:
        return np.where(np.isfinite(values[:, 0]), values[:, 0], np.nan)
    rows = values.transpose(0, 2, 1)
    found = [[_finite_mean(of) for of in row] for row in rows.tolist()]
    return np.array(found, dtype=np.float64).reshape(rows.shape[:2])


def _finite_mean(values: list[float]) -> float:
    known = [value for value in values if not math.isnan(value)]
    return mean(known) if all(map(math.isfinite, known)) else math.nan


_SCALE = 2.0**-64
"""A power of two, exact as a factor, with which sums of any values are finite."""


def quantile(ordered: Sequence[float], share: float) -> float:
    """Return the quantile of ascending values, interpolated between neighbours; NaN of none."""
    if not ordered:
        return math.nan
    low, high, part = neighbours(len(ordered), share)
    return ordered[low] * (1 - part) + ordered[high] * part


def neighbours(count: int, share: float) -> tuple[int, int, float]:
    """Return which two of ascending values a quantile is between, and how far from the first: 0 to below 1.

    Definition 7 of Hyndman and Fan 1996. count: of the values, at least 1.
    """
    position = share * (count - 1)
    low = math.floor(position)
    return low, min(low + 1, count - 1), position - low


@dataclass(frozen=True)
class Estimate:
    """The mean of a sample, and how far it can be trusted. NaN or None where there are too few values."""

    mean: float
    standard_deviation: float | None
    """Of the sample, with n - 1; None below two values."""
    standard_error: float | None
    """Of the mean."""
    low: float | None
    """Lower end of the 95 % confidence interval of the mean, by Student's t; wider for one of several."""
    high: float | None
    """Its upper end."""


def estimate(values: Sequence[float], *, of: int = 1) -> Estimate:
    """Return the mean of independent values with Student's 95 % confidence interval.

    of: so many intervals are looked at together, and contain all their means with 95 %, after Bonferroni.
    """
    count, middle = len(values), mean(values)
    if count < 2 or not math.isfinite(middle):
        return Estimate(middle, None, None, None, None)
    try:
        deviation = math.sqrt(math.fsum((value - middle) ** 2 for value in values) / (count - 1))
    except OverflowError:  # the squares are too large, the deviation may not be
        scale = max(map(abs, values))
        apart = [value / scale - middle / scale for value in values]
        deviation = scale * math.sqrt(math.fsum(distance**2 for distance in apart) / (count - 1))
        if not math.isfinite(deviation):
            return Estimate(middle, None, None, None, None)
    error = deviation / math.sqrt(count)
    reach = student_t(count - 1, of) * error
    # Fitness is finite, so an end that is too large for a number is the largest one.
    low, high = max(middle - reach, -sys.float_info.max), min(middle + reach, sys.float_info.max)
    return Estimate(middle, deviation, error, low, high)


_Z = 1.959963984540054
"""Of the standard normal distribution, 95 % are within +-_Z."""
_EXPANSION_FREEDOM = 1000
"""Degrees of freedom from which the expansion is exact to 14 digits."""


@cache
def student_t(freedom: int, of: int = 1) -> float:
    """Return t for which 95 % of Student's distribution are within +-t; freedom: from 1 on.

    of: what is outside is divided by it. To 13 digits for 1, else to 10. SciPy, which has it too, takes
    longer to import than most runs take to end.
    """
    share = 1 - 0.05 / of
    if freedom == 1:
        return math.tan(math.pi * share / 2)
    if freedom == 2:
        return share * math.sqrt(2 / (1 - share**2))
    # Abramowitz and Stegun, Handbook of Mathematical Functions, 26.7.5.
    z = _Z if of == 1 else _normal(share)
    squared = z * z
    found = (
        z
        + z * (squared + 1) / 4 / freedom
        + z * ((5 * squared + 16) * squared + 3) / 96 / freedom**2
        + z * (((3 * squared + 19) * squared + 17) * squared - 15) / 384 / freedom**3
        + z
        * ((((79 * squared + 776) * squared + 1482) * squared - 1920) * squared - 945)
        / 92160
        / freedom**4
    )
    if freedom >= _EXPANSION_FREEDOM:
        return found
    density = math.exp(math.lgamma((freedom + 1) / 2) - math.lgamma(freedom / 2))
    density /= math.sqrt(freedom * math.pi)
    for _ in range(5 if of == 1 else 50):  # Newton's method, which doubles the digits each time
        slope = 2 * density * (1 + found * found / freedom) ** (-(freedom + 1) / 2)
        step = (_central_probability(found, freedom) - share) / slope
        found -= step
        if abs(step) <= 1e-13 * found:
            break
    return found


def _normal(share: float) -> float:
    """Return z for which a share of the standard normal distribution is within +-z."""
    from statistics import NormalDist  # noqa: PLC0415 - for the few who need it

    return NormalDist().inv_cdf((1 + share) / 2)


def _central_probability(t: float, freedom: int) -> float:
    """Return the share of Student's distribution within +-t; Abramowitz and Stegun 26.7.3 and 26.7.4."""
    angle = math.atan2(t, math.sqrt(freedom))
    sine, cosine = math.sin(angle), math.cos(angle)
    odd = freedom % 2
    term = cosine if odd else 1.0
    terms = [term]
    for power in range(2 + odd, freedom - 1, 2):
        term *= cosine * cosine * (power - 1) / power
        terms.append(term)
    total = sine * math.fsum(terms)
    return 2 / math.pi * (angle + total) if odd else total


_FEWEST_CANDIDATES = 4
"""Candidates from which on there is an interval of a rank correlation."""
_CORRELATION_Z = 1.959963984540054
"""Of the standard normal distribution, 95 % are within +-_CORRELATION_Z."""


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
    one, other = (compute_doubled_midranks(np.array(values)) for values in zip(*pairs, strict=True))
    if np.ptp(one) == 0 or np.ptp(other) == 0:
        return None
    rho = float(np.clip(np.corrcoef(one, other)[0, 1], -1, 1))
    if len(pairs) < _FEWEST_CANDIDATES:
        return Correlation(rho, None, None, len(pairs))
    count = len(pairs)
    # At 1 the interval would be a point, as if few candidates in the same order proved that all are.
    largest = 1 - 12 / (count**3 - count)
    used = min(max(rho, -largest), largest)
    reach = _CORRELATION_Z * math.sqrt((1 + used**2 / 2) / (count - 3))
    low, high = (math.tanh(math.atanh(used) + side) for side in (-reach, reach))
    return Correlation(rho, min(low, rho), max(high, rho), count)


def compute_doubled_midranks(values: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return twice the rank of each value, from 1; equal ones share the mean of theirs."""
    ordered = np.sort(values)
    low = np.searchsorted(ordered, values, side="left")
    high = np.searchsorted(ordered, values, side="right")
    return (low + high + 1).astype(np.int64)
