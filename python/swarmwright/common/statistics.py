"""Statistics, computed identically on every machine."""

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
    """Best fitness in the population; NaN if all failed."""
    mean: float
    """Mean fitness of the population without failed members."""
    best_so_far: float
    """Best fitness since the start of the run."""
    lower_quartile: float
    median: float
    upper_quartile: float
    failed: int
    """Candidates of this generation whose evaluation failed: in at least one episode."""


Figures = tuple[float, float, float, float, float]
"""Best, mean, lower quartile, median, upper quartile of fitness without failed members; NaN if all failed."""


def figures_of(population: Fitness) -> Figures:
    """Return the statistics of a population's fitness, in which NaN marks failures."""
    return _engine.figures(population)


def summarize(
    figures: Figures, *, generation: int, evaluations: int, best_so_far: float, failed: int
) -> Summary:
    """Return the summary of a generation with these statistics."""
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
    """Return the mean of finite values, whose exact sum is rounded once; NaN without values."""
    try:
        return math.fsum(values) / len(values) if values else math.nan
    except OverflowError:  # penalties may be the largest number: their sum overflows, the mean does not
        scaled = math.fsum(value * _SCALE for value in values) / len(values)
        # Rounding must not exceed the values, which may be the largest number.
        return min(max(scaled, min(values) * _SCALE), max(values) * _SCALE) / _SCALE


