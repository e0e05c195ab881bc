"""Racing within a generation: clearly worse candidates get no more episodes."""

import math
import sys
from collections.abc import Generator, Sequence
from contextlib import suppress
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from swarmwright.common import statistics
from swarmwright.common.arrays import Fitness
from swarmwright.common.problems import FieldError
from swarmwright.methods.rankings._base import Ranking, RankingOptions

Test = Literal["friedman", "t", "t_holm", "t_bonferroni"]
"""friedman: by ranks, see `survivors`. t: paired t-tests against the best mean, optionally with Holm's or
Bonferroni's correction."""

Scores = NDArray[np.float64]
_MOST_EXACT_DIFFERENCES = 50
"""Number of differences below which Wilcoxon's distribution is exact."""
_SMALLEST_TERM = 1e-300
"""Smallest denominator in continued fractions."""
_MOST_TERMS = 100_000
"""Upper limit of terms of a series or continued fraction; a few dozen suffice for usual arguments."""


def survivors(scores: Scores, test: Test, level: float) -> NDArray[np.bool_]:
    """Return which candidates are not significantly worse than the best, (candidates,).

    friedman: for three or more candidates, Friedman's test; if it finds a difference, candidates are dropped
    whose rank sums differ from the best by more than Conover's comparison allows. For two, Wilcoxon's
    signed-rank test; a candidate that is never better and sometimes worse is dropped without a test. t,
    t_holm, t_bonferroni: paired, two-sided t-tests against the best mean.

    The best candidate and its equals always stay.

    Args:
        scores: (instances, candidates), finite, higher is better, at least one of each.
        test: the test to use.
        level: of significance, 0 to 1.
    """
    count = scores.shape[1]
    if count < 2:
        return np.ones(count, dtype=np.bool_)
    if test != "friedman":
        return _test_by_means(scores, test, level)
    return _test_by_ranks(scores, level) if count > 2 else _test_pair(scores, level)


def ranks_of(scores: Scores) -> Scores:
    """Return the rank of each candidate in each row, 1 for the best; ties share the mean rank."""
    ranks = np.empty(scores.shape)
    for row, values in enumerate(scores):
        _, inverse, counts = np.unique(-values, return_inverse=True, return_counts=True)
        ranks[row] = (np.cumsum(counts) - (counts - 1) / 2)[inverse]
    return ranks


def friedman(ranks: Scores) -> float:
    """Return the p-value of Friedman's test, corrected for ties; 1 if all rows are tied.

    ranks: (instances, candidates), at least two candidates.
    """
    rows, count = ranks.shape
    # Ranks are multiples of 1/2, so these sums are exact.
    between = float(((ranks.sum(axis=0) - rows * (count + 1) / 2) ** 2).sum())
    within = float((ranks**2).sum()) - rows * count * (count + 1) ** 2 / 4
    return 1.0 if within <= 0 else chi_squared_tail((count - 1) * between / within, count - 1)


def conover(ranks: Scores) -> Scores:
    """Return the p-value of each candidate's comparison with the one of the smallest rank sum.

    ranks: (instances, candidates), at least two of each.
    """
    rows, count = ranks.shape
    sums = ranks.sum(axis=0)
    freedom = (rows - 1) * (count - 1)
    remainder = 2 * (rows * float((ranks**2).sum()) - float((sums**2).sum()))
    difference = sums - sums.min()
    if remainder <= 0:  # every row has the same ranks
        return np.where(difference > 0, 0.0, 1.0)
    error = math.sqrt(remainder / freedom)
    return np.array(
        [student_tails(difference_of_means / error, freedom) for difference_of_means in difference.tolist()]
    )


def _test_by_ranks(scores: Scores, level: float) -> NDArray[np.bool_]:
    ranks = ranks_of(scores)
    if len(ranks) < 2 or friedman(ranks) >= level:
        return np.ones(scores.shape[1], dtype=np.bool_)
    return conover(ranks) >= level


def _test_pair(scores: Scores, level: float) -> NDArray[np.bool_]:
    differences = scores[:, 0] - scores[:, 1]
    nonzero = differences[differences != 0]
    if not len(nonzero):
        return np.ones(2, dtype=np.bool_)
    if not ((nonzero > 0).all() or (nonzero < 0).all()) and wilcoxon(differences) >= level:
        return np.ones(2, dtype=np.bool_)
    averages = np.add.outer(nonzero / 2, nonzero / 2)[np.triu_indices(len(nonzero))]
    first = np.median(averages) > 0
    return np.array([first, not first])


