"""Missions on the drawing board: read from any mission, checked by the engine, written as YAML."""

import json
import os
import re
from pathlib import Path
from typing import Any

import pytest

from swarmwright import Experiment, InputError, Run, templates
from swarmwright.common.yaml import dump
from swarmwright.ui.app import create_app
from swarmwright.ui.drawable import is_drawable
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


NESTED: Any = 1
for _ in range(800):
    NESTED = {"a": NESTED}
EVERYTHING: dict[str, Any] = {
    "title": "Everything",
    "walls": {
        "corners": [[-2, -1], [2, -1], [2, 1], [0, 1.5], [-2, 1]],
        "height": 0.2,
        "colors": [{"side": 1, "color": "blue"}, {"side": 2, "color": "red", "from": 0.5, "to": 1}],
    },
    "obstacles": [{"center": [1, 0.5], "size": [0.05, 0.5], "angle": 30, "height": 0.1, "color": "green"}],
    "objects": [
        {"name": "ball", "radius": 0.05, "mass": 0.1, "center": [1.5, 0], "color": "cyan"},
        {
            "name": "crate",
            "size": [0.1, 0.1],
            "mass": 0.1,
            "count": 2,
            "start": {
                "disc": {"center": [1, -0.5], "radius": 0.3},
                "rectangle": {"x": [0.5, 1.5], "y": [-1, 0]},
            },
        },
    ],
    "floor": {
        "color": 0.75,
        "patches": [
            {"name": "corner", "polygon": [[-2, -1], [-1.5, -1], [-2, -0.5]], "color": "black"},
            {"name": "spot", "circle": {"center": [-1, 0.5], "radius": 0.2}, "color": "random"},
            {"name": "zone", "rectangle": {"x": [0, 0.5], "y": [-0.9, -0.5]}, "color": 0.1},
        ],
    },
    "lights": [{"at": [0, 1.2, 0.4], "intensity": 2, "color": "yellow"}],
    "start": {"disc": {"radius": 0.9}, "rectangle": {"x": [-0.9, 0], "y": [-0.6, 0.6]}},
    "robots": [
        {"name": "scout", "robot": "kilobot", "count": 4},
        {
            "name": "worker",
            "count": 2,
            "robot": {
                "radius": 0.05,
                "drive": {"kind": "car", "wheel_base": 0.06, "max_speed": 0.1, "max_steering": 30},
                "sensors": [
                    {"kind": "proximity", "angles": [-30, 0, 30], "range": 0.3},
                    {"kind": "ground", "points": [[0.02, 0.01], [0.02, -0.01]]},
                    {"kind": "range_and_bearing", "range": 1, "gives": ["count", "message"]},
                    {"kind": "battery"},
                ],
                "actuators": [{"kind": "led", "colors": ["red", "blue"]}, {"kind": "message", "numbers": 2}],
                "battery": {"standing": 100, "driving": 50, "charging": {"patch": "zone", "duration": 5}},
            },
        },
    ],
    "duration": 3,
    "failures": [{"kind": "stop", "share": 0.5, "robots": "scout", "at": 1}],
    "metrics": {
        "scouts": {"kind": "robots_on", "patch": "spot", "robots": "scout", "share": True},
        "crates": {"kind": "objects_on", "object": "crate", "patch": "corner", "when": "end"},
        "ring": {"kind": "shape_deviation", "shape": {"circle": 0.5, "fixed": True}},
        "line": {
            "kind": "shape_deviation",
            "shape": {"line": [[-1, 0], [1, 0]], "turned": True},
            "when": "end",
        },
    },
    "fitness": {"offset": 3, "factors": {"scouts": 2, "ring": -1, "order": 0.5}},
}
"""A mission with every shape and key that the board draws."""


