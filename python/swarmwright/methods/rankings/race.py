"""A race in each generation: candidates that are clearly worse go through no more episodes."""

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
"""friedman: by ranks, see `survivors`. t: paired t-tests with the best mean; with Holm's or Bonferroni's
correction for their number."""

Scores = NDArray[np.float64]
_MOST_EXACT_DIFFERENCES = 50
"""Below so many differences Wilcoxon's distribution is counted out."""
_SMALLEST_TERM = 1e-300
"""Takes the place of smaller denominators of continued fractions."""
_MOST_TERMS = 100_000
"""Terms of a series or a continued fraction."""
"""Of a series or a continued fraction, at most; a few dozen are enough for usual arguments."""


def survivors(scores: Scores, test: Test, level: float) -> NDArray[np.bool_]:
    """Return which candidates are not significantly worse than the best one, (candidates,).

    friedman: with three candidates or more, Friedman's test of all. If it finds a difference, those are
    dropped whose sum of ranks differs from the best one's by more than Conover's comparison allows. With two,
    Wilcoxon's signed-rank test; one that is nowhere better and somewhere worse is dropped without a test. t,
    t_holm, t_bonferroni: a paired, two-sided t-test of each against the one with the best mean.

    The best one always stays, as do those that equal it.

    Args:
        scores: (instances, candidates), finite, more is better, at least one of each.
        test: which test.
        level: of significance, 0 to 1.
    """
    count = scores.shape[1]
    if count < 2:
        return np.ones(count, dtype=np.bool_)
    if test != "friedman":
        return _by_t(scores, test, level)
    return _by_ranks(scores, level) if count > 2 else _of_two(scores, level)


def ranks_of(scores: Scores) -> Scores:
    """Return the rank of each candidate in each row, 1 for the best; equal ones share the mean rank."""
    ranks = np.empty(scores.shape)
    for row, values in enumerate(scores):
        _, which, counts = np.unique(-values, return_inverse=True, return_counts=True)
        ranks[row] = (np.cumsum(counts) - (counts - 1) / 2)[which]
    return ranks


def friedman(ranks: Scores) -> float:
    """Return the p-value of Friedman's test, corrected for ties; 1 where all are equal in every row.

    ranks: (instances, candidates), at least two candidates.
    """
    rows, count = ranks.shape
    # Ranks are multiples of 1/2, so that these sums are exact.
    between = float(((ranks.sum(axis=0) - rows * (count + 1) / 2) ** 2).sum())
    within = float((ranks**2).sum()) - rows * count * (count + 1) ** 2 / 4
    return 1.0 if within <= 0 else chi_squared_tail((count - 1) * between / within, count - 1)


def conover(ranks: Scores) -> Scores:
    """Return the p-value of each candidate's comparison with the one with the least sum of ranks.

    ranks: (instances, candidates), at least two of each.
    """
    rows, count = ranks.shape
    sums = ranks.sum(axis=0)
    freedom = (rows - 1) * (count - 1)
    rest = 2 * (rows * float((ranks**2).sum()) - float((sums**2).sum()))
    difference = sums - sums.min()
    if rest <= 0:  # every row has the same ranks
        return np.where(difference > 0, 0.0, 1.0)
    error = math.sqrt(rest / freedom)
    return np.array(
        [student_tails(difference_of_means / error, freedom) for difference_of_means in difference.tolist()]
    )


def _by_ranks(scores: Scores, level: float) -> NDArray[np.bool_]:
    ranks = ranks_of(scores)
    if len(ranks) < 2 or friedman(ranks) >= level:
        return np.ones(scores.shape[1], dtype=np.bool_)
    return conover(ranks) >= level


def _of_two(scores: Scores, level: float) -> NDArray[np.bool_]:
    differences = scores[:, 0] - scores[:, 1]
    found = differences[differences != 0]
    if not len(found):
        return np.ones(2, dtype=np.bool_)
    if not ((found > 0).all() or (found < 0).all()) and wilcoxon(differences) >= level:
        return np.ones(2, dtype=np.bool_)
    averages = np.add.outer(found / 2, found / 2)[np.triu_indices(len(found))]
    first = np.median(averages) > 0
    return np.array([first, not first])


def wilcoxon(differences: Scores) -> float:
    """Return the two-sided p-value of Wilcoxon's signed-rank test; 1 where all differences are 0.

    Exact for fewer than 50 differences without zeros and ties, else by the normal distribution, with
    corrections for ties and for continuity.
    """
    found = differences[differences != 0]
    count = len(found)
    if not count:
        return 1.0
    ranks = ranks_of(-np.abs(found)[np.newaxis])[0]
    positive = float(ranks[found > 0].sum())
    if count == len(differences) < _MOST_EXACT_DIFFERENCES and len(set(ranks.tolist())) == count:
        return _signed_rank_tails(positive, count)
    ties = np.unique(ranks, return_counts=True)[1].astype(np.float64)
    variance = count * (count + 1) * (2 * count + 1) / 24 - float((ties**3 - ties).sum()) / 48
    away = positive - count * (count + 1) / 4
    if variance <= 0:
        return 1.0
    return math.erfc(max(abs(away) - 0.5, 0.0) / math.sqrt(2 * variance)) if away else 1.0


