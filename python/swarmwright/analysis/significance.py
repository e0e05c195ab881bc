"""Statistical tests of final fitness: distribution-free, for few runs and with ties.

Fitness of evolved controllers is far from normally distributed, and runs are few; rank-based tests are robust
(Derrac et al. 2011, doi:10.1016/j.swevo.2011.02.002; Arcuri and Briand 2014, doi:10.1002/stvr.1486). A run
without any valid fitness counts as minus infinity, worse than all others.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from swarmwright.common.statistics import compute_doubled_midranks

Values = NDArray[np.float64]

_MOST_EXACT_RUNS = 60
"""Largest number of runs in all groups together for which tests avoid asymptotic distributions."""
_CONFIDENCE = 0.95
"""Confidence level of intervals."""
FEW_RUNS = 5
"""Number of runs per group below which a test has little power."""
LEVEL = 0.05
"""Significance level: the largest p for which groups are said to differ."""
_ARRANGEMENTS = 200_000
"""Largest number of sets of rank sums for which the Kruskal-Wallis test is exact."""
_PERMUTATIONS = 100_000
"""Random arrangements from which p is estimated if there are more."""
_MOST_EXACT_PAIRS = 500
"""Largest number of nonzero differences for which the signed-rank test is exact, in less than a second."""
_CHUNK_VALUES = 1_000_000
"""Number of values of random arrangements in memory at a time."""


@dataclass(frozen=True)
class Difference:
    """Difference of the first of two groups from the second."""

    u: float
    """Mann-Whitney U of the first group: the number of pairs in which it is better; ties count as halves."""
    p: float
    """Two-sided p: probability of a U at least as far from its mean, if both groups have the same
    distribution."""
    effect: float
    """Vargha and Delaney's A12: probability that a run of the first group beats one of the second."""
    shift: float
    """Hodges-Lehmann estimate: median of all differences, first minus second."""
    interval: tuple[float, float] | None
    """95 % confidence interval of the shift; None with too few runs."""
    tied: bool
    """Whether values of one group are tied with values of the other."""

    @property
    def magnitude(self) -> str:
        """A12 in words, after Vargha and Delaney (2000), doi:10.3102/10769986025002101.

        Empty if p is above 0.05, since A12 of few runs is often far from 0.5 by chance. For several pairs,
        see the pair's `magnitude`, which takes account of their number.
        """
        return self.magnitude_at(self.p)

    def magnitude_at(self, p: float) -> str:
        """Return A12 in words; empty if p, which may be corrected for several tests, is above 0.05."""
        if p > LEVEL:
            return ""
        far = abs(self.effect - 0.5)
        for border, word in ((0.06, "negligible"), (0.14, "small"), (0.21, "medium")):
            if far < border:
                return word
        return "large"

    @property
    def contradicts(self) -> bool:
        """Whether p indicates a difference and the interval includes 0, or the reverse, because of ties.

        The test takes account of ties; the interval does not, and is then too wide.
        """
        if self.interval is None or not self.tied:
            return False
        low, high = self.interval
        return (self.p <= LEVEL) == (low <= 0 <= high)


def difference(first: Values, second: Values) -> Difference:
    """Compare two groups of values, (n,) and (m,), more is better; each has at least one value."""
    first_values, second_values = _replace_nan(first), _replace_nan(second)
    better = (first_values[:, None] > second_values[None, :]).sum() + 0.5 * (
        first_values[:, None] == second_values[None, :]
    ).sum()
    u = float(better)
    shift, interval = _shift(first_values, second_values)
    p, effect = mann_whitney(first_values, second_values, u), u / (len(first_values) * len(second_values))
    tied = len(np.unique(np.concatenate([first_values, second_values]))) < len(first_values) + len(
        second_values
    )
    return Difference(u, p, effect, shift, interval, tied)


def mann_whitney(first: Values, second: Values, u: float) -> float:
    """Return the two-sided p of the Mann-Whitney U test; exact, ties included, for up to 60 values.

    The exact distribution of rank sums is counted with the shift algorithm of Streitberg and Röhmel (1986).
    With more values, the normal approximation is used, with corrections for ties and continuity.
    """
    n, m = len(first), len(second)
    pooled = np.concatenate([first, second])
    if (pooled == pooled[0]).all():
        return 1.0
    if n + m > _MOST_EXACT_RUNS:
        from scipy.stats import mannwhitneyu

        return float(mannwhitneyu(first, second, alternative="two-sided", method="asymptotic").pvalue)
    counts = _rank_sums(compute_doubled_midranks(pooled), n)
    distance = np.abs(np.arange(len(counts)) - n * (n + m + 1))  # distance of doubled sums from their mean
    observed = abs(2 * u - n * m)
    return float(min(1.0, counts[distance >= observed - 1e-9].sum() / counts.sum()))


