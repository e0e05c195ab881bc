"""Pairings of tournaments."""

import math
from itertools import combinations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmwright.methods.rankings.match_scores import score_matches
from swarmwright.methods.rankings.pairings import PAIRINGS, PairingOptions, Pairs, Results
from tests.python.methods.rankings.tournaments import decide_by, decide_by_chance, play

SWISS = ["swiss", "multi_swiss", "frevo_swiss_system"]


@st.composite
def tournaments(draw: st.DrawFn) -> tuple[str, int, PairingOptions, int]:
    return (
        draw(st.sampled_from(sorted(PAIRINGS))),
        draw(st.integers(1, 20)),
        PairingOptions(
            rounds=draw(st.none() | st.integers(1, 25)),
            sessions=draw(st.integers(1, 4)),
        ),
        draw(st.integers(0, 2**32)),
    )


def decide_wildly(seed: int) -> object:
    """Wins, draws, losses and failures without any reason, the same for the same seed."""
    random = np.random.default_rng(seed)

    def decide(pairs: Pairs) -> Results:
        values = np.array([0.0, 1.0, 2.0, math.nan, math.inf])
        return values[random.choice(5, (len(pairs), 2), p=[0.4, 0.2, 0.2, 0.1, 0.1])]

    return decide


@given(tournaments())
def test_whatever_happens_pairings_keep_their_promises(
    tournament: tuple[str, int, PairingOptions, int],
) -> None:
    kind, candidates, options, seed = tournament
    played = play(kind, candidates, decide_wildly(seed), seed, **vars(options))  # type: ignore[arg-type]
    pairs = played.pairs
    assert all(len(matches) > 0 and matches.dtype == np.intp for matches in played.rounds)
    assert (pairs[:, 0] != pairs[:, 1]).all()
    assert pairs.min(initial=0) >= 0
    assert pairs.max(initial=-1) < candidates
    assert (pairs.min(axis=1) < candidates).all()
    counts = np.bincount(pairs.ravel(), minlength=candidates)[:candidates]
    assert counts.max() <= PAIRINGS[kind].most_matches(candidates, options)
    replayed = play(kind, candidates, decide_wildly(seed), seed, **vars(options))  # type: ignore[arg-type]
    assert replayed.pairs.tobytes() == pairs.tobytes()


@pytest.mark.parametrize("kind", sorted(PAIRINGS))
def test_a_single_candidate_has_no_match(kind: str) -> None:
    assert play(kind, 1, decide_by(np.zeros(1))).rounds == []


@pytest.mark.parametrize("kind", sorted(set(PAIRINGS) - {"frevo_multi_swiss"}))
def test_two_candidates_meet(kind: str) -> None:
    assert {0, 1} in [set(pair) for pair in play(kind, 2, decide_by(np.zeros(2))).pairs.tolist()]


@pytest.mark.parametrize("kind", ["round_robin", "frevo_full_tournament"])
@pytest.mark.parametrize("candidates", [2, 3, 4, 7, 16, 25])
def test_all_meet_once_in_a_round_robin(kind: str, candidates: int) -> None:
    played = play(kind, candidates, decide_by(np.zeros(candidates)))
    assert len(played.rounds) == 1
    assert sorted(tuple(sorted(pair)) for pair in played.pairs.tolist()) == list(
        combinations(range(candidates), 2)
    )