def _signed_rank_tails(positive: float, count: int) -> float:
    """Return twice the smaller tail of the exact distribution of the sum of positive ranks."""
    ways = [1]
    for rank in range(1, count + 1):  # each rank has either sign
        more = [0] * rank
        ways = [one + other for one, other in zip(ways + more, more + ways, strict=True)]
    lower = sum(ways[: int(positive) + 1])
    upper = sum(ways[int(positive) :])
    return min(1.0, 2 * min(lower, upper) / float(2**count))


def _by_t(scores: Scores, test: Test, level: float) -> NDArray[np.bool_]:
    with np.errstate(over="ignore", invalid="ignore"):  # what overflows is not compared
        p = _t_tests(scores)
    others = len(p) - 1
    if test == "t_bonferroni":
        p = np.minimum(p * others, 1.0)
    elif test == "t_holm":
        order = np.argsort(p, kind="stable")
        factors = np.maximum(others - np.arange(len(p)), 1)
        p[order] = np.minimum(np.maximum.accumulate(p[order] * factors), 1.0)
    kept: NDArray[np.bool_] = p >= level
    return kept


def _t_tests(scores: Scores) -> Scores:
    """Return the p-value of each candidate against the one with the best mean, which has 1 itself."""
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
    # The continued fraction of the upper one, by Lentz's algorithm.
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
    a, x, rest = freedom / 2, freedom / (freedom + squared), squared / (freedom + squared)
    # The regularized incomplete beta function of x for a and 1/2; a logarithm near 1 by what is left to it.
    logarithm = a * (math.log1p(-rest) if rest < 0.5 else math.log(x)) + 0.5 * (
        math.log1p(-x) if x < 0.5 else math.log(rest)
    )
    front = math.exp(logarithm + _log_gamma_ratio(a) - 0.5 * math.log(math.pi))
    if x > (a + 1) / (a + 2.5):
        return max(0.0, 1 - front * _beta_fraction(0.5, a, rest) / 0.5)
    return min(1.0, front * _beta_fraction(a, 0.5, x) / a)


def _log_gamma_ratio(a: float) -> float:
    """Return the logarithm of gamma(a + 1/2) / gamma(a): of large ones the difference would lose digits."""
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
    """Return a number that can be divided by."""
    return value if abs(value) > _SMALLEST_TERM else _SMALLEST_TERM


Episodes = NDArray[np.float64]
_LARGEST_FLOAT = sys.float_info.max
"""Of binary64: fitness is kept finite."""
Rounds = Generator[tuple[NDArray[np.intp], slice], Episodes, Fitness]
"""Yields candidates and the episodes that they go through, takes what came out; returns their fitness."""


class RaceOptions(RankingOptions):
    """Candidates that are significantly worse than the best of their generation get no more episodes.

    Not with `map_elites` and `nsga2`: metrics that they compare would be means over different seeds.
    """

    kind: Literal["race"] = "race"
    episodes: int = Field(default=10, ge=1, le=100_000)
    """Episodes of a candidate that is not dropped: more than first_test in an experiment."""
    first_test: int = Field(default=5, ge=2, le=100_000)
    """Episodes of all candidates, after which the first test is made."""
    each_test: int = Field(default=1, ge=1, le=100_000)
    """Episodes between two tests."""
    test: Test = "friedman"
    """friedman: Friedman's test and Conover's comparisons with the best, by ranks. t, t_holm, t_bonferroni:
    paired t-tests with the best mean, without or with a correction for their number."""
    level: float = Field(default=0.05, gt=0, lt=1)
    """Significance level of each test."""

    @model_validator(mode="after")
    def _members(self) -> "RaceOptions":
        if self.reevaluate:
            raise FieldError(
                "reevaluate",
                "members that stay have other episodes than new candidates, which cannot race "
                "with them; leave reevaluate out, or take kind: absolute",
            )
        return self