def _rank_sums(ranks: NDArray[np.int64], size: int) -> Values:
    """Return the number of subsets of `size` elements for each sum of ranks, from 0 on."""
    counts = np.zeros((size + 1, int(ranks.sum()) + 1))
    counts[0, 0] = 1.0
    for rank in ranks:
        # Larger subsets first, so that an element is in a subset only once.
        counts[1:, rank:] += counts[:-1, : counts.shape[1] - rank].copy()
    sums: Values = counts[size]
    return sums


def _shift(first: Values, second: Values) -> tuple[float, tuple[float, float] | None]:
    with np.errstate(over="ignore", invalid="ignore"):
        differences = first[:, None] - second[None, :]
        differences[first[:, None] == second[None, :]] = 0.0  # including infinities
    differences = np.sort(differences.ravel())
    count = len(differences)
    middle = differences[(count - 1) // 2], differences[count // 2]
    estimate = float(middle[0] if middle[0] == middle[1] else middle[0] / 2 + middle[1] / 2)
    below = _border(len(first), len(second))
    if below == 0:
        return estimate, None
    return estimate, (float(differences[below - 1]), float(differences[count - below]))


def _border(n: int, m: int) -> int:
    """Return the rank of the interval's bounds in the sorted differences, from either end; 0 for none.

    Moses' interval: the largest k for which P(U < k) is at most half of one minus the confidence level.
    """
    tail = (1 - _CONFIDENCE) / 2
    if n + m > _MOST_EXACT_RUNS:
        from scipy.stats import norm

        spread = np.sqrt(n * m * (n + m + 1) / 12)
        return max(0, int(n * m / 2 + float(norm.ppf(tail)) * spread))
    counts = _rank_sums(np.arange(1, n + m + 1, dtype=np.int64), n)[n * (n + 1) // 2 :]
    below = np.cumsum(counts) / counts.sum()
    return int(np.searchsorted(below, tail, side="right"))


@dataclass(frozen=True)
class Kruskal:
    """The Kruskal-Wallis test of all groups at once."""

    h: float
    p: float
    """Probability of at least this H, if all groups have the same distribution."""
    method: Literal["exact", "permutations", "chi-square"] = "exact"
    """How p was computed: from all arrangements of the values, from 100,000 random ones with a fixed seed, or
    by the chi-square approximation."""


def kruskal_wallis(groups: Sequence[Values]) -> Kruskal:
    """Test whether any of the groups differs.

    The chi-square distribution of H is an approximation for many runs: with four runs in each of three
    groups, its p of the clearest difference is 0.0073, while the exact one is 0.00017. Therefore, for up to
    60 runs in all groups together, p is the share of arrangements of the values, ties included, with at least
    this H: of all arrangements if these are quickly counted, otherwise of random ones with a fixed seed.
    """
    ordered = [_replace_nan(values) for values in groups]
    pooled = np.concatenate(ordered)
    if (pooled == pooled[0]).all():
        return Kruskal(0.0, 1.0)
    from scipy.stats import kruskal

    # Computed from ranks, which are finite even for infinite values.
    ranks = compute_doubled_midranks(pooled)
    sizes = np.array([len(values) for values in ordered], dtype=np.int64)
    result = kruskal(*np.split(ranks, np.cumsum(sizes)[:-1]))
    h = float(result.statistic)
    if len(pooled) > _MOST_EXACT_RUNS:
        return Kruskal(h, float(result.pvalue), "chi-square")
    # H is an increasing function of the sum of squared rank sums over sizes.
    observed = _spread(np.add.reduceat(ranks, np.cumsum(sizes) - sizes), sizes)
    # Sorted, so that the order of runs and groups changes neither p nor how it is computed.
    ranks, sizes = np.sort(ranks), np.sort(sizes)
    p = _exact(ranks, sizes, observed)
    if p is not None:
        return Kruskal(h, p)
    return Kruskal(h, _estimate_p(ranks, sizes, observed), "permutations")


def _spread(sums: NDArray[np.int64], sizes: NDArray[np.int64]) -> Values:
    """Return the sum over groups of squared rank sums over sizes, given rank sums (.., groups)."""
    spread: Values = (sums.astype(np.float64) ** 2 / sizes).sum(axis=-1)
    return spread


def _exact(ranks: NDArray[np.int64], sizes: NDArray[np.int64], observed: Values) -> float | None:
    """Return the share of arrangements that are at least as extreme; None if counting them takes too long.

    Elements are added one by one. Arrangements with the same group sizes and rank sums are counted together
    under a number whose digits encode these; those of the last group follow from the others.
    """
    others = len(sizes) - 1
    bases = [*(int(size) + 1 for size in sizes[:others]), *[int(ranks.sum()) + 1] * others]
    if math.prod(bases) > np.iinfo(np.int64).max:
        return None
    units = np.array([math.prod(bases[:index]) for index in range(len(bases))], dtype=np.int64)
    states = np.zeros(1, dtype=np.int64)
    counts: Values = np.ones(1)
    for number, rank in enumerate(ranks):
        elements = [states // units[group] % bases[group] for group in range(others)]
        free = [element < size for element, size in zip(elements, sizes, strict=False)]
        free.append(number - sum(elements) < sizes[-1])
        steps = [*(units[:others] + rank * units[others:]), 0]
        grown = np.concatenate([states[able] + step for able, step in zip(free, steps, strict=True)])
        weights = np.concatenate([counts[able] for able in free])
        states, indices = np.unique(grown, return_inverse=True)
        if len(states) > _ARRANGEMENTS:
            return None
        counts = np.bincount(indices.ravel(), weights).astype(np.float64)
    sums = np.stack([states // units[others + group] % bases[others + group] for group in range(others)], 1)
    sums = np.column_stack([sums, ranks.sum() - sums.sum(axis=1)])
    extreme = _spread(sums, sizes) >= observed * (1 - 1e-12)
    return float(counts[extreme].sum() / counts.sum())


def _estimate_p(ranks: NDArray[np.int64], sizes: NDArray[np.int64], observed: Values) -> float:
    """Return the share of random arrangements that are at least as extreme, counting the observed one."""
    random = np.random.default_rng(0)
    starts = np.cumsum(sizes) - sizes
    extreme, remaining = 1, _PERMUTATIONS
    while remaining:
        rows = min(remaining, max(1, _CHUNK_VALUES // len(ranks)))
        arranged = random.permuted(np.tile(ranks, (rows, 1)), axis=1)
        sums = np.add.reduceat(arranged, starts, axis=1)
        extreme += int((_spread(sums, sizes) >= observed * (1 - 1e-12)).sum())
        remaining -= rows
    return extreme / (_PERMUTATIONS + 1)


@dataclass(frozen=True)
class SignedRank:
    """Wilcoxon's signed-rank test of paired differences; zero differences are excluded."""

    w: float
    """Sum of the ranks of the positive differences."""
    p: float
    """Two-sided p: probability of a sum at least as far from its mean, if the differences are symmetric about
    0."""
    effect: float
    """Matched-pairs rank-biserial correlation: the positive rank sum minus the negative one, divided by their
    total; from -1 (all differences are negative) to 1; 0 without differences."""
    better: int
    """Number of positive differences."""
    worse: int
    """Number of negative differences."""
    equal: int
    """Number of zero differences."""
    method: Literal["exact", "normal approximation"] = "exact"
    """How p was computed."""

    @property
    def least(self) -> float:
        """The smallest possible p for this number of differences."""
        return float(min(1.0, 2.0 ** (1 - self.better - self.worse)))


def compute_signed_rank(differences: Values) -> SignedRank:
    """Test whether paired differences, (n,), finite, are symmetric about 0 (Wilcoxon 1945).

    The exact distribution, ties included, is counted for up to 500 nonzero differences. With more, the normal
    approximation is used, with corrections for ties and continuity.
    """
    apart = differences[differences != 0]
    better = int((apart > 0).sum())
    worse, equal = len(apart) - better, len(differences) - len(apart)
    if not len(apart):
        return SignedRank(0.0, 1.0, 0.0, better, worse, equal)
    ranks = compute_doubled_midranks(np.abs(apart))
    total = int(ranks.sum())
    doubled = int(ranks[apart > 0].sum())
    w, effect = doubled / 2, (2 * doubled - total) / total
    if len(apart) > _MOST_EXACT_PAIRS:
        from scipy.stats import wilcoxon

        p = float(wilcoxon(apart, method="asymptotic", correction=True).pvalue)
        return SignedRank(w, p, effect, better, worse, equal, "normal approximation")
    share = np.zeros(total + 1)
    share[0] = 1.0
    for rank in ranks:  # each rank is positive or negative with the same probability
        share *= 0.5
        share[rank:] += share[:-rank].copy()
    distance = np.abs(2 * np.arange(total + 1) - total)
    p = float(min(1.0, share[distance >= abs(2 * doubled - total)].sum()))
    return SignedRank(w, p, effect, better, worse, equal)


def holm(values: Sequence[float]) -> list[float]:
    """Return p-values of several tests, corrected after Holm (1979) to control the family-wise error rate."""
    adjusted = [0.0] * len(values)
    largest = 0.0
    for rank, index in enumerate(sorted(range(len(values)), key=lambda i: values[i])):
        largest = max(largest, min(1.0, (len(values) - rank) * values[index]))
        adjusted[index] = largest
    return adjusted


def _replace_nan(values: Values) -> Values:
    return np.where(np.isnan(values), -np.inf, values)