@pytest.mark.parametrize(
    "start",
    [
        {"disc": {"center": [0.2, 0.1], "radius": 0.5}},
        {"rectangle": {"x": [-0.5, 0.5], "y": [-0.25, 0.25]}},
        {"disc": {"radius": 0.9}, "rectangle": {"x": [-0.9, 0], "y": [-0.6, 0.6]}},
    ],
)
def test_robots_are_shown_where_they_begin(start: dict[str, Any], tmp_path: Path) -> None:
    mission = {**SMALL, "walls": {"corners": [[-1, -1], [3, -1], [3, 1], [-1, 1]]}, "start": start}
    shown = missions.describe_start(mission, tmp_path, 1)
    assert len(shown["bodies"]) == 3
    for x, y, radius, _heading, _kind in shown["bodies"]:
        assert radius == pytest.approx(0.035)
        if "disc" in start:
            left, lower = start["disc"].get("center", [0, 0])
            assert ((x - left) ** 2 + (y - lower) ** 2) ** 0.5 <= start["disc"]["radius"] + 1e-4
        if "rectangle" in start:
            (left, right), (lower, upper) = start["rectangle"]["x"], start["rectangle"]["y"]
            assert left - 1e-4 <= x <= right + 1e-4
            assert lower - 1e-4 <= y <= upper + 1e-4


def test_every_shape_is_written_read_and_shown(tmp_path: Path) -> None:
    assert missions.problems(EVERYTHING, tmp_path) == []
    assert is_drawable(EVERYTHING)
    missions.save(tmp_path, "all", dump(EVERYTHING), over=False)
    assert missions.parse(missions.text_of(tmp_path, "all.yaml")) == EVERYTHING
    answer = post(tmp_path, "mission_text", {"mission": EVERYTHING, "text": "", "seed": 3}).values
    assert [body[4] for body in answer["start"]["bodies"]] == ["scout"] * 4 + ["worker"] * 2
    assert {"scouts", "crates", "ring", "line", "order"} <= set(answer["start"]["metrics"])
    values = {"mission": EVERYTHING, "seed": 3, "run": "", "fitness": ""}
    tried = post(tmp_path, "mission_try", values).values
    assert len(tried["fitness"]) == len(tried["metrics"]["ring"]) == 30
    assert post(tmp_path, "mission_try", {**values, "fitness": "no_metric"}).status == 422


@pytest.mark.parametrize(
    ("text", "fitness"),
    [
        ("on_spot", "on_spot"),
        ("2 * on_spot", {"factors": {"on_spot": 2}}),
        ("3 - on_spot / 4 + order * 2", {"offset": 3, "factors": {"on_spot": -0.25, "order": 2}}),
        ("-(order - 1) * 2", {"offset": 2, "factors": {"order": -2}}),
        ("max(on_spot, 1)", None),
        ("on_spot * order", None),
        ("1 / order", None),
        ("fitness + order", None),
        ("order if on_spot > 1 else speed", None),
    ],
)
def test_a_weighted_sum_goes_into_the_mission(text: str, fitness: Any, tmp_path: Path) -> None:
    assert post(tmp_path, "mission_fitness", {"text": text}).values == {"fitness": fitness}
    if fitness is not None:
        assert missions.problems({**SMALL, "fitness": fitness}, tmp_path) == []


@pytest.mark.parametrize(
    "text", ["", "1", "on_spot +", "__import__('os')", "(" * 500, "x" * 1001, "1e999 * order"]
)
def test_expressions_that_are_none_are_refused(text: str, tmp_path: Path) -> None:
    answer = post(tmp_path, "mission_fitness", {"text": text})
    assert answer.status == 422
    assert answer.values["error"].startswith("fitness: ")