class Race(Ranking):
    """The mean of a candidate's episodes, of which the clearly worse have fewer.

    After `first_test` episodes of all candidates, and then every `each_test` ones, those that are
    significantly worse than the best of the generation are dropped: they go through no more episodes. A
    candidate of which an episode fails is dropped at once, unless `failed` gives that a fitness.

    The fitness of a candidate with all episodes is their mean. For one that was dropped it is the mean of
    those that it has, plus how much higher the mean of all episodes is than that of the same ones among the
    candidates that have them all, so that easy seeds do not count; and less than the least fitness of those
    that were dropped later.

    Source: Birattari, Stützle, Paquete and Varrentrapp, "A racing algorithm for configuring metaheuristics",
    GECCO 2002.
    """

    kind: ClassVar[str] = "race"
    options_model = RaceOptions
    options: RaceOptions

    def ran(self, episodes: Episodes) -> NDArray[np.int64]:
        """Return how many episodes each candidate of a generation went through, (candidates,).

        episodes: the results of the whole generation, (candidates, episodes).
        """
        found = np.zeros(len(episodes), dtype=np.int64)
        with suppress(StopIteration):
            rounds = self.rounds(len(episodes))
            who, which = next(rounds)
            while True:
                found[who] = which.stop
                who, which = rounds.send(episodes[who, which])
        return found

    def rounds(self, candidates: int) -> Rounds:
        """Race so many candidates, at least one; see `Rounds`. NaN or infinite: the episode has failed."""
        options, count = self.options, self.options.episodes
        episodes = np.full((candidates, count), np.nan)
        alive = np.arange(candidates)
        length = np.zeros(candidates, dtype=np.int64)
        done, failed = 0, np.zeros(candidates, dtype=np.bool_)
        while done < count and len(alive):
            upto = min(options.first_test if not done else done + options.each_test, count)
            values = self.counted((yield alive, slice(done, upto)))
            episodes[alive, done:upto] = values
            length[alive] = upto
            whole = np.isfinite(values).all(axis=1)
            failed[alive[~whole]] = True
            alive, done = alive[whole], upto
            if done < count and len(alive) > 1:
                scores = _compared(episodes[alive, :done].T, options.test)
                alive = alive[survivors(scores, options.test, options.level)]
        return self._fitness(episodes, length, failed)

    def score(self, episodes: Episodes, genomes: NDArray[np.float32] | None = None) -> Fitness:  # noqa: ARG002
        """Return (candidates,) fitness of (candidates, episodes) results; NaN where a candidate failed.

        Episodes that a candidate does not go through, because it is dropped before, do not count.
        """
        if not len(episodes):
            return np.empty(0)
        rounds = self.rounds(len(episodes))
        try:
            who, which = next(rounds)
            while True:
                who, which = rounds.send(episodes[who, which])
        except StopIteration as end:
            fitness: Fitness = end.value
            return fitness

    def samples(self, episodes: Sequence[float]) -> Fitness:
        """Return fitness values of one candidate: every episode makes one."""
        return np.array(episodes, dtype=np.float64)

    def _fitness(self, episodes: Episodes, length: NDArray[np.int64], failed: NDArray[np.bool_]) -> Fitness:
        fitness = np.full(len(episodes), np.nan)
        # Those that were left may all have failed in the end.
        longest = int(length[~failed].max(initial=0))
        leading = ~failed & (length == longest)
        with np.errstate(over="ignore"):  # of what is cut off at the largest number
            reference = _mean(episodes[leading, :longest]) if longest else np.empty(0)
            least = np.inf
            for upto in sorted(set(length[~failed].tolist()), reverse=True):
                rows = np.flatnonzero(~failed & (length == upto))
                own = _mean(episodes[rows, :upto])
                if leading[rows[0]]:
                    values = own
                else:
                    easier = np.clip(
                        reference - _mean(episodes[leading, :upto]), -_LARGEST_FLOAT, _LARGEST_FLOAT
                    )
                    values = np.clip(own + _mean(easier[np.newaxis])[0], -_LARGEST_FLOAT, _below(least))
                fitness[rows] = values + 0.0
                least = min(least, float(np.min(values)))
        return fitness

    def _score(self, episodes: Sequence[Sequence[float]]) -> Fitness:
        """Return the means: what candidates have that no others raced with."""
        return np.array([_mean(np.array([row]))[0] for row in episodes])


def _below(value: float) -> float:
    """Return the next smaller number; of the least one, and of what is not finite, the same."""
    return max(math.nextafter(value, -math.inf), -_LARGEST_FLOAT) if math.isfinite(value) else value


def _compared(scores: Episodes, test: Test) -> Episodes:
    """Return scores whose differences are finite, in a t-test their squares, too.

    What a test finds does not depend on a factor, which is a power of two and therefore exact.
    """
    most = 1000 if test == "friedman" else 400
    exponent = int(np.frexp(np.abs(scores).max())[1])
    found: Episodes = np.ldexp(scores, most - exponent) if exponent > most else scores
    return found


def _mean(rows: Episodes) -> Fitness:
    """Return the mean of each row, added one after the other."""
    with np.errstate(over="ignore", invalid="ignore"):
        found: Fitness = np.add.accumulate(rows, axis=1)[:, -1] / rows.shape[1]
    # Where the sum is too large, the mean is not.
    for row in np.flatnonzero(~np.isfinite(found) & np.isfinite(rows).all(axis=1)):
        found[row] = statistics.mean(rows[row].tolist())
    return found
