"""The tests of races against SciPy, the published ones, and what they promise."""

import json
import math
import random
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy import stats

from swarmwright.methods.rankings.race import (
    Test,
    chi_squared_tail,
    conover,
    friedman,
    ranks_of,
    student_tails,
    survivors,
    wilcoxon,
)

Scores = NDArray[np.float64]
ALL: list[Test] = ["friedman", "t", "t_holm", "t_bonferroni"]


@st.composite
def results(draw: st.DrawFn) -> Scores:
    """Scores of some candidates on some instances, with many ties or none."""
    rows, count = draw(st.integers(2, 12)), draw(st.integers(2, 9))
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    values = rng.normal(size=(rows, count)) + rng.normal(size=count) * draw(st.sampled_from([0, 0.5, 3]))
    return np.round(values, draw(st.sampled_from([0, 1, 12]))) + 0.0


@pytest.mark.parametrize("freedom", [1, 2, 3, 7, 40, 333, 1023])
def test_tails_of_the_chi_squared_distribution(freedom: int) -> None:
    for share in np.linspace(0.01, 4, 60).tolist():
        expected = stats.chi2.sf(share * freedom, freedom)
        assert chi_squared_tail(share * freedom, freedom) == pytest.approx(expected, rel=1e-10, abs=1e-13)
    assert chi_squared_tail(0, freedom) == 1


@pytest.mark.parametrize("freedom", [1, 2, 3, 11, 59, 60, 61, 1000, 60_000])
def test_tails_of_students_distribution(freedom: int) -> None:
    for t in np.linspace(-9, 9, 61).tolist():
        expected = 2 * stats.t.sf(abs(t), freedom)
        assert student_tails(t, freedom) == pytest.approx(expected, rel=1e-10, abs=1e-12)
    assert student_tails(1e200, freedom) == 0


@given(results())
def test_ranks_are_scipys(scores: Scores) -> None:
    assert ranks_of(scores).tolist() == stats.rankdata(-scores, axis=1).tolist()


@given(results().filter(lambda scores: scores.shape[1] > 2))
def test_friedmans_test_is_scipys(scores: Scores) -> None:
    if (scores == scores[:, :1]).all():
        assert friedman(ranks_of(scores)) == 1
        return
    expected = stats.friedmanchisquare(*scores.T).pvalue
    assert friedman(ranks_of(scores)) == pytest.approx(expected, rel=1e-9, abs=1e-13)


def conover_by_hand(ranks: list[list[float]], one: int, other: int) -> float:
    """Conover 1999, page 371, number by number."""
    b, k = len(ranks), len(ranks[0])
    sums = [sum(row[index] for row in ranks) for index in range(k)]
    squares = sum(rank * rank for row in ranks for rank in row)
    rest = 2 * (b * squares - sum(total * total for total in sums)) / ((b - 1) * (k - 1))
    return float(2 * stats.t.sf(abs(sums[one] - sums[other]) / math.sqrt(rest), (b - 1) * (k - 1)))


@given(results().filter(lambda scores: scores.shape[1] > 2))
def test_comparisons_are_conovers(scores: Scores) -> None:
    ranks = ranks_of(scores)
    sums = ranks.sum(axis=0)
    found = conover(ranks)
    best = int(np.argmin(sums))
    assert found[best] == 1
    if len({tuple(row) for row in ranks.tolist()}) == 1:
        assert set(found.tolist()) <= {0.0, 1.0}
        return
    for one in range(scores.shape[1]):
        expected = conover_by_hand(ranks.tolist(), one, best)
        assert found[one] == pytest.approx(expected, rel=1e-8, abs=1e-10)


@given(results())
def test_wilcoxons_test_is_scipys(scores: Scores) -> None:
    differences = scores[:, 0] - scores[:, 1]
    found = differences[differences != 0]
    if not len(found):
        assert wilcoxon(differences) == 1
        return
    exact = len(found) == len(differences) == len(set(np.abs(found).tolist()))
    method = "exact" if exact else "asymptotic"
    expected = stats.wilcoxon(differences, correction=True, method=method).pvalue
    assert wilcoxon(differences) == pytest.approx(min(expected, 1.0), rel=1e-9)


@given(results())
def test_t_tests_are_scipys(scores: Scores) -> None:
    means = scores.mean(axis=0)
    best = int(np.argmax((scores / len(scores)).sum(axis=0)))
    kept = survivors(scores, "t", 0.05)
    for one in np.flatnonzero(means < means[best] - 1e-9).tolist():
        differences = scores[:, best] - scores[:, one]
        if np.ptp(differences) > 1e-9:
            assert kept[one] == (stats.ttest_rel(scores[:, best], scores[:, one]).pvalue >= 0.05)
    assert kept[best]


