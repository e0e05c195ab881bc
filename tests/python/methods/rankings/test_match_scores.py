"""Scores of tournaments."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swarmwright.methods.rankings.match_scores import SCORES, bradley_terry, score_matches
from swarmwright.methods.rankings.pairings import Pairs, Results
from tests.python.methods.rankings.tournaments import decide_by, decide_by_chance, play

KINDS = sorted(SCORES)
RANDOM_ORDER = sorted(set(SCORES) - {"elo"})


@st.composite
def matches(draw: st.DrawFn, failures: bool = True) -> tuple[int, Pairs, Results]:
    players = draw(st.integers(2, 8))
    values = [0.0, 1.0, -2.5, *([math.nan, math.inf, -math.inf] if failures else [])]
    played = draw(
        st.lists(
            st.tuples(
                st.lists(st.integers(0, players - 1), min_size=2, max_size=2, unique=True),
                st.lists(st.sampled_from(values), min_size=2, max_size=2),
            ),
            max_size=20,
        )
    )
    pairs = np.array([pair for pair, _ in played], dtype=np.intp).reshape(-1, 2)
    return players, pairs, np.array([result for _, result in played], dtype=np.float64).reshape(-1, 2)


@pytest.mark.parametrize(
    ("kind", "expected"),
    [
        ("points", [1.5, 1.5, 0.0, math.nan]),
        ("win_rate", [0.75, 0.5, 0.0, math.nan]),
        ("fitness", [2.5, 2.0, 1.0, math.nan]),
        ("order", [1.0, 1.0, 0.0, math.nan]),
        ("frevo_multi_swiss", [2.0, 4 / 3, 1.0, 1.5]),
    ],
)
def test_small_tournaments_are_scored_by_hand(kind: str, expected: list[float]) -> None:
    pairs = np.array([[0, 1], [1, 2], [0, 1], [0, 3]])
    results = np.array([[3.0, 1.0], [3.0, 1.0], [2.0, 2.0], [math.nan, 5.0]])
    np.testing.assert_allclose(score_matches(kind, 4, pairs, results), expected)


def test_points_can_be_those_of_football() -> None:
    pairs = np.array([[0, 1], [0, 1]])
    results = np.array([[1.0, 1.0], [0.0, 3.0]])
    assert score_matches("points", 2, pairs, results, win=3, draw=1).tolist() == [1.0, 4.0]


def test_elo_moves_half_of_the_factor_between_equals() -> None:
    pairs = np.array([[0, 1], [1, 0]])
    results = np.array([[1.0, 0.0], [1.0, 0.0]])
    first, second = score_matches("elo", 2, pairs[:1], results[:1])
    assert (first, second) == (16.0, -16.0)
    first, second = score_matches("elo", 2, pairs, results)
    expected = 16.0 - 32.0 * (1.0 - 1.0 / (1.0 + 10.0 ** (32.0 / 400.0)))
    assert first == pytest.approx(expected, abs=1e-6)
    assert second == -first


@pytest.mark.parametrize("kind", KINDS)
@settings(max_examples=20)
@given(tournament=matches(), seed=st.integers(0, 1000))
def test_numbers_of_candidates_do_not_matter(
    kind: str, tournament: tuple[int, Pairs, Results], seed: int
) -> None:
    players, pairs, results = tournament
    renamed = np.random.default_rng(seed).permutation(players)
    scores = score_matches(kind, players, pairs, results)
    others = score_matches(kind, players, renamed[pairs].reshape(-1, 2), results)
    np.testing.assert_allclose(others[renamed], scores, atol=1e-5)


@pytest.mark.parametrize("kind", RANDOM_ORDER)
@settings(max_examples=20)
@given(tournament=matches(), seed=st.integers(0, 1000))
def test_the_order_of_matches_does_not_matter(
    kind: str, tournament: tuple[int, Pairs, Results], seed: int
) -> None:
    players, pairs, results = tournament
    order = np.random.default_rng(seed).permutation(len(pairs))
    np.testing.assert_allclose(
        score_matches(kind, players, pairs[order], results[order]),
        score_matches(kind, players, pairs, results),
        atol=1e-5,
    )


@pytest.mark.parametrize("kind", sorted(set(SCORES) - {"frevo_multi_swiss"}))
@settings(max_examples=20)
@given(tournament=matches())
def test_sides_do_not_matter(kind: str, tournament: tuple[int, Pairs, Results]) -> None:
    players, pairs, results = tournament
    np.testing.assert_allclose(
        score_matches(kind, players, pairs[:, ::-1], results[:, ::-1]),
        score_matches(kind, players, pairs, results),
        atol=1e-5,
    )


@pytest.mark.parametrize("kind", KINDS)
@settings(max_examples=20)
@given(tournament=matches())
def test_failed_matches_are_left_out(kind: str, tournament: tuple[int, Pairs, Results]) -> None:
    players, pairs, results = tournament
    finished = np.isfinite(results).all(axis=1)
    scores = score_matches(kind, players, pairs, results)
    np.testing.assert_array_equal(scores, score_matches(kind, players, pairs[finished], results[finished]))
    played = np.bincount(pairs[finished].ravel(), minlength=players) > 0
    if kind != "frevo_multi_swiss":
        np.testing.assert_array_equal(np.isfinite(scores), played)


@pytest.mark.parametrize("kind", KINDS)
def test_nobody_has_a_score_without_matches(kind: str) -> None:
    scores = score_matches(kind, 3, np.empty((0, 2), np.intp), np.empty((0, 2)))
    if kind == "frevo_multi_swiss":
        assert scores.tolist() == [1.5] * 3
    else:
        assert np.isnan(scores).all()


@pytest.mark.parametrize("kind", sorted(set(SCORES) - {"frevo_multi_swiss"}))
@pytest.mark.parametrize("candidates", [2, 3, 8])
def test_equals_have_the_same_score(kind: str, candidates: int) -> None:
    played = play("round_robin", candidates, decide_by(np.full(candidates, 7.0)))
    assert len(set(score_matches(kind, candidates, played.pairs, played.results).tolist())) == 1


@pytest.mark.parametrize("kind", sorted(SCORES))
def test_a_round_robin_without_chance_has_the_true_order(kind: str) -> None:
    strengths = np.random.default_rng(0).permutation(30).astype(float)
    played = play("round_robin", 30, decide_by(strengths))
    scores = score_matches(kind, 30, played.pairs, played.results)
    if kind == "elo":  # depends on the order of matches
        assert np.corrcoef(scores, strengths)[0, 1] > 0.95
    else:
        assert scores.argsort().tolist() == strengths.argsort().tolist()


@pytest.mark.parametrize("kind", KINDS)
def test_opponents_from_outside_count_but_have_no_score(kind: str) -> None:
    pairs = np.array([[0, 2], [2, 1]])
    results = np.array([[1.0, 0.0], [1.0, 0.0]])
    scores = score_matches(kind, 2, pairs, results)
    assert len(scores) == 2
    assert scores[0] > scores[1]


def test_ratings_recover_strengths() -> None:
    random = np.random.default_rng(5)
    strengths = random.normal(size=20)
    decide = decide_by_chance(strengths, random)
    played = play("round_robin", 20, decide, rounds=19 * 50)
    scores = score_matches("bradley_terry", 20, played.pairs, played.results)
    expected = 400.0 / math.log(10.0) * strengths
    assert np.abs(scores - scores.mean() - (expected - expected.mean())).max() < 60.0


@settings(max_examples=20)
@given(matches(failures=False))
def test_ratings_have_the_greatest_likelihood(tournament: tuple[int, Pairs, Results]) -> None:
    """At the maximum, everybody has as many points as expected: equation 3 of the source, with the prior."""
    players, pairs, results = tournament
    prior = 0.2
    logarithms = bradley_terry(players, pairs, results, prior) * math.log(10.0) / 400.0
    excess = prior * (0.5 - 1.0 / (1.0 + np.exp(-logarithms)))
    for (first, second), (own, other) in zip(pairs.tolist(), results.tolist(), strict=True):
        won = 0.5 + 0.5 * np.sign(own - other)
        expected = 1.0 / (1.0 + math.exp(logarithms[second] - logarithms[first]))
        excess[first] += won - expected
        excess[second] -= won - expected
    assert np.abs(excess).max() < 1e-6


@pytest.mark.parametrize("candidates", [2, 30, 200])
def test_ratings_of_perfect_orders_are_finite(candidates: int) -> None:
    played = play("merge_sort", candidates, decide_by(np.arange(float(candidates))))
    ratings = score_matches("bradley_terry", candidates, played.pairs, played.results)
    assert np.isfinite(ratings).all()
    assert np.corrcoef(ratings, np.arange(candidates))[0, 1] > 0.9


def test_cycles_have_the_same_order() -> None:
    pairs = np.array([[0, 1], [1, 2], [2, 0], [2, 3]])
    results = np.tile([1.0, 0.0], (4, 1))
    assert score_matches("order", 4, pairs, results).tolist() == [1.0, 1.0, 1.0, 0.0]
