"""Statistical tests of final fitness: distribution-free, for few runs and with ties.

Fitness of evolved controllers is far from normally distributed, and runs are few; rank-based tests are robust
(Derrac et al. 2011, doi:10.1016/j.swevo.2011.02.002; Arcuri and Briand 2014, doi:10.1002/stvr.1486). A run
without any valid fitness counts as minus infinity, worse than all others.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swarmwright.core.correlation import doubled_midranks

Values = NDArray[np.float64]

_EXACT = 60
"""Runs in both groups together up to which the test is exact."""
_CONFIDENCE = 0.95
"""Level of confidence intervals."""
_WORDED = 3
"""Values of a group from which on the size of the effect has a word: A12 of fewer is 0 or 1 by chance."""


@dataclass(frozen=True)
class Difference:
    """How the first of two groups differs from the second."""

    u: float
    """Mann-Whitney's U of the first group: pairs in which it is better, ties as halves."""
    p: float
    """Two-sided; probability of a U as far from the middle or farther, if both were alike."""
    effect: float
    """Vargha and Delaney's A12: probability that a run of the first is better than one of the second."""
    shift: float
    """Hodges and Lehmann's estimate: median of all differences first minus second."""
    interval: tuple[float, float] | None
    """95 % confidence interval of the shift; None with so few runs that there is none."""
    fewest: int
    """Runs of the smaller group."""

    @property
    def magnitude(self) -> str:
        """The effect in words, after Vargha and Delaney (2000), doi:10.3102/10769986025002101.

        Empty where a group has fewer than three runs.
        """
        if self.fewest < _WORDED:
            return ""
        far = abs(self.effect - 0.5)
        for border, word in ((0.06, "negligible"), (0.14, "small"), (0.21, "medium")):
            if far < border:
                return word
        return "large"


def difference(first: Values, second: Values) -> Difference:
    """Compare two groups of values, (n,) and (m,), more is better; at least one value each."""
    one, two = _ordered(first), _ordered(second)
    better = (one[:, None] > two[None, :]).sum() + 0.5 * (one[:, None] == two[None, :]).sum()
    u = float(better)
    shift, interval = _shift(one, two)
    p, effect = mann_whitney(one, two, u), u / (len(one) * len(two))
    return Difference(u, p, effect, shift, interval, min(len(one), len(two)))


def mann_whitney(one: Values, two: Values, u: float) -> float:
    """Return the two-sided p of Mann and Whitney's test; exact, ties included, for up to 60 values.

    The exact distribution of rank sums is counted with the shift algorithm of Streitberg and Roehmel (1986);
    above, it is the normal approximation with corrections for ties and continuity.
    """
    n, m = len(one), len(two)
    pooled = np.concatenate([one, two])
    if (pooled == pooled[0]).all():
        return 1.0
    if n + m > _EXACT:
        from scipy.stats import mannwhitneyu

        return float(mannwhitneyu(one, two, alternative="two-sided", method="asymptotic").pvalue)
    counts = _rank_sums(doubled_midranks(pooled), n)
    distance = np.abs(np.arange(len(counts)) - n * (n + m + 1))  # of doubled sums, from their mean
    seen = abs(2 * u - n * m)
    return float(min(1.0, counts[distance >= seen - 1e-9].sum() / counts.sum()))


def _rank_sums(ranks: NDArray[np.int64], size: int) -> Values:
    """Return how many subsets of `size` elements have each sum of ranks, from 0."""
    counts = np.zeros((size + 1, int(ranks.sum()) + 1))
    counts[0, 0] = 1.0
    for rank in ranks:
        # Larger subsets first: an element is in a subset once.
        counts[1:, rank:] += counts[:-1, : counts.shape[1] - rank].copy()
    sums: Values = counts[size]
    return sums


def _shift(one: Values, two: Values) -> tuple[float, tuple[float, float] | None]:
    with np.errstate(over="ignore", invalid="ignore"):
        differences = one[:, None] - two[None, :]
        differences[one[:, None] == two[None, :]] = 0.0  # of infinities, too
    differences = np.sort(differences.ravel())
    count = len(differences)
    middle = differences[(count - 1) // 2], differences[count // 2]
    estimate = float(middle[0] if middle[0] == middle[1] else middle[0] / 2 + middle[1] / 2)
    below = _border(len(one), len(two))
    if below == 0:
        return estimate, None
    return estimate, (float(differences[below - 1]), float(differences[count - below]))


def _border(n: int, m: int) -> int:
    """Return how far from either end of all ordered differences the confidence interval ends; 0: nowhere.

    Moses' interval: the largest k for which P(U < k) is at most half of what the confidence leaves.
    """
    tail = (1 - _CONFIDENCE) / 2
    if n + m > _EXACT:
        from scipy.stats import norm

        spread = np.sqrt(n * m * (n + m + 1) / 12)
        return max(0, int(n * m / 2 + float(norm.ppf(tail)) * spread))
    counts = _rank_sums(np.arange(1, n + m + 1, dtype=np.int64), n)[n * (n + 1) // 2 :]
    below = np.cumsum(counts) / counts.sum()
    return int(np.searchsorted(below, tail, side="right"))


@dataclass(frozen=True)
class Kruskal:
    """Kruskal and Wallis' test of all groups at once."""

    h: float
    p: float
    """Probability of an H as large, if all groups were alike."""


def kruskal_wallis(groups: Sequence[Values]) -> Kruskal:
    """Test whether any of the groups differs."""
    ordered = [_ordered(values) for values in groups]
    pooled = np.concatenate(ordered)
    if (pooled == pooled[0]).all():
        return Kruskal(0.0, 1.0)
    from scipy.stats import kruskal

    # Computed from ranks, which are finite for infinite values too.
    ranks = np.split(doubled_midranks(pooled), np.cumsum([len(values) for values in ordered])[:-1])
    found = kruskal(*ranks)
    return Kruskal(float(found.statistic), float(found.pvalue))


def holm(values: Sequence[float]) -> list[float]:
    """Return p-values of several tests, corrected after Holm (1979) so that all hold together."""
    adjusted = [0.0] * len(values)
    largest = 0.0
    for place, index in enumerate(sorted(range(len(values)), key=lambda i: values[i])):
        largest = max(largest, min(1.0, (len(values) - place) * values[index]))
        adjusted[index] = largest
    return adjusted


def _ordered(values: Values) -> Values:
    return np.where(np.isnan(values), -np.inf, values)
