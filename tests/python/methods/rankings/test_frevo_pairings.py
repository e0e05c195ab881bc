"""Tournaments of FREVO, compared with its own orders and scores; the JSON file says how they came about."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from swarmwright.methods.rankings.absolute import Absolute, AbsoluteOptions
from swarmwright.methods.rankings.match_scores import score_matches
from swarmwright.methods.rankings.pairings import PAIRINGS, PairingOptions, Pairs, Results
from tests.python.methods.rankings.java_random import JavaRandom
from tests.python.methods.rankings.tournaments import Tournament, play

CASES: list[dict[str, Any]] = json.loads(Path(__file__).with_name("frevo_rankings.json").read_text())["cases"]


def cases_of(ranking: str) -> pytest.MarkDecorator:
    cases = [case for case in CASES if case["ranking"] == ranking]
    assert {case["candidates"] % 2 for case in cases} == ({0} if ranking == "MultiSort" else {0, 1})
    return pytest.mark.parametrize(
        "case", cases, ids=lambda case: f"{case['candidates']}-{case['modulus']}-{case.get('points_win', '')}"
    )


def decide(case: dict[str, Any], pairs: Pairs) -> Results:
    firsts, seconds = pairs.T
    both = firsts * seconds
    offset, modulus = case["offset"], case["modulus"]
    return np.column_stack(
        [
            (73 * firsts + 151 * seconds + 31 * both + offset) % modulus,
            (57 * firsts + 97 * seconds + 13 * both + 3 * offset) % modulus,
        ]
    ).astype(np.float64)


def play_case(case: dict[str, Any], pairing: str, **options: float | None) -> Tournament:
    played = play(pairing, case["candidates"], lambda pairs: decide(case, pairs), **options)
    assert len(played.pairs) == case["matches"]
    return played


def check_scores(case: dict[str, Any], scores: NDArray[np.float64]) -> None:
    np.testing.assert_allclose(scores[case["order"]], case["scores"], rtol=1e-11)


def check_order(case: dict[str, Any], scores: NDArray[np.float64]) -> None:
    """Equals stay in the order of the population."""
    assert np.argsort(-scores, kind="stable").tolist() == case["order"]


@cases_of("AbsoluteRanking")
def test_absolute_ranking(case: dict[str, Any]) -> None:
    candidates = np.arange(case["candidates"])
    fitness = (73 * candidates**2 + case["offset"]) % case["modulus"]
    scores = Absolute(AbsoluteOptions()).score(fitness[:, None].astype(np.float64))
    check_scores(case, scores)
    check_order(case, scores)


@cases_of("FullTournament")
def test_full_tournament(case: dict[str, Any]) -> None:
    played = play_case(case, "frevo_full_tournament")
    scores = score_matches("points", case["candidates"], played.pairs, played.results, win=2, draw=1)
    check_scores(case, scores)
    check_order(case, scores)


@cases_of("SwissSystem")
def test_swiss_system(case: dict[str, Any]) -> None:
    win = case["points_win"]
    played = play_case(case, "frevo_swiss_system", win=win, draw=1)
    scores = score_matches("points", case["candidates"], played.pairs, played.results, win=win, draw=1)
    check_scores(case, scores)
    check_order(case, scores)


@cases_of("MultiSwiss")
def test_multi_swiss(case: dict[str, Any]) -> None:
    """FREVO leaves equals in the order of an earlier standing."""
    played = play_case(case, "frevo_multi_swiss")
    check_scores(case, score_matches("frevo_multi_swiss", case["candidates"], played.pairs, played.results))


@cases_of("MultiSort")
def test_multi_sort(case: dict[str, Any]) -> None:
    """FREVO adds up fitness in ten rounds, of which `fitness` is the mean."""
    draws: Any = JavaRandom(case["seed"])
    (pairs,) = PAIRINGS["random"].rounds(case["candidates"], PairingOptions(rounds=10), draws)
    assert len(pairs) == case["matches"]
    scores = score_matches("fitness", case["candidates"], pairs, decide(case, pairs))
    check_order(case, scores)
    np.testing.assert_allclose([10 * scores.max(), 10 * scores.min()], case["best_and_worst"], rtol=1e-6)