def test_robots_may_have_files_beside_the_mission(tmp_path: Path) -> None:
    (tmp_path / "runs").mkdir()
    robot = EVERYTHING["robots"][1]["robot"]
    own = {"radius": -1, "drive": robot["drive"], "sensors": robot["sensors"][:2]}
    (tmp_path / "runs" / "mine.yaml").write_text(dump(own))
    (tmp_path / "secret.yaml").write_text("radius: 1\n")
    mission = {**SMALL, "robot": "mine.yaml"}
    assert missions.problems(mission, tmp_path / "runs")[0].startswith("robot.radius: ")
    (tmp_path / "runs" / "mine.yaml").write_text(dump({**own, "radius": 0.05}))
    assert missions.problems(mission, tmp_path / "runs") == []
    kinds = {**SMALL, "robots": [{"robot": "mine.yaml", "count": 2}, {"robot": "point", "count": 1}]}
    assert len(missions.describe_start(kinds, tmp_path / "runs", 1)["bodies"]) == 3
    for name in ("../secret.yaml", str(tmp_path / "secret.yaml"), "missing.yaml", "x" * 300 + ".yaml"):
        (message,) = missions.problems({**SMALL, "robot": name}, tmp_path / "runs")
        assert message.startswith("robot: ")


@pytest.mark.parametrize("name", templates.missions())
def test_every_built_in_mission_is_read_and_written_again(name: str, tmp_path: Path) -> None:
    mission = missions.parse(missions.text_of(tmp_path, name))
    assert is_drawable(mission)
    assert missions.problems(mission, tmp_path) == []
    assert missions.parse(dump(mission)) == mission


def test_a_mission_is_saved_listed_and_opened(tmp_path: Path) -> None:
    assert missions.save(tmp_path, "mine", dump(SMALL), over=False) == "mine.yaml"
    assert missions.names(tmp_path)["files"] == ["mine.yaml"]
    assert missions.parse(missions.text_of(tmp_path, "mine.yaml")) == SMALL
    with pytest.raises(InputError, match="exists already"):
        missions.save(tmp_path, "mine", dump(SMALL), over=False)
    missions.save(tmp_path, "mine", dump({**SMALL, "robots": 4}), over=True)
    (tmp_path / "experiment.yaml").write_text("simulation: minisim\n")
    with pytest.raises(InputError, match="exists already"):
        missions.save(tmp_path, "experiment", dump(SMALL), over=True)
    Experiment.from_mapping({"simulation": "arena", "parameters": {"mission": str(tmp_path / "mine.yaml")}})
    assert sorted(path.name for path in tmp_path.iterdir()) == ["experiment.yaml", "mine.yaml"]


@pytest.mark.parametrize("name", ["", "../out", "a/b", ".hidden", "a b", "-x", "x" * 101])
def test_names_that_are_no_names_are_refused(name: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="name: "):
        missions.save(tmp_path, name, dump(SMALL), over=False)
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
    lines = missions.problems(mission, tmp_path)
    assert any(re.search(problem, line) for line in lines), lines
    with pytest.raises(InputError):
        missions.save(tmp_path, "mine", dump(mission), over=False)


@pytest.mark.parametrize(
    "text", ["", "[]", "walls: [", "a: 1\na: 2\n", "!!python/object:os.system x", "&a [*a]"]
)
def test_texts_that_are_no_missions_are_refused(text: str) -> None:
    with pytest.raises(InputError, match="mission"):
        missions.parse(text)


def test_an_episode_is_tried_with_any_controller(finished: Run, tmp_path: Path) -> None:
    page, recording = missions.try_out(SMALL, tmp_path, seed=1)
    assert "Small" in page
    assert recording.trace is not None
    assert [*recording.trace.metrics["on_spot"]] == pytest.approx(recording.fitness_so_far)
    _, judged = missions.try_out(SMALL, tmp_path, seed=1, fitness="2 * on_spot - min(order, 1)")
    assert judged.fitness_so_far != recording.fitness_so_far
    with pytest.raises(InputError, match="sensors"):
        missions.try_out(SMALL, tmp_path, seed=1, run=finished.path)


@pytest.mark.parametrize(
    ("changes", "problem"),
    [
        ({"duration": 10_000}, "duration: at most 300 s can be tried here"),
        (
            {"robots": 501, "start": {"disc": {"radius": 20}}, "walls": {"rectangle": [50, 50]}},
            "robots: at most 500",
        ),
        (
            {
                "robots": [{"robot": "point", "count": 400}],
                "duration": 100,
                "start": {"disc": {"radius": 20}},
                "walls": {"rectangle": [50, 50]},
            },
            "with 400 robots at most 75 s",
        ),
        (
            {"metrics": {f"m{number}": {"kind": "order"} for number in range(101)}, "fitness": "m1"},
            "metrics: at most",
        ),
    ],
)
def test_episodes_that_take_long_are_not_tried(changes: dict[str, Any], problem: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=problem):
        missions.try_out({**SMALL, **changes}, tmp_path, seed=1)