def wilcoxon(differences: Scores) -> float:
    """Return the two-sided p-value of Wilcoxon's signed-rank test; 1 if all differences are 0.

    Exact for fewer than 50 differences without zeros and ties, else a normal approximation with corrections
    for ties and continuity.
    """
    nonzero = differences[differences != 0]
    count = len(nonzero)
    if not count:
        return 1.0
    ranks = ranks_of(-np.abs(nonzero)[np.newaxis])[0]
    positive = float(ranks[nonzero > 0].sum())
    if count == len(differences) < _MOST_EXACT_DIFFERENCES and len(set(ranks.tolist())) == count:
        return _compute_signed_rank_tails(positive, count)
    ties = np.unique(ranks, return_counts=True)[1].astype(np.float64)
    variance = count * (count + 1) * (2 * count + 1) / 24 - float((ties**3 - ties).sum()) / 48
    away = positive - count * (count + 1) / 4
    if variance <= 0:
        return 1.0
    return math.erfc(max(abs(away) - 0.5, 0.0) / math.sqrt(2 * variance)) if away else 1.0


def _compute_signed_rank_tails(positive: float, count: int) -> float:
    """Return twice the smaller tail of the exact distribution of the sum of positive ranks."""
    ways = [1]
    for rank in range(1, count + 1):  # each rank has either sign
        more = [0] * rank
        ways = [first + second for first, second in zip(ways + more, more + ways, strict=True)]
    lower = sum(ways[: int(positive) + 1])
    upper = sum(ways[int(positive) :])
    return min(1.0, 2 * min(lower, upper) / float(2**count))


def _test_by_means(scores: Scores, test: Test, level: float) -> NDArray[np.bool_]:
    with np.errstate(over="ignore", invalid="ignore"):  # overflowing values are not compared
        p = _t_tests(scores)
    comparisons = len(p) - 1
    if test == "t_bonferroni":
        p = np.minimum(p * comparisons, 1.0)
    elif test == "t_holm":
        order = np.argsort(p, kind="stable")
        factors = np.maximum(comparisons - np.arange(len(p)), 1)
        p[order] = np.minimum(np.maximum.accumulate(p[order] * factors), 1.0)
    stays: NDArray[np.bool_] = p >= level
    return stays


def _t_tests(scores: Scores) -> Scores:
    """Return the p-value of each candidate against the one with the best mean, whose own is 1."""
    rows, count = scores.shape
    means = (scores / rows).sum(axis=0)
    best = int(np.argmax(means))
    p = np.ones(count)
    if rows < 2:
        return p
    differences = scores[:, [best]] - scores
    mean = (differences / rows).sum(axis=0)
    squares = ((differences - mean) ** 2).sum(axis=0)
    for row in np.flatnonzero(np.isfinite(mean) & np.isfinite(squares) & (mean > 0)).tolist():
        error = math.sqrt(float(squares[row]) / (rows - 1) / rows)
        p[row] = student_tails(float(mean[row]) / error, rows - 1) if error > 0 else 0.0
    return p


def chi_squared_tail(value: float, freedom: int) -> float:
    """Return the probability of more than `value` in the chi-squared distribution."""
    if value <= 0:
        return 1.0
    a, x = freedom / 2, value / 2
    front = math.exp(a * math.log(x) - x - math.lgamma(a))
    if x < a + 1:  # the series of the lower incomplete gamma function
        term = total = 1 / a
        for k in range(1, _MOST_TERMS):
            term *= x / (a + k)
            total += term
            if term < total * 1e-17:
                break
        return max(0.0, 1 - front * total)
    # The continued fraction of the upper function, by Lentz's algorithm.
    b = x + 1 - a
    c, d = 1 / _SMALLEST_TERM, 1 / b
    fraction = d
    for k in range(1, _MOST_TERMS):
        b += 2
        d = _nonzero(k * (a - k) * d + b)
        c = _nonzero(b + k * (a - k) / c)
        d = 1 / d
        fraction *= c * d
        if abs(c * d - 1) < 1e-16:
            break
    return min(1.0, front * fraction)


