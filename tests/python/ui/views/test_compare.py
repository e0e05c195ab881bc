"""The comparison of several runs in the window."""

import csv
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from starlette.applications import Starlette

import swarmwright
from swarmwright.analysis.league import play_league
from swarmwright.runs.post_evaluation import EvaluationOptions
from tests.python.runs.optimization.test_competing import TOURNAMENT
from tests.python.ui.client import call
from tests.python.ui.views.test_replays import post

RUNS = ["run-1", "run-2"]


def test_runs_are_compared_as_by_the_command(app: Starlette, two_runs: Path) -> None:
    values = call(app, "/api/compare", run=RUNS).values
    comparison = swarmwright.compare([two_runs / name for name in RUNS])
    assert values["text"] == str(comparison)
    assert values["latex"].count("toprule") == 1
    assert values["figure"].lstrip().startswith("<?xml")
    assert [run["id"] for run in values["values"]["groups"][0]["runs"]] == RUNS


@pytest.mark.parametrize(
    ("ending", "beginning"),
    [("svg", b"<?xml"), ("pdf", b"%PDF"), ("png", b"\x89PNG"), ("csv", b"task,group,run")],
)
def test_a_comparison_is_downloaded(app: Starlette, ending: str, beginning: bytes) -> None:
    answer = call(app, "/api/compare_file", run=RUNS, format=ending, style="ieee")
    assert answer.status == 200
    assert answer.body.startswith(beginning)
    assert answer.headers["content-disposition"] == f'attachment; filename="comparison.{ending}"'


def test_a_table_names_runs_relative_to_the_folder(app: Starlette) -> None:
    text = call(app, "/api/compare_file", run=RUNS, format="csv").body.decode()
    assert [row["run"] for row in csv.DictReader(text.splitlines())] == RUNS


def test_curves_are_drawn_over_generations(app: Starlette) -> None:
    answer = call(app, "/api/compare", run=RUNS, x="generations", at_episodes=200, unfinished="true")
    assert "<svg" in answer.values.get("figure", ""), answer.body[:300]


@pytest.mark.parametrize(
    ("query", "message"),
    [
        ({}, "run: choose 1 to 500 runs"),
        ({"run": ["run-1"] * 501}, "run: choose 1 to 500 runs"),
        ({"run": "../run-1"}, "no such run"),
        ({"run": "run-1", "at": "soon"}, "at: must be a whole number"),
        ({"run": "run-1", "at": "9" * 300}, "at: must be a whole number"),
        ({"run": "run-1", "at": "0"}, "at: must be at least 1"),
        ({"run": "run-1", "at": "50", "at_episodes": "50"}, "at_episodes: "),
        ({"run": "run-1", "by": "luck"}, "by: must be one of fitness"),
        ({"run": "run-1", "by": "hypervolume"}, "has no hypervolume"),
        ({"run": "run-1", "metrics": "true"}, "has no metric in common"),
        ({"run": "run-1", "x": "<b>"}, "x: "),
        ({"run": "run-1", "style": "x" * 5000}, "style: must be one of"),
        ({"run": "run-1", "width": "1e9"}, "width: "),
        ({"run": "run-1", "width": "nan"}, "width: "),
    ],
)
def test_wrong_requests_are_told_why(app: Starlette, query: dict[str, Any], message: str) -> None:
    for name in ("compare", "compare_file"):
        answer = call(app, f"/api/{name}", **query, format="png")
        assert answer.status == 422
        assert message in answer.values["error"]
        assert len(answer.values["error"]) < 1000


@pytest.mark.parametrize("ending", ["", "exe", "../svg", "x" * 1000])
def test_other_formats_are_refused(app: Starlette, ending: str) -> None:
    answer = call(app, "/api/compare_file", run=RUNS, format=ending)
    assert answer.status == 422
    assert answer.values["error"].startswith("format: must be one of svg, pdf, png, csv")


def test_a_league_is_that_of_the_command(tmp_path: Path, open_app: Callable[[Path], Starlette]) -> None:
    for seed in (1, 2, 3):
        swarmwright.optimize(
            TOURNAMENT, servers="in-process", seed=seed, out=tmp_path / "sub" / f"run-{seed}"
        )
    runs = [f"sub/run-{seed}" for seed in (1, 2, 3)]
    app = open_app(tmp_path)
    assert call(app, "/api/compare", run=runs).values["can_play"]
    values = post(app, "league", runs=runs, episodes=2).values
    where = EvaluationOptions.of(2, None, None, "in-process", None)
    league = play_league(tmp_path, None, where, runs)
    [table] = values["tables"]
    assert [table["head"], *table["rows"]] == league.cells("")
    assert values["notes"][: len(league.heading)] == league.heading


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"runs": RUNS}, "no run in it is a competition"),
        ({"runs": []}, "runs: choose 1 to 500 runs"),
        ({"runs": "run-1"}, "runs: must be a list"),
        ({"runs": [7]}, "runs: must be text"),
        ({"runs": ["../x"]}, "there is no such run"),
        ({"runs": RUNS, "episodes": 0}, "episodes: must be from 1 to 1000, not 0"),
        ({"runs": RUNS, "episodes": 10**9}, "episodes: must be from 1 to 1000"),
        ({"runs": RUNS, "episodes": "two"}, "episodes: must be a whole number"),
    ],
)
def test_leagues_that_cannot_be_played_are_refused(
    app: Starlette, values: dict[str, Any], message: str
) -> None:
    assert not call(app, "/api/compare", run=RUNS).values["can_play"]
    answer = post(app, "league", **values)
    assert (answer.status, message in answer.values["error"]) == (422, True), answer.values


def test_leagues_take_no_longer_than_the_limit(
    tmp_path: Path, open_app: Callable[[Path], Starlette], monkeypatch: pytest.MonkeyPatch
) -> None:
    for seed in (1, 2):
        swarmwright.optimize(TOURNAMENT, servers="in-process", seed=seed, out=tmp_path / f"run-{seed}")
    monkeypatch.setattr("swarmwright.ui.views.compare.LONGEST_S", 0.0)
    assert "use `swarmwright league FOLDER`" in post(open_app(tmp_path), "league", runs=RUNS).values["error"]