def post(folder: Path, name: str, values: Any, *, read_only: bool = False) -> Answer:
    return call(
        create_app(folder, token=None, read_only=read_only),
        f"/api/{name}",
        method="POST",
        headers={"content-type": "application/json"},
        body=json.dumps(values).encode(),
    )


def test_the_board_and_the_text_follow_each_other(tmp_path: Path) -> None:
    answer = post(tmp_path, "mission_text", {"mission": SMALL, "text": ""}).values
    assert answer["problems"] == []
    parsed = post(tmp_path, "mission_parse", {"text": answer["text"]}).values
    assert parsed == {"mission": SMALL, "problems": [], "start": answer["start"]}
    assert "mission" not in post(tmp_path, "mission_parse", {"text": "walls: ["}).values


def test_a_change_on_the_board_keeps_the_comments(tmp_path: Path) -> None:
    opened = dump(SMALL).replace("robots: 3", "robots: 3  # few").replace("walls:", "# square\nwalls:")
    mission = {**SMALL, "robots": 4, "obstacles": [{"center": [0.5, 0.5], "size": [0.1, 0.2]}]}
    text = post(tmp_path, "mission_text", {"mission": mission, "text": opened}).values["text"]
    assert "robots: 4  # few\n" in text
    assert "# square\nwalls:" in text
    assert missions.parse(text) == mission
    post(tmp_path, "mission_save", {"text": text, "name": "mine"})
    assert call(create_app(tmp_path, token=None), "/api/mission", name="mine.yaml").values == {"text": text}


SHAPES = [
    "walls: 5", "walls: null\nstart: null", "{rectangle: 2}", "{corners: [[1], [2, 3], [3, 4]]}",
    "{corners: {a: 1}}", "{rectangle: [2, .inf]}", "{colors: [5]}", "\nfloor: []",
    "\nfloor: {patches: {a: 1}}", "\nfloor: {patches: [null]}", "\nfloor: {patches: [{circle: 5}]}",
    "\nfloor: {patches: [{polygon: [1, 2]}]}", "\nstart: []", "\nstart: {disc: 3}", "\nobstacles: {a: 1}",
    "\nobstacles: [{center: [0, 0]}]", "\nobjects: [null]", "\nobjects: [{center: x, radius: 1}]",
    "\nlights: [{at: 3}]", "\nrobots: [null]", "\nrobots: [{robot: 3}]", "\nrobot: [1]",
    "\nrobot: {sensors: {a: b}}", "\nrobot: {sensors: [{kind: ground, points: [1]}]}",
    "\nrobot: {preset: kilobot, sensors: [1]}", "\nmetrics: [1]", "\nmetrics: {a: null}",
    "\nmetrics: {a: {shape: {line: 5}}}", "\nfitness: {factors: [1]}", "\nfailures: 5", "\nduration: .nan",
]  # fmt: skip


@pytest.mark.parametrize("shape", SHAPES)
def test_missions_of_other_shapes_are_not_drawn(shape: str, tmp_path: Path) -> None:
    walls = "" if shape.startswith("walls") else "walls: " + ("{}" if shape[0] == "\n" else "")
    answer = post(tmp_path, "mission_parse", {"text": walls + shape, "seed": 1})
    assert answer.status == 200
    assert answer.values["problems"]
    assert "mission" not in answer.values


@pytest.mark.parametrize(
    "text", ["walls: {}", "walls: {sides: -5}\nfloor: null\nmetrics: {a: {}}", "walls: {}\nx: [[]]"]
)
def test_missions_with_other_mistakes_are_drawn(text: str, tmp_path: Path) -> None:
    answer = post(tmp_path, "mission_parse", {"text": text, "seed": 1}).values
    assert answer["problems"]
    assert answer["mission"]["walls"] is not None
    assert not any("parameters.mission" in line for line in answer["problems"])


