"""The tests against their definitions, against SciPy, and on what they must not choke on."""

from itertools import combinations, permutations, product
from math import comb, inf, nan
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmwright.analysis.significance import (
    compute_signed_rank,
    difference,
    holm,
    kruskal_wallis,
    mann_whitney,
)

Values = st.lists(st.integers(-5, 5).map(float), min_size=1, max_size=6).map(np.array)


@pytest.mark.slow
@given(Values, Values)
def test_p_is_the_share_of_arrangements_that_are_as_extreme(one: np.ndarray, two: np.ndarray) -> None:
    found = difference(one, two)
    describe_pooling = np.concatenate([one, two])
    seen = abs(found.u - len(one) * len(two) / 2)
    extreme = 0
    for chosen in combinations(range(len(describe_pooling)), len(one)):
        first = describe_pooling[list(chosen)]
        second = np.delete(describe_pooling, chosen)
        u = sum((a > b) + 0.5 * (a == b) for a in first for b in second)
        extreme += abs(u - len(one) * len(two) / 2) >= seen - 1e-9
    assert found.p == pytest.approx(extreme / comb(len(describe_pooling), len(one)))


@pytest.mark.parametrize(("n", "m"), [(5, 7), (12, 20), (25, 30)])
def test_without_ties_it_is_scipys_exact_test(n: int, m: int) -> None:
    from scipy import stats

    random = np.random.default_rng(n)
    one, two = random.normal(0.5, 1, n), random.normal(0, 1, m)
    expected = stats.mannwhitneyu(one, two, method="exact")
    found = difference(one, two)
    assert found.u == expected.statistic
    assert found.p == pytest.approx(float(expected.pvalue), rel=1e-9)


def test_many_runs_are_approximated() -> None:
    from scipy import stats

    random = np.random.default_rng(1)
    one, two = random.integers(0, 9, 60).astype(float), random.integers(1, 10, 60).astype(float)
    expected = stats.mannwhitneyu(one, two, method="asymptotic")
    found = difference(one, two)
    assert found.p == pytest.approx(float(expected.pvalue))
    assert found.interval is not None
    assert found.interval[0] <= found.shift <= found.interval[1]


def test_effect_shift_and_interval_are_those_of_the_definitions() -> None:
    one, two = np.array([3.0, 5, 7, 9]), np.array([1.0, 2, 4, 8])
    found = difference(one, two)
    pairs = sorted(a - b for a in one for b in two)
    assert found.u == sum(value > 0 for value in pairs)
    assert found.effect == found.u / 16
    assert found.shift == np.median(pairs)
    # P(U < 1) = 1/70 is below 2.5 %, P(U < 2) = 2/70 is not: from the first to the last difference.
    assert found.interval == (pairs[0], pairs[-1])
    assert difference(one[:3], two[:3]).interval is None, "1/20 is above 2.5 %"


def test_the_interval_covers_the_shift_as_often_as_it_says() -> None:
    random = np.random.default_rng(3)
    covered = 0
    for _ in range(400):
        found = difference(random.normal(1.0, 1, 8), random.normal(0, 1, 8))
        assert found.interval is not None
        covered += found.interval[0] <= 1.0 <= found.interval[1]
    assert 0.92 < covered / 400 <= 1.0


@pytest.mark.parametrize(
    ("effect_of", "word"),
    [
        ([-1] * 9 + [0] + [1] * 11, "negligible"),
        ([-1] * 2 + [0] * 3 + [1] * 4, "small"),
        ([0, 0, 1], "medium"),
        ([-1, -1], "large"),
    ],
)
def test_effects_have_their_usual_names_where_a_difference_is_found(
    effect_of: list[float], word: str
) -> None:
    one, two = np.array(effect_of, dtype=float), np.array([-0.5, 0.5])
    assert difference(np.tile(one, 400), np.tile(two, 400)).magnitude == word
    few = difference(np.tile(one, 2)[:2], np.tile(two, 2))
    assert few.p > 0.05
    assert few.magnitude == "", "of so few runs, any effect looks large"


def test_p_and_the_interval_contradict_each_other_by_ties_alone() -> None:
    tied = difference(np.array([3.0, 5, 5, 5, 3]), np.array([0.0, 3, 1, 1, 3]))
    assert tied.p == pytest.approx(12 / 252)
    assert tied.interval == (0.0, 5.0)
    assert tied.contradicts
    assert not difference(np.arange(5.0), np.arange(5.0)).contradicts
    random = np.random.default_rng(2)
    for _ in range(200):
        assert not difference(random.normal(1, 1, 5), random.normal(0, 1, 6)).contradicts


def test_failed_runs_count_as_worse_than_all_others() -> None:
    failed = difference(np.array([nan, nan, nan]), np.array([1.0, 2, 3]))
    assert (failed.effect, failed.shift) == (0.0, -inf)
    assert failed.p == pytest.approx(0.1)
    both = difference(np.array([nan, nan]), np.array([nan]))
    assert (both.p, both.effect, both.shift) == (1.0, 0.5, 0.0)


def test_huge_and_tiny_fitness() -> None:
    huge = difference(np.array([1e300, 1.5e308]), np.array([-1e-300, -1.5e308]))
    assert huge.effect == 1.0 - 0.25 * 0
    assert huge.shift > 1e299
    tiny = difference(np.array([-1e-300]), np.array([-2e-300]))
    assert tiny.effect == 1.0
    assert tiny.shift == pytest.approx(1e-300)


def test_all_alike() -> None:
    same = np.zeros(5)
    assert mann_whitney(same, same, 12.5) == 1.0
    found = kruskal_wallis([same, same, same])
    assert (found.h, found.p) == (0.0, 1.0)