def student_tails(t: float, freedom: int) -> float:
    """Return the probability of more than |t| on either side in Student's distribution."""
    squared = t * t
    if squared == 0 or not math.isfinite(squared):
        return 0.0 if squared else 1.0
    a, x, complement = freedom / 2, freedom / (freedom + squared), squared / (freedom + squared)
    # The regularized incomplete beta function of x for a and 1/2; log1p keeps precision near 1.
    logarithm = a * (math.log1p(-complement) if complement < 0.5 else math.log(x)) + 0.5 * (
        math.log1p(-x) if x < 0.5 else math.log(complement)
    )
    front = math.exp(logarithm + _log_gamma_ratio(a) - 0.5 * math.log(math.pi))
    if x > (a + 1) / (a + 2.5):
        return max(0.0, 1 - front * _beta_fraction(0.5, a, complement) / 0.5)
    return min(1.0, front * _beta_fraction(a, 0.5, x) / a)


def _log_gamma_ratio(a: float) -> float:
    """Return the logarithm of gamma(a + 1/2) / gamma(a), without loss of digits for large values."""
    if a < 30:
        return math.lgamma(a + 0.5) - math.lgamma(a)
    inverse = 1 / a
    squared = inverse * inverse
    return 0.5 * math.log(a) - inverse * (
        1 / 8 - squared * (1 / 192 - squared * (1 / 640 - squared * 17 / 14336))
    )


def _beta_fraction(a: float, b: float, x: float) -> float:
    """Return the continued fraction of the incomplete beta function, by Lentz's algorithm."""
    c, d = 1.0, 1 / _nonzero(1 - (a + b) * x / (a + 1))
    fraction = d
    for k in range(1, _MOST_TERMS):
        even = k * (b - k) * x / ((a + 2 * k - 1) * (a + 2 * k))
        odd = -(a + k) * (a + b + k) * x / ((a + 2 * k) * (a + 2 * k + 1))
        for part in (even, odd):
            d = 1 / _nonzero(1 + part * d)
            c = _nonzero(1 + part / c)
            fraction *= c * d
        if abs(c * d - 1) < 1e-16:
            break
    return fraction


def _nonzero(value: float) -> float:
    """Replace numbers too close to zero for division."""
    return value if abs(value) > _SMALLEST_TERM else _SMALLEST_TERM


Episodes = NDArray[np.float64]
_LARGEST_FLOAT = sys.float_info.max
"""Limit that keeps fitness finite."""
Rounds = Generator[tuple[NDArray[np.intp], slice], Episodes, Fitness]
"""Yields candidates and their episodes, receives the results, and returns the fitness."""


class RaceOptions(RankingOptions):
    """Candidates significantly worse than the best of their generation get no more episodes.

    Not with `map_elites` and `nsga2`, whose metrics would be means over different seeds.
    """

    kind: Literal["race"] = "race"
    episodes: int = Field(default=10, ge=1, le=100_000)
    """Episodes of a candidate that is not dropped, more than first_test."""
    first_test: int = Field(default=5, ge=2, le=100_000)
    """Episodes of all candidates before the first test."""
    each_test: int = Field(default=1, ge=1, le=100_000)
    """Episodes between two tests."""
    test: Test = "friedman"
    """friedman: Friedman's test and Conover's comparisons with the best, by ranks. t, t_holm, t_bonferroni:
    paired t-tests against the best mean, without or with correction."""
    level: float = Field(default=0.05, gt=0, lt=1)
    """Significance level of each test."""

    @model_validator(mode="after")
    def _members(self) -> "RaceOptions":
        if self.reevaluate:
            raise FieldError(
                "reevaluate",
                "survivors and new candidates have different episodes and cannot race each other; leave "
                "reevaluate out, or use kind: absolute",
            )
        return self


