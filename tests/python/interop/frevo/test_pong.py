"""FREVO's Pong as a simulation: goals, scores and orders of the same candidates as FREVO's."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from swarmwright import Controller
from swarmwright.methods.rankings.match_scores import score_matches
from swarmwright.methods.rankings.pairings import PAIRINGS, PairingOptions, Pairs, Results
from swarmwright.simulations.loading import load
from swarmwright.testing import check_simulation
from tests.python.methods.rankings.java_random import JavaRandom
from tests.python.methods.rankings.tournaments import play

CASES: list[dict[str, Any]] = json.loads(Path(__file__).with_name("frevo_pong.json").read_text())["cases"]
Goals = Callable[[Pairs, list[int]], Results]


@pytest.fixture(scope="module")
def pong(root: Path) -> str:
    return f"{root}/experiments/frevo/pong.py:Pong"


@pytest.fixture(params=CASES, ids=lambda case: f"{len(case['weights'])} candidates", scope="module")
def case(request: pytest.FixtureRequest) -> Any:
    return request.param


@pytest.fixture
def goals(pong: str, case: dict[str, Any]) -> Goals:
    """Plays matches with these seeds; returns the goals of both."""

    def make(pairs: Pairs, seeds: list[int]) -> Results:
        results = [
            play_match(pong, case, (first, second), seed)
            for (first, second), seed in zip(pairs.tolist(), seeds, strict=True)
        ]
        return np.array(results, dtype=np.float64)

    return make


def play_match(pong: str, case: dict[str, Any], candidates: tuple[int, int], seed: int) -> list[int]:
    game: Any = load(pong)()
    teams = [specify(case["weights"][candidate]) for candidate in candidates]
    sensors = np.array(game.reset(case["parameters"], seed), dtype=np.float32)
    while not game.done():
        actions = []
        for team, rows in zip(teams, np.split(sensors, 2), strict=True):
            team.reset()  # FREVO's Pong makes controllers forget everything before each step
            actions.append(team(rows))
        sensors = np.array(game.step(np.concatenate(actions)), dtype=np.float32)
    return list(game.goals)


def specify(weights: list[float]) -> Controller:
    return Controller(
        {
            "version": 1,
            "kind": "fully_meshed",
            "sensors": 3,
            "actuators": 1,
            "hidden": 2,
            "activation": "clamp",
            "iterations": 2,
            "output_range": [0, 1],
            "weights": weights,
        }
    )


def check_matches(expected: dict[str, Any], pairs: Pairs, results: Results) -> None:
    assert np.column_stack([pairs, results]).tolist() == expected["matches"]


def check_scores(expected: dict[str, Any], scores: NDArray[np.float64]) -> None:
    np.testing.assert_allclose(scores[expected["order"]], expected["scores"], rtol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("ranking", "pairing", "score"),
    [
        ("FullTournament", "frevo_full_tournament", "points"),
        ("SwissSystem", "frevo_swiss_system", "points"),
        ("MultiSwiss", "frevo_multi_swiss", "frevo_multi_swiss"),
    ],
)
def test_goals_and_scores_are_those_of_frevo(
    case: dict[str, Any], goals: Goals, ranking: str, pairing: str, score: str
) -> None:
    expected, count = case["rankings"][ranking], len(case["weights"])
    played = play(pairing, count, lambda pairs: goals(pairs, [case["seed"]] * len(pairs)), win=2.0, draw=1.0)
    check_matches(expected, played.pairs, played.results)
    scores = score_matches(score, count, played.pairs, played.results, win=2.0, draw=1.0)
    check_scores(expected, scores)
    if score == "points":
        assert np.argsort(-scores, kind="stable").tolist() == expected["order"]


@pytest.mark.slow
def test_goals_and_order_of_multi_sort_are_those_of_frevo(case: dict[str, Any], goals: Goals) -> None:
    count = len(case["weights"])
    if count % 2:
        pytest.skip("FREVO's MultiSort needs an even number")
    expected = case["rankings"]["MultiSort"]
    random: Any = JavaRandom(case["seed"])
    (pairs,) = PAIRINGS["random"].rounds(count, PairingOptions(rounds=3), random)
    results = goals(pairs, random.seeds[1::2])  # each match goes on with the random numbers of its draw
    check_matches(expected, pairs, results)
    # Pong names the better of two first; MultiSort takes its result for that of whoever was drawn first.
    scores = score_matches("fitness", count, pairs, -np.sort(-results, axis=1))
    assert np.argsort(-scores, kind="stable").tolist() == expected["order"]
    assert [3 * scores.max(), 3 * scores.min()] == pytest.approx(expected["best_and_worst"])


@pytest.mark.slow
def test_pong_is_a_sound_simulation(pong: str) -> None:
    check_simulation(pong, {"maximumSteps": 30, "numberOfBalls": 6, "playersPerTeam": 2})
