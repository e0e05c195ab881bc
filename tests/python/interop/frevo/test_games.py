"""FREVO's Pong and soccer as simulations: results, scores and orders of the same candidates are FREVO's."""

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from swarmwright import Controller
from swarmwright.methods.rankings.match_scores import score_matches
from swarmwright.methods.rankings.pairings import PAIRINGS, PairingOptions, Pairs, Results
from swarmwright.simulations.base import Simulation
from swarmwright.simulations.loading import load
from swarmwright.testing import check_simulation
from tests.python.methods.rankings.java_random import JavaRandom
from tests.python.methods.rankings.tournaments import play

CLASSES = {"pong": "Pong", "soccer": "Soccer"}
SENSORS = {"pong": 3, "soccer": 16}
ACTUATORS = {"pong": 1, "soccer": 4}
OUTCOMES: dict[str, Callable[[Any], list[float]]] = {
    "pong": lambda game: game.goals,
    "soccer": lambda game: [
        *(game.measure()[f"{side}_result"] for side in ("left", "right")),
        *game.scores(),
    ],
}
"""What FREVO's matches have, beginning with the fitness of both."""


def read_cases() -> Iterator[Any]:
    for name in CLASSES:
        file = Path(__file__).with_name(f"frevo_{name}.json")
        for case in json.loads(file.read_text())["cases"]:
            yield pytest.param({**case, "game": name}, id=f"{name}-{len(case['weights'])}")


@pytest.fixture(params=read_cases())
def case(request: pytest.FixtureRequest) -> Any:
    return request.param


@pytest.fixture
def outcomes(root: Path, case: dict[str, Any]) -> Callable[[Pairs, list[int]], Results]:
    """Plays matches with these seeds; returns what FREVO's have, too."""
    kind = load(f"{root}/experiments/frevo/{case['game']}.py:{CLASSES[case['game']]}")
    teams = [make_controller(case["game"], weights) for weights in case["weights"]]

    def make(pairs: Pairs, seeds: list[int]) -> Results:
        results = []
        for pair, seed in zip(pairs.tolist(), seeds, strict=True):
            game: Any = kind()
            play_match(case, game, [teams[candidate] for candidate in pair], seed)
            results.append(OUTCOMES[case["game"]](game))
        return np.array(results, dtype=np.float64)

    return make


def make_controller(game: str, weights: list[float]) -> Controller:
    """Return a controller whose actuators are FREVO's outputs; an imported one maps them to -1 to 1."""
    return Controller(
        {
            "version": 1,
            "kind": "fully_meshed",
            "sensors": SENSORS[game],
            "actuators": ACTUATORS[game],
            "hidden": 2,
            "activation": "clamp",
            "iterations": 2,
            "output_range": [-1, 1],
            "weights": weights,
        }
    )


def play_match(case: dict[str, Any], game: Simulation, teams: list[Controller], seed: int) -> None:
    defaults = {name: parameter.default for name, parameter in type(game).parameters.items()}
    sensors = np.array(game.reset({**defaults, **case["parameters"]}, seed), dtype=np.float32)
    while not game.done():
        outputs = []
        for team, rows in zip(teams, np.split(sensors, 2), strict=True):
            team.reset()  # FREVO's games make controllers forget everything before each step
            outputs.append(team(rows))
        actions: Any = 2.0 * np.concatenate(outputs).astype(np.float64) - 1.0
        sensors = np.array(game.step(actions), dtype=np.float32)


def check_matches(expected: dict[str, Any], pairs: Pairs, rows: list[Results]) -> None:
    assert np.column_stack([pairs, np.concatenate(rows)]).tolist() == expected["matches"]


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
def test_results_and_scores_are_those_of_frevo(
    case: dict[str, Any], outcomes: Callable[..., Results], ranking: str, pairing: str, score: str
) -> None:
    expected, count = case["rankings"][ranking], len(case["weights"])
    rows: list[Results] = []

    def decide(pairs: Pairs) -> Results:
        rows.append(outcomes(pairs, [case["seed"]] * len(pairs)))
        if ranking == "MultiSwiss" and case["game"] == "soccer":
            # It reads the fitness of candidates, which SimpleSoccer sets to 1 for both, so the first wins.
            return np.ones((len(pairs), 2))
        return rows[-1][:, :2]

    played = play(pairing, count, decide, win=2.0, draw=1.0)
    check_matches(expected, played.pairs, rows)
    scores = score_matches(score, count, played.pairs, played.results, win=2.0, draw=1.0)
    check_scores(expected, scores)
    if score == "points":
        assert np.argsort(-scores, kind="stable").tolist() == expected["order"]


@pytest.mark.slow
def test_results_and_order_of_multi_sort_are_those_of_frevo(
    case: dict[str, Any], outcomes: Callable[..., Results]
) -> None:
    count = len(case["weights"])
    if count % 2:
        assert "MultiSort" not in case["rankings"]  # which needs an even number
        return
    expected = case["rankings"]["MultiSort"]
    random: Any = JavaRandom(case["seed"])
    (pairs,) = PAIRINGS["random"].rounds(count, PairingOptions(rounds=3), random)
    rows = outcomes(pairs, random.seeds[1::2])  # each match goes on with the random numbers of its draw
    check_matches(expected, pairs, [rows])
    # The games name the better of two first; MultiSort takes its result for that of whoever was drawn first.
    scores = score_matches("fitness", count, pairs, -np.sort(-rows[:, :2], axis=1))
    assert np.argsort(-scores, kind="stable").tolist() == expected["order"]
    assert [3 * scores.max(), 3 * scores.min()] == pytest.approx(expected["best_and_worst"])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "parameters"),
    [
        ("pong", {"maximumSteps": 30, "numberOfBalls": 6, "playersPerTeam": 2}),
        ("soccer", {"playersPerTeam": 11, "evaluation_time": 5000}),
    ],
)
def test_games_are_sound_simulations(root: Path, name: str, parameters: dict[str, Any]) -> None:
    check_simulation(f"{root}/experiments/frevo/{name}.py:{CLASSES[name]}", parameters)


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(CLASSES))
def test_games_have_pictures(root: Path, name: str) -> None:
    kind: Any = load(f"{root}/experiments/frevo/{name}.py:{CLASSES[name]}")
    game: Any = kind()
    game.reset({key: parameter.default for key, parameter in kind.parameters.items()}, 1)
    scene = game.scene()
    assert len(scene.bodies) == {"pong": 7, "soccer": 21}[name]
    assert all(0 <= body.x <= scene.width and 0 <= body.y <= scene.height for body in scene.bodies)