class Race(Ranking):
    """The mean of a candidate's episodes, with fewer episodes for clearly worse candidates.

    After `first_test` episodes of all candidates, and then after every `each_test` episodes, candidates that
    are significantly worse than the best of the generation are dropped. A candidate with a failed episode is
    dropped at once, unless `failed` defines its fitness.

    The fitness of a candidate with all episodes is their mean. The fitness of a dropped candidate is the mean
    of its episodes, corrected for easy seeds by the difference between the means of all and of the same
    episodes among the candidates that have all; and it is kept below that of candidates dropped later.

    Source: Birattari, Stützle, Paquete and Varrentrapp, "A racing algorithm for configuring metaheuristics",
    GECCO 2002.
    """

    kind: ClassVar[str] = "race"
    options_model = RaceOptions
    options: RaceOptions

    def count_episodes(self, episodes: Episodes) -> NDArray[np.int64]:
        """Return the number of episodes of each candidate of a generation, (candidates,).

        episodes: the results of the whole generation, (candidates, episodes).
        """
        lengths = np.zeros(len(episodes), dtype=np.int64)
        with suppress(StopIteration):
            rounds = self.rounds(len(episodes))
            candidates, span = next(rounds)
            while True:
                lengths[candidates] = span.stop
                candidates, span = rounds.send(episodes[candidates, span])
        return lengths

    def rounds(self, candidates: int) -> Rounds:
        """Race at least one candidate; see `Rounds`. NaN or infinite results mark failed episodes."""
        options, count = self.options, self.options.episodes
        episodes = np.full((candidates, count), np.nan)
        alive = np.arange(candidates)
        length = np.zeros(candidates, dtype=np.int64)
        done, failed = 0, np.zeros(candidates, dtype=np.bool_)
        while done < count and len(alive):
            upto = min(options.first_test if not done else done + options.each_test, count)
            values = self.replace_failures((yield alive, slice(done, upto)))
            episodes[alive, done:upto] = values
            length[alive] = upto
            whole = np.isfinite(values).all(axis=1)
            failed[alive[~whole]] = True
            alive, done = alive[whole], upto
            if done < count and len(alive) > 1:
                scores = _scale(episodes[alive, :done].T, options.test)
                alive = alive[survivors(scores, options.test, options.level)]
        return self._fitness(episodes, length, failed)

    def score(self, episodes: Episodes, genomes: NDArray[np.float32] | None = None) -> Fitness:  # noqa: ARG002
        """Return (candidates,) fitness of (candidates, episodes) results; NaN where a candidate failed.

        Episodes of a candidate after it was dropped are ignored.
        """
        if not len(episodes):
            return np.empty(0)
        rounds = self.rounds(len(episodes))
        try:
            candidates, span = next(rounds)
            while True:
                candidates, span = rounds.send(episodes[candidates, span])
        except StopIteration as end:
            fitness: Fitness = end.value
            return fitness

    def samples(self, episodes: Sequence[float]) -> Fitness:
        """Return fitness values of one candidate, one per episode."""
        return np.array(episodes, dtype=np.float64)

    def _fitness(self, episodes: Episodes, length: NDArray[np.int64], failed: NDArray[np.bool_]) -> Fitness:
        fitness = np.full(len(episodes), np.nan)
        # The last remaining candidates may all have failed.
        longest = int(length[~failed].max(initial=0))
        leading = ~failed & (length == longest)
        with np.errstate(over="ignore"):  # clipped at the largest number
            reference = _row_means(episodes[leading, :longest]) if longest else np.empty(0)
            least = np.inf
            for upto in sorted(set(length[~failed].tolist()), reverse=True):
                rows = np.flatnonzero(~failed & (length == upto))
                means = _row_means(episodes[rows, :upto])
                if leading[rows[0]]:
                    values = means
                else:
                    easier = np.clip(
                        reference - _row_means(episodes[leading, :upto]), -_LARGEST_FLOAT, _LARGEST_FLOAT
                    )
                    values = np.clip(
                        means + _row_means(easier[np.newaxis])[0], -_LARGEST_FLOAT, _step_below(least)
                    )
                fitness[rows] = values + 0.0
                least = min(least, float(np.min(values)))
        return fitness

    def _score(self, episodes: Sequence[Sequence[float]]) -> Fitness:
        """Return the means of candidates that did not race."""
        return np.array([_row_means(np.array([row]))[0] for row in episodes])


def _step_below(value: float) -> float:
    """Return the next smaller number; the smallest and non-finite numbers stay."""
    return max(math.nextafter(value, -math.inf), -_LARGEST_FLOAT) if math.isfinite(value) else value


def _scale(scores: Episodes, test: Test) -> Episodes:
    """Scale scores so that differences, and squares for t-tests, are finite.

    Tests do not depend on the factor, a power of two, which is exact.
    """
    most = 1000 if test == "friedman" else 400
    exponent = int(np.frexp(np.abs(scores).max())[1])
    scaled: Episodes = np.ldexp(scores, most - exponent) if exponent > most else scores
    return scaled


def _row_means(rows: Episodes) -> Fitness:
    """Return the mean of each row, added in order."""
    with np.errstate(over="ignore", invalid="ignore"):
        means: Fitness = np.add.accumulate(rows, axis=1)[:, -1] / rows.shape[1]
    # The sum may overflow although the mean does not.
    for row in np.flatnonzero(~np.isfinite(means) & np.isfinite(rows).all(axis=1)):
        means[row] = statistics.mean(rows[row].tolist())
    return means