def test_kruskal_and_wallis_is_scipys_and_takes_failures() -> None:
    from scipy import stats

    groups = [np.array([1.0, 2, 3]), np.array([2.0, 4, 9]), np.array([7.0, 8, 1])]
    found = kruskal_wallis(groups)
    expected = stats.kruskal(*groups)
    assert found.h == pytest.approx(expected.statistic)
    assert 0 < kruskal_wallis([np.array([nan, 1.0]), groups[1], groups[2]]).p < 1
    random = np.random.default_rng(4)
    many = [random.normal(0.3 * shift, 1, 21) for shift in range(3)]
    found, expected = kruskal_wallis(many), stats.kruskal(*many)
    assert (found.h, found.p) == pytest.approx((expected.statistic, expected.pvalue))
    assert found.method == "chi-square"


@pytest.mark.slow
@given(st.lists(Values, min_size=3, max_size=4).filter(lambda groups: sum(map(len, groups)) <= 6))
def test_p_of_several_groups_is_the_share_of_arrangements_that_are_as_extreme(
    groups: list[np.ndarray],
) -> None:
    from scipy import stats

    describe_pooling = np.concatenate(groups)
    found = kruskal_wallis(groups)
    assert found.method == "exact"
    if np.ptp(describe_pooling) == 0:
        return
    ranks = stats.rankdata(describe_pooling)
    places = np.cumsum([len(one) for one in groups])[:-1]

    def spread(order: Any) -> float:
        return float(sum(part.sum() ** 2 / len(part) for part in np.split(ranks[list(order)], places)))

    # Arrangements within a group are alike; all are counted equally often.
    seen = spread(range(len(ranks)))
    spreads = np.array([spread(order) for order in permutations(range(len(ranks)))])
    assert found.p == pytest.approx((spreads >= seen - 1e-9).mean())


def test_the_clearest_difference_of_several_groups() -> None:
    assert kruskal_wallis([np.arange(4.0) + 10 * number for number in range(3)]).p == pytest.approx(6 / 34650)


@pytest.mark.slow
def test_p_of_more_runs_is_that_of_permutations_and_always_the_same() -> None:
    from scipy import stats

    random = np.random.default_rng(3)
    groups = [np.round(random.uniform(0, 9, 10)) + 0.7 * number for number in range(5)]
    found = kruskal_wallis(groups)
    assert found.method == "permutations"
    assert found == kruskal_wallis(groups)
    assert kruskal_wallis([group[::-1] for group in groups[::-1]]).p == found.p
    expected = stats.permutation_test(
        groups, lambda *some: stats.kruskal(*some).statistic, vectorized=False, n_resamples=2000, rng=1,
        alternative="greater",
    ).pvalue  # fmt: skip
    assert 0.001 < found.p < 0.5
    assert found.p == pytest.approx(expected, abs=4 * np.sqrt(found.p / 2000))


@pytest.mark.slow
def test_p_of_several_groups_does_not_depend_on_their_order() -> None:
    random = np.random.default_rng(3)
    groups = [random.normal(size=8) + number for number in range(3)]
    found = {
        (one.p, one.method)
        for order in permutations(groups)
        for seed in range(2)
        for one in [kruskal_wallis([np.random.default_rng(seed).permutation(group) for group in order])]
    }
    assert len(found) == 1


def test_holm() -> None:
    assert holm([0.01, 0.04, 0.03]) == pytest.approx([0.03, 0.06, 0.06])
    assert holm([0.9, 0.8]) == [1.0, 1.0]
    assert holm([]) == []


@given(st.lists(st.integers(-3, 3).map(float), min_size=1, max_size=9).map(np.array))
def test_the_signed_rank_test_counts_all_signs(differences: np.ndarray) -> None:
    from scipy.stats import rankdata

    found = compute_signed_rank(differences)
    apart = differences[differences != 0]
    assert (found.better, found.worse) == ((differences > 0).sum(), (differences < 0).sum())
    assert found.equal == len(differences) - len(apart)
    if not len(apart):
        assert (found.p, found.effect) == (1.0, 0.0)
        return
    ranks = rankdata(np.abs(apart))
    assert found.w == ranks[apart > 0].sum()
    assert found.effect == pytest.approx(np.sum(ranks * np.sign(apart)) / ranks.sum())
    seen = abs(found.w - ranks.sum() / 2)
    sums = [sum(rank for rank, one in zip(ranks, signs, strict=True) if one)
            for signs in product([0, 1], repeat=len(ranks))]  # fmt: skip
    extreme = sum(abs(one - ranks.sum() / 2) >= seen - 1e-9 for one in sums)
    assert found.p == pytest.approx(extreme / len(sums))
    assert found.least <= found.p


@pytest.mark.parametrize("count", [12, 60, 300])
def test_without_ties_the_signed_rank_test_is_scipys_exact_one(count: int) -> None:
    from scipy import stats

    differences = np.random.default_rng(count).normal(0.1, 1, count)
    found = compute_signed_rank(differences)
    assert found.method == "exact"
    assert found.p == pytest.approx(float(stats.wilcoxon(differences, method="exact").pvalue), rel=1e-9)


def test_the_signed_rank_test_of_many_pairs_is_approximated() -> None:
    differences = np.random.default_rng(3).integers(-4, 6, 700).astype(float)
    many, fewer = compute_signed_rank(differences), compute_signed_rank(differences[:520])
    assert many.method == "normal approximation"
    assert fewer.method == "exact", "pairs without a difference do not count"
    assert many.p < 1e-3


def test_the_signed_rank_test_of_thousands_of_pairs_is_not_slow_or_infinite() -> None:
    found = compute_signed_rank(np.random.default_rng(4).normal(1e300, 1e300, 20_000))
    assert found.p < 1e-4
    assert 0 < found.effect < 1