@given(st.integers(2, 25), st.integers(1, 60))
def test_sides_and_opponents_are_balanced_in_a_round_robin(candidates: int, rounds: int) -> None:
    pairs = play("round_robin", candidates, decide_by(np.zeros(candidates)), rounds=rounds).pairs
    assert len(pairs) == rounds * (candidates // 2)
    meetings = np.zeros((candidates, candidates), int)
    np.add.at(meetings, tuple(pairs.T), 1)
    both = (meetings + meetings.T)[np.triu_indices(candidates, 1)]
    assert both.max() - both.min() <= 1
    if rounds % (candidates - 1 + candidates % 2) == 0:
        assert np.abs(meetings.sum(axis=0) - meetings.sum(axis=1)).max() <= 1
    else:
        assert np.abs(meetings - meetings.T).max() <= 1


@given(st.integers(2, 20), st.integers(0, 1000), st.booleans())
def test_nobody_meets_twice_in_swiss_where_rounds_are_few(candidates: int, seed: int, noisy: bool) -> None:
    random = np.random.default_rng(seed)
    strengths = random.permutation(candidates).astype(float)
    decide = decide_by_chance(strengths, random) if noisy else decide_by(strengths)
    rounds = max(1, candidates // 2)  # by Dirac's theorem, all can be paired anew as long as that
    played = play("swiss", candidates, decide, seed, rounds=rounds)
    met = [tuple(sorted(pair)) for pair in played.pairs.tolist()]
    assert len(met) == rounds * (candidates // 2)
    if candidates % 2 == 0:
        assert len(set(met)) == len(met)
    counts = np.bincount(played.pairs.ravel(), minlength=candidates)
    assert counts.min() >= rounds - math.ceil(rounds / candidates)
    firsts = np.bincount(played.pairs[:, 0], minlength=candidates)
    assert np.abs(2 * firsts - counts).max() <= 4


def test_all_rounds_of_swiss_are_played_where_all_have_met() -> None:
    played = play("swiss", 4, decide_by(np.arange(4.0)), rounds=9)
    meetings = np.zeros((4, 4), int)
    np.add.at(meetings, tuple(played.pairs.T), 1)
    assert len(played.pairs) == 18
    assert (meetings + meetings.T)[np.triu_indices(4, 1)].tolist() == [3] * 6


def test_the_lowest_without_a_bye_has_the_bye() -> None:
    strengths = np.arange(9.0)
    played = play("swiss", 9, decide_by(strengths), rounds=9)
    byes = [({*range(9)} - {*matches.ravel().tolist()}).pop() for matches in played.rounds]
    assert sorted(byes) == list(range(9))
    assert np.mean(byes[1:4]) < 4 < np.mean(byes[-4:])


@pytest.mark.parametrize("kind", SWISS)
@pytest.mark.parametrize("candidates", [2, 3, 8, 13, 32])
def test_the_best_of_a_swiss_tournament_wins_all_its_matches(kind: str, candidates: int) -> None:
    strengths = np.random.default_rng(candidates).permutation(candidates).astype(float)
    played = play(kind, candidates, decide_by(strengths))
    rates = score_matches("win_rate", candidates, played.pairs, played.results)
    assert rates[strengths.argmax()] == 1.0


def test_players_with_the_same_points_meet_in_swiss() -> None:
    played = play("swiss", 32, decide_by(np.arange(32.0)))
    points = np.zeros(32)
    for matches in played.rounds:
        assert (points[matches[:, 0]] == points[matches[:, 1]]).all()
        points[matches.max(axis=1)] += 1.0
    assert sorted(np.bincount(points.astype(int)).tolist()) == [1, 1, 5, 5, 10, 10]


def test_sessions_of_multi_swiss_are_drawn_anew() -> None:
    played = play("multi_swiss", 8, decide_by(np.zeros(8)), sessions=2, rounds=1)
    assert [len(matches) for matches in played.rounds] == [8]
    assert {*map(frozenset, played.pairs[:4].tolist())} != {*map(frozenset, played.pairs[4:].tolist())}


@given(st.integers(1, 40), st.integers(0, 1000))
def test_merge_sort_sorts(candidates: int, seed: int) -> None:
    strengths = np.random.default_rng(seed).permutation(candidates).astype(float)
    played = play("merge_sort", candidates, decide_by(strengths), seed)
    met = [tuple(sorted(pair)) for pair in played.pairs.tolist()]
    assert len(set(met)) == len(met) <= candidates * math.ceil(math.log2(max(candidates, 2)))
    assert len(played.rounds) <= candidates + math.ceil(math.log2(candidates)) - 1
    for matches in played.rounds:
        assert len(set(matches.ravel().tolist())) == matches.size
    if candidates > 1:
        scores = score_matches("order", candidates, played.pairs, played.results)
        assert scores.tolist() == strengths.tolist()


@given(st.integers(2, 20), st.integers(0, 1000))
def test_equals_stay_equal_in_merge_sort(candidates: int, seed: int) -> None:
    strengths = np.random.default_rng(seed).integers(0, 3, candidates).astype(float)
    played = play("merge_sort", candidates, decide_by(strengths), seed)
    scores = score_matches("order", candidates, played.pairs, played.results)
    assert scores.tolist() == [float((strengths < own).sum()) for own in strengths]


def test_random_opponents_differ_between_rounds() -> None:
    played = play("random", 7, decide_by(np.zeros(7)), rounds=200)
    assert len(played.pairs) == 600
    meetings = np.zeros((7, 7), int)
    np.add.at(meetings, tuple(played.pairs.T), 1)
    off_diagonal = meetings[~np.eye(7, dtype=bool)]
    assert 3 <= off_diagonal.min() <= off_diagonal.max() <= 35  # 14.3 are expected


def count_best_eight(seed: int, noise: float) -> int:
    """Return how many of the best eight of a round robin a Swiss tournament with a fifth of its matches
    finds."""
    random = np.random.default_rng(seed)
    strengths = random.normal(size=64)
    decide = decide_by_chance(strengths / noise, random) if noise else decide_by(strengths)
    best = []
    for kind, score, rounds in (("round_robin", "points", None), ("swiss", "bradley_terry", 12)):
        played = play(kind, 64, decide, seed, rounds=rounds)
        assert len(played.pairs) == (2016 if rounds is None else 384)
        scores = score_matches(score, 64, played.pairs, played.results)
        best.append(set(np.argsort(-scores, kind="stable")[:8].tolist()))
    return len(best[0] & best[1])


@pytest.mark.slow
@pytest.mark.parametrize("noise", [0.0, 1 / 25])
def test_swiss_finds_the_best_eight_of_a_round_robin(noise: float) -> None:
    """The strengths of 64 players are normally distributed; a player wins against one that is weaker by a
    standard deviation with the odds exp(1 / noise) to 1.

    Measured: without noise a median of 8 and a mean of 7.7; with 1/25, 7 and 7.4; with 1/12, 7 and 7.2.
    """
    counts = [count_best_eight(seed, noise) for seed in range(100)]
    assert np.median(counts) >= 7