def means(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the means over episodes by `mean`: (n, e, k) to (n, k).

    Episodes without a value (NaN) are ignored. The mean is NaN if all values are NaN, or if one is infinite:
    a finite mean of the others would be too good.
    """
    if values.shape[1] == 1:
        return np.where(np.isfinite(values[:, 0]), values[:, 0], np.nan)
    rows = values.transpose(0, 2, 1)
    rows_of_means = [[_finite_mean(episodes) for episodes in row] for row in rows.tolist()]
    return np.array(rows_of_means, dtype=np.float64).reshape(rows.shape[:2])


def _finite_mean(values: list[float]) -> float:
    present = [value for value in values if not math.isnan(value)]
    return mean(present) if all(map(math.isfinite, present)) else math.nan


_SCALE = 2.0**-64
"""An exact factor, a power of two, that makes sums of any values finite."""


def quantile(ordered: Sequence[float], share: float) -> float:
    """Return the quantile of ascending values, interpolated between neighbours; NaN without values."""
    if not ordered:
        return math.nan
    low, high, part = neighbours(len(ordered), share)
    return ordered[low] * (1 - part) + ordered[high] * part


def neighbours(count: int, share: float) -> tuple[int, int, float]:
    """Return the indices of the values around a quantile, and its distance from the first, 0 to below 1.

    Definition 7 of Hyndman and Fan 1996. count: number of ascending values, at least 1.
    """
    position = share * (count - 1)
    low = math.floor(position)
    return low, min(low + 1, count - 1), position - low


@dataclass(frozen=True)
class Estimate:
    """The mean of a sample and its uncertainty; NaN or None with too few values."""

    mean: float
    standard_deviation: float | None
    """Standard deviation of the sample, with n - 1; None below two values."""
    standard_error: float | None
    """Standard error of the mean."""
    low: float | None
    """Lower end of the 95 % confidence interval of the mean (Student's t, corrected for comparisons)."""
    high: float | None
    """Upper end of the interval."""


def estimate(values: Sequence[float], *, comparisons: int = 1) -> Estimate:
    """Return the mean of independent values with Student's 95 % confidence interval.

    comparisons: number of intervals that together contain all their means with 95 %, after Bonferroni.
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
    reach = student_t(count - 1, comparisons) * error
    # Fitness is finite, so an end that overflows is the largest number.
    low, high = max(middle - reach, -sys.float_info.max), min(middle + reach, sys.float_info.max)
    return Estimate(middle, deviation, error, low, high)


def proportion_interval(successes: int, count: int) -> tuple[float, float]:
    """Return the 95 % confidence interval of a proportion; (0, 1) without observations.

    Source: Wilson, "Probable inference, the law of succession, and statistical inference", Journal of the
    American Statistical Association 22, 1927.
    """
    if not count:
        return 0.0, 1.0
    share, square = successes / count, _Z * _Z / count
    middle = (share + square / 2) / (1 + square)
    reach = math.sqrt(share * (1 - share) * square + square * square / 4) / (1 + square)
    return max(middle - reach, 0.0), min(middle + reach, 1.0)


_Z = 1.959963984540054
"""95 % of the standard normal distribution are within +-_Z."""
_EXPANSION_FREEDOM = 1000
"""Degrees of freedom from which the expansion is exact to 14 digits."""


@cache
def student_t(freedom: int, comparisons: int = 1) -> float:
    """Return t for which 95 % of Student's distribution are within +-t; freedom: at least 1.

    comparisons: divides the probability outside of the interval. The result has 13 digits for 1, else 10.
    SciPy has this function, too, but takes longer to import than most runs last.
    """
    share = 1 - 0.05 / comparisons
    if freedom == 1:
        return math.tan(math.pi * share / 2)
    if freedom == 2:
        return share * math.sqrt(2 / (1 - share**2))
    # Abramowitz and Stegun, Handbook of Mathematical Functions, 26.7.5.
    z = _Z if comparisons == 1 else _normal(share)
    squared = z * z
    t = (
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
        return t
    density = math.exp(math.lgamma((freedom + 1) / 2) - math.lgamma(freedom / 2))
    density /= math.sqrt(freedom * math.pi)
    for _ in range(5 if comparisons == 1 else 50):  # Newton's method, which doubles the digits each time
        slope = 2 * density * (1 + t * t / freedom) ** (-(freedom + 1) / 2)
        step = (_central_probability(t, freedom) - share) / slope
        t -= step
        if abs(step) <= 1e-13 * t:
            break
    return t


def _normal(share: float) -> float:
    """Return z for which a share of the standard normal distribution is within +-z."""
    from statistics import NormalDist  # noqa: PLC0415 - rarely needed

    return NormalDist().inv_cdf((1 + share) / 2)


def _central_probability(t: float, freedom: int) -> float:
    """Return the probability of +-t in Student's distribution; Abramowitz and Stegun 26.7.3 and 26.7.4."""
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
"""Smallest number of candidates for an interval of a rank correlation."""


@dataclass(frozen=True)
class Correlation:
    """Spearman's rank correlation of candidates' mean fitness in two simulations, -1 to 1."""

    rho: float
    low: float | None
    """Lower end of the 95 % confidence interval, after Bonett and Wright (2000), doi:10.1007/BF02294183; None
    below four candidates. A correlation of 1 or -1 gets the interval of the next possible value without ties,
    extended to 1 or -1."""
    high: float | None
    """Upper end of the interval."""
    candidates: int


def rank_correlation(source: Sequence[float], target: Sequence[float]) -> Correlation | None:
    """Return the rank correlation; None with fewer than three candidates, or if all are equal."""
    pairs = [(a, b) for a, b in zip(source, target, strict=True) if math.isfinite(a) and math.isfinite(b)]
    if len(pairs) < 3:
        return None
    source_ranks, target_ranks = (
        compute_doubled_midranks(np.array(values)) for values in zip(*pairs, strict=True)
    )
    if np.ptp(source_ranks) == 0 or np.ptp(target_ranks) == 0:
        return None
    rho = float(np.clip(np.corrcoef(source_ranks, target_ranks)[0, 1], -1, 1))
    if len(pairs) < _FEWEST_CANDIDATES:
        return Correlation(rho, None, None, len(pairs))
    count = len(pairs)
    # At 1 the interval would be a point, as if few candidates in the same order were proof.
    largest = 1 - 12 / (count**3 - count)
    used = min(max(rho, -largest), largest)
    reach = _Z * math.sqrt((1 + used**2 / 2) / (count - 3))
    low, high = (math.tanh(math.atanh(used) + side) for side in (-reach, reach))
    return Correlation(rho, min(low, rho), max(high, rho), count)


def compute_doubled_midranks(values: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return twice the rank of each value, from 1; ties share their mean rank."""
    ordered = np.sort(values)
    low = np.searchsorted(ordered, values, side="left")
    high = np.searchsorted(ordered, values, side="right")
    return (low + high + 1).astype(np.int64)