@pytest.mark.parametrize("test", ALL)
@given(scores=results())
@settings(max_examples=40)
def test_the_best_stays_and_so_does_what_equals_it(test: Test, scores: Scores) -> None:
    best = int(np.argmin(ranks_of(scores).sum(axis=0)))
    if test != "friedman":
        best = int(np.argmax((scores / len(scores)).sum(axis=0)))
    doubled = np.concatenate([scores, scores[:, [best]]], axis=1)
    for level in (0.05, 0.5, 0.999):
        if test != "friedman" or scores.shape[1] > 2:
            assert survivors(scores, test, level)[best]
        kept = survivors(doubled, test, level)
        assert kept.any()
        assert kept[best] == kept[-1]


@pytest.mark.parametrize("test", ALL)
@given(results(), st.randoms())
@settings(max_examples=30)
def test_the_order_of_candidates_and_instances_does_not_count(
    test: Test, scores: Scores, shuffle: random.Random
) -> None:
    columns, rows = list(range(scores.shape[1])), list(range(len(scores)))
    shuffle.shuffle(columns)
    shuffle.shuffle(rows)
    kept = survivors(scores, test, 0.1)
    again = survivors(scores[rows][:, columns], test, 0.1)
    assert int(kept.sum()) == int(again.sum()) or test != "friedman"
    if test == "friedman" and scores.shape[1] > 2:
        assert again.tolist() == kept[columns].tolist()


@pytest.mark.parametrize("test", ALL)
def test_the_clearly_worse_go_and_the_clearly_best_stays_alone(test: Test) -> None:
    rng = np.random.default_rng(3)
    for count in (2, 3, 20):
        scores = rng.normal(scale=0.01, size=(6, count)) - np.minimum(np.arange(count), 1)
        kept = survivors(scores, test, 0.05)
        assert kept[0]
        if test == "friedman" and count == 20:
            # Conover's comparison is about ranks: those next to the best one's are not far from it.
            assert kept.sum() < 20
        else:
            assert kept.tolist() == [True] + [False] * (count - 1)


@pytest.mark.slow
def test_equal_candidates_are_dropped_at_the_rate_of_the_level() -> None:
    """Of Friedman's test: any of them, at one test."""
    rng = np.random.default_rng(5)
    trials = 3000
    for rows, count in ((10, 4), (10, 12), (30, 6)):
        dropped = sum(
            not survivors(rng.normal(size=(rows, count)), "friedman", 0.05).all() for _ in range(trials)
        )
        # The chi-squared distribution is an approximation, a little on the safe side for few instances.
        assert 0.025 < dropped / trials < 0.065, (rows, count)


def test_with_correction_equal_candidates_are_rarely_dropped_by_t_tests() -> None:
    """Against the best of the sample, without a correction, many more would be."""
    rng = np.random.default_rng(6)
    samples = [rng.normal(size=(15, 10)) for _ in range(400)]
    rate = {
        test: sum(not survivors(one, test, 0.05).all() for one in samples) / len(samples)
        for test in ("t", "t_holm", "t_bonferroni")
    }
    assert rate["t_bonferroni"] <= rate["t_holm"] < 0.3 < rate["t"]


def test_there_is_nothing_to_test() -> None:
    for test in ALL:
        assert survivors(np.zeros((4, 1)), test, 0.5).tolist() == [True]
        assert survivors(np.zeros((4, 3)), test, 0.9).all()
        assert survivors(np.array([[3.0, 2.0, 1.0]]), test, 0.9).all() or test == "friedman"
    assert survivors(np.zeros((4, 2)), "friedman", 0.9).all()
    huge = np.array([[1.7e308, -1.7e308, 0.0]] * 6)
    assert survivors(huge, "friedman", 0.05).tolist() == [True, False, False]
    assert survivors(huge, "t", 0.05)[0]


CASES = json.loads(Path(__file__).with_name("irace_races.json").read_text())


@pytest.mark.parametrize("test", ["friedman"])
def test_those_that_irace_keeps_are_kept(test: Test) -> None:
    """Costs of candidates, and which of them irace 3.5 keeps: made with its own function."""
    assert len(CASES) >= 100
    for case in CASES:
        kept = survivors(-np.array(case["costs"], np.float64), test, 1 - case["confidence"])
        assert kept.tolist() == case["kept"], case