def test_aliases_cannot_make_a_mission_large(tmp_path: Path) -> None:
    items = ", ".join(["*p"] * 2000)
    text = f"{dump(SMALL)}x: &p {{polygon: [[0, 0], [1, 0], [0, 1]]}}\nobstacles: [{items}]\n"
    answer = post(tmp_path, "mission_parse", {"text": text, "seed": 1}).values
    assert answer["problems"] == ["the mission is larger than 64 KiB"]
    bomb = "\n".join(f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9 if i else ['1'])}]" for i in range(9))
    answer = post(tmp_path, "mission_parse", {"text": bomb, "seed": 1}).values
    assert answer["problems"] == ["mission: holds more than 65536 values"]


def test_a_read_only_window_draws_and_saves_nothing(tmp_path: Path) -> None:
    assert post(tmp_path, "mission_text", {"mission": SMALL, "text": ""}, read_only=True).status == 200
    assert post(tmp_path, "mission_save", {"text": dump(SMALL), "name": "x"}, read_only=True).status == 405
    assert [*tmp_path.iterdir()] == []


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("mission_text", {"mission": []}),
        ("mission_text", {}),
        ("mission_text", {"mission": SMALL, "text": 3}),
        ("mission_text", {"mission": SMALL, "text": "", "seed": "one"}),
        ("mission_text", {"mission": SMALL, "text": "", "seed": -1}),
        ("mission_text", {"mission": SMALL, "text": "", "seed": 2**70}),
        ("mission_text", {"mission": {**SMALL, "robots": [None, 3]}, "text": ""}),
        ("mission_text", {"mission": {**SMALL, "robot": "\0.yaml"}, "text": ""}),
        ("mission_text", {"mission": {**SMALL, "title": "x" * 70_000}, "text": ""}),
        ("mission_text", {"mission": SMALL | {"title": NESTED}, "text": ""}),
        ("mission_try", {"mission": SMALL | {"title": NESTED}, "seed": 1, "run": "", "fitness": ""}),
        ("mission_fitness", {"text": 3}),
        ("mission_fitness", {}),
        ("mission_try", {"mission": SMALL, "seed": 1, "run": "", "fitness": None}),
        ("mission_try", {"mission": SMALL, "seed": "one", "run": "", "fitness": ""}),
        ("mission_try", {"mission": SMALL, "seed": -1, "run": "", "fitness": ""}),
        ("mission_try", {"mission": SMALL, "seed": 1, "run": "../x", "fitness": ""}),
        ("mission_save", {"text": dump(SMALL), "name": 3}),
        ("mission_save", {"text": "walls: [", "name": "x"}),
        ("mission_parse", {"text": "\ud800"}),
        ("mission_text", {"mission": {"walls": {"a": [[[[[[1]]]]]]}, "title": "\ud800"}, "text": ""}),
    ],
)
def test_wrong_requests_are_told_why(tmp_path: Path, name: str, values: Any) -> None:
    answer = post(tmp_path, name, values)
    assert answer.status == 422 or answer.values["problems"]


def test_large_files_and_links_are_no_missions(tmp_path: Path) -> None:
    (tmp_path / "large.yaml").write_text(dump(SMALL) + "# " + "x" * 70_000)
    (tmp_path / "secret").write_text(dump(SMALL))
    (tmp_path / "link.yaml").symlink_to(tmp_path / "secret")
    os.mkfifo(tmp_path / "pipe.yaml")
    (tmp_path / "gone.yaml").symlink_to(tmp_path / "nowhere")
    assert missions.names(tmp_path)["files"] == []
    for name in ("large.yaml", "link.yaml", "pipe.yaml", "../secret.yaml"):
        with pytest.raises(InputError):
            missions.text_of(tmp_path, name)
    with pytest.raises(InputError, match="larger than 64 KiB"):
        missions.parse("a: " + "x" * (1 << 17))
