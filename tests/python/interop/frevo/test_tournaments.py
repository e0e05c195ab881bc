"""Sessions of FREVO whose candidates meet."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from swarmwright import InputError, frevo, optimize
from swarmwright.methods.rankings.tournament import TournamentOptions

DUEL = """
import numpy as np
from swarmwright import Group, Side, Simulation

class Duel(Simulation):
    title = "duel"
    groups = {"left": Group(1, 2, 1), "right": Group(1, 2, 1)}
    sides = {"left": Side(fitness="left_goals"), "right": Side(fitness="right_goals")}
    metrics = {"left_goals": "", "right_goals": ""}
    def reset(self, parameters, seed):
        self.actions = np.zeros(2)
        self.steps = 0
        return np.full((2, 2), 0.5)
    def step(self, actions):
        self.actions = np.asarray(actions)[:, 0]
        self.steps += 1
        return np.full((2, 2), 0.5)
    def done(self):
        return self.steps == 3
    def measure(self):
        return {"left_goals": float(self.actions[0]), "right_goals": float(self.actions[1])}
    def fitness(self):
        return float(self.actions[0] - self.actions[1])
"""
Load = Callable[..., Any]


@pytest.fixture
def load(tmp_path: Path) -> Load:
    (tmp_path / "duel.py").write_text(DUEL)

    def make(ranking: str, *entries: str, simulation: str | None = str(tmp_path / "duel.py:Duel")) -> Any:
        path = tmp_path / "pong.zse"
        problem = "pong.Pong" if simulation else "emergencyexit.EmergencyExit"
        source = "" if simulation else '<problementry key="fieldsource" type="ENUM" value="RANDOM_FIELD"/>'
        path.write_text(
            f'<frevo><problem class="{problem}">{source}</problem><method class="nnga.NNGA"/>'
            '<representation class="threeLayerNetwork.ThreeLayerNetwork"/>'
            f'<ranking class="{ranking}">{"".join(entries)}</ranking></frevo>'
        )
        return frevo.load(path, simulation=simulation)

    return make


def entry(key: str, value: object) -> str:
    return f'<rankingentry key="{key}" type="INT" value="{value}"/>'


@pytest.mark.parametrize(
    ("ranking", "entries", "expected"),
    [
        (
            "fulltournament.FullTournament",
            [entry("parallelthreads", 4)],
            {"pairing": "frevo_full_tournament", "score": "points", "win": 2, "draw": 1},
        ),
        (
            "swissSystem.SwissSystem",
            [],
            {"pairing": "frevo_swiss_system", "score": "points", "win": 2, "draw": 1},
        ),
        (
            "swissSystem.SwissSystem",
            [entry("points_win", 3), entry("points_tie", 0)],
            {"pairing": "frevo_swiss_system", "score": "points", "win": 3, "draw": 0},
        ),
        ("MultiSwiss.MultiSwiss", [], {"pairing": "frevo_multi_swiss", "score": "frevo_multi_swiss"}),
        ("MultiSort.MultiSort", [], {"pairing": "random", "rounds": 10, "score": "fitness"}),
        (
            "MultiSort.MultiSort",
            [entry("evaluation_times", 4)],
            {"pairing": "random", "rounds": 4, "score": "fitness"},
        ),
    ],
)
def test_tournaments(load: Load, ranking: str, entries: list[str], expected: dict[str, Any]) -> None:
    imported = load(ranking, *entries)
    ranking_options = imported.experiment.ranking
    assert isinstance(ranking_options, TournamentOptions)
    assert list(ranking_options.sides) == ["left", "right"]
    assert ranking_options.both_sides is False
    assert {key: getattr(ranking_options, key) for key in expected} == expected
    assert not any("unknown to FREVO" in note for note in imported.notes)
    assert f"# {ranking}" in imported.yaml
    assert any("games are for two" in note for note in imported.notes) == ranking.startswith("Multi")


@pytest.mark.parametrize(
    "ranking",
    [
        "fulltournament.FullTournament",
        "swissSystem.SwissSystem",
        "MultiSwiss.MultiSwiss",
        "MultiSort.MultiSort",
    ],
)
def test_imported_tournaments_evolve(load: Load, tmp_path: Path, ranking: str) -> None:
    experiment = load(ranking).experiment.replace(
        method={"population": 7, "generations": 2}, servers="in-process"
    )
    run = optimize(experiment, out=tmp_path / "run")
    assert run.best.fitness >= 0


def test_emergency_exit_has_no_opponents(load: Load) -> None:
    with pytest.raises(
        InputError, match="SwissSystem is for candidates that meet, which Emergency Exit has not"
    ):
        load("swissSystem.SwissSystem", simulation=None)


def test_points_are_whole_numbers(load: Load) -> None:
    with pytest.raises(InputError, match="points_win"):
        load("swissSystem.SwissSystem", entry("points_win", "2.5"))
    with pytest.raises(InputError, match="points_win"):
        load("swissSystem.SwissSystem", entry("points_win", 0))


GAMES = {
    "pong.Pong": ("pong.py:Pong", 'key="paddleSpeed" type="FLOAT" value="2f"', "paddleSpeed", 2.0),
    "components.simplesoccer.SimpleSoccer": (
        "soccer.py:Soccer",
        'key="evaluation_time" type="INT" value="9000"',
        "evaluation_time",
        9000,
    ),
}


@pytest.mark.parametrize("problem", sorted(GAMES))
@pytest.mark.parametrize(
    ("representation", "forgets"),
    [("threeLayerNetwork.ThreeLayerNetwork", False), ("fullyMeshedNet.FullyMeshedNet", True)],
)
def test_games_keep_their_entries(
    root: Path, tmp_path: Path, problem: str, representation: str, forgets: bool
) -> None:
    name, attributes, key, value = GAMES[problem]
    path = tmp_path / "game.zse"
    path.write_text(
        f'<frevo><problem class="{problem}"><problementry {attributes}/>'
        '<problementry key="playersPerTeam" type="INT" value="4"/>'
        '<problementry key="controller_model" type="ENUM" value="NEARESTINFOPLAYER"/></problem>'
        f'<method class="nnga.NNGA"/><representation class="{representation}"/>'
        '<ranking class="swissSystem.SwissSystem"/></frevo>'
    )
    imported = frevo.load(path, simulation=f"{root}/experiments/frevo/{name}")
    assert imported.experiment.parameters == {key: value, "playersPerTeam": 4}
    assert "# not imported: controller_model = NEARESTINFOPLAYER" in imported.yaml
    assert any("controllers forget everything in each step" in note for note in imported.notes) == forgets
    path.write_text(path.read_text().replace('value="4"', 'value="four"'))
    with pytest.raises(InputError, match=r"problem.playersPerTeam: 'four' found, expected a whole number"):
        frevo.load(path, simulation=f"{root}/experiments/frevo/{name}")
