"""Missions on the drawing board: read from any mission, checked by the engine, written as YAML."""

import json
import re
from pathlib import Path
from typing import Any

import pytest

from swarmwright import Experiment, InputError, Run, templates
from swarmwright.common.yaml import dump
from swarmwright.ui.app import create_app
from swarmwright.ui.views import draw as missions
from tests.python.ui.client import Answer, call

SMALL: dict[str, Any] = {
    "title": "Small",
    "walls": {"rectangle": [2, 2]},
    "floor": {"patches": [{"name": "spot", "circle": {"center": [0.5, 0], "radius": 0.2}, "color": "black"}]},
    "start": {"disc": {"radius": 0.5}},
    "robots": 3,
    "duration": 2,
    "metrics": {"on_spot": {"kind": "robots_on", "patch": "spot"}},
    "fitness": "on_spot",
}


@pytest.mark.parametrize("name", templates.missions())
def test_every_built_in_mission_is_read_and_written_again(name: str, tmp_path: Path) -> None:
    mission = missions.parse(missions.text_of(tmp_path, name))
    assert missions.problems(mission) == []
    assert missions.parse(dump(mission)) == mission


def test_a_mission_is_saved_listed_and_opened(tmp_path: Path) -> None:
    assert missions.save(tmp_path, "mine", SMALL, replace=False) == "mine.yaml"
    assert missions.names(tmp_path)["files"] == ["mine.yaml"]
    assert missions.parse(missions.text_of(tmp_path, "mine.yaml")) == SMALL
    with pytest.raises(InputError, match="exists already"):
        missions.save(tmp_path, "mine", SMALL, replace=False)
    missions.save(tmp_path, "mine", {**SMALL, "robots": 4}, replace=True)
    (tmp_path / "experiment.yaml").write_text("simulation: minisim\n")
    with pytest.raises(InputError, match="exists already"):
        missions.save(tmp_path, "experiment", SMALL, replace=True)
    Experiment.from_mapping({"simulation": "arena", "parameters": {"mission": str(tmp_path / "mine.yaml")}})
    assert sorted(path.name for path in tmp_path.iterdir()) == ["experiment.yaml", "mine.yaml"]


@pytest.mark.parametrize("name", ["", "../out", "a/b", ".hidden", "a b", "-x", "x" * 101])
def test_names_that_are_no_names_are_refused(name: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="name: "):
        missions.save(tmp_path, name, SMALL, replace=False)
    assert [*tmp_path.iterdir()] == []


@pytest.mark.parametrize(
    ("changes", "problem"),
    [
        ({"walls": {"rectangle": [2, -2]}}, r"walls\.rectangle\[1\]: "),
        ({"walls": None}, "walls: "),
        ({"start": {"disc": {"radius": "wide"}}}, r"start\.disc\.radius: "),
        ({"fitness": "nothing"}, "fitness: no metric"),
        ({"robots": 10**9}, "robots: "),
        ({"obstacles": [{"center": [0, 0], "size": [0.1]}]}, r"obstacles\[0\]\.size: "),
        ({"unknown": 1}, "unknown"),
        ({"floor": {"patches": [{"name": "<b>", "circle": {"center": [0, 0], "radius": 1e300}}]}}, "patches"),
    ],
)
def test_mistakes_are_told_with_their_keys(changes: dict[str, Any], problem: str, tmp_path: Path) -> None:
    mission = {**SMALL, **changes}
    told = missions.problems(mission)
    assert told
    assert any(re.search(problem, line) for line in told), told
    with pytest.raises(InputError):
        missions.save(tmp_path, "mine", mission, replace=False)


@pytest.mark.parametrize(
    "text", ["", "[]", "walls: [", "a: 1\na: 2\n", "!!python/object:os.system x", "&a [*a]"]
)
def test_texts_that_are_no_missions_are_refused(text: str) -> None:
    with pytest.raises(InputError, match="mission"):
        missions.parse(text)


def test_an_episode_is_tried_with_any_controller(finished: Run) -> None:
    assert b"Small" in missions.try_out(SMALL, 1).encode() or "arena" in missions.try_out(SMALL, 1)
    with pytest.raises(InputError, match="sensors"):
        missions.try_out(SMALL, 1, finished.best.controller)
    with pytest.raises(InputError, match="duration: at most 300"):
        missions.try_out({**SMALL, "duration": 10_000}, 1)


def post(folder: Path, name: str, values: Any, *, read_only: bool = False) -> Answer:
    return call(
        create_app(folder, token=None, read_only=read_only),
        f"/api/{name}",
        method="POST",
        headers={"content-type": "application/json"},
        body=json.dumps(values).encode(),
    )


def test_the_board_and_the_text_follow_each_other(tmp_path: Path) -> None:
    answer = post(tmp_path, "mission_text", {"mission": SMALL}).values
    assert answer["problems"] == []
    assert post(tmp_path, "mission_parse", {"text": answer["text"]}).values == {
        "mission": SMALL,
        "problems": [],
    }
    assert "mission" not in post(tmp_path, "mission_parse", {"text": "walls: ["}).values


def test_a_read_only_window_draws_and_saves_nothing(tmp_path: Path) -> None:
    assert post(tmp_path, "mission_text", {"mission": SMALL}, read_only=True).status == 200
    assert post(tmp_path, "mission_save", {"mission": SMALL, "name": "x"}, read_only=True).status == 405
    assert [*tmp_path.iterdir()] == []


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("mission_text", {"mission": []}),
        ("mission_text", {}),
        ("mission_try", {"mission": SMALL, "seed": "one", "run": ""}),
        ("mission_try", {"mission": SMALL, "seed": -1, "run": ""}),
        ("mission_try", {"mission": SMALL, "seed": 1, "run": "../x"}),
        ("mission_save", {"mission": SMALL, "name": 3}),
        ("mission_parse", {"text": "\ud800"}),
        ("mission_text", {"mission": {"walls": {"a": [[[[[[1]]]]]]}, "title": "\ud800"}}),
    ],
)
def test_wrong_requests_are_told_why(tmp_path: Path, name: str, values: Any) -> None:
    answer = post(tmp_path, name, values)
    assert answer.status == 422 or answer.values["problems"]
