"""Tags and notes in the window."""

import json
import shutil
from pathlib import Path
from typing import Any

import pytest
from starlette.applications import Starlette

from swarmwright import Run
from swarmwright.ui.app import create_app
from tests.python.ui.client import Answer, call


def annotate(app: Starlette, values: dict[str, Any]) -> Answer:
    return call(
        app,
        "/api/annotate",
        method="POST",
        headers={"content-type": "application/json"},
        body=json.dumps(values).encode(),
    )


@pytest.fixture
def own(two_runs: Path, complete_list: None, tmp_path: Path) -> Path:  # noqa: ARG001 - a fixture
    shutil.copytree(two_runs, tmp_path / "runs")
    return tmp_path / "runs"


def test_runs_are_tagged_and_noted(own: Path) -> None:
    app = create_app(own, token=None)
    assert annotate(app, {"runs": ["run-1", "run-2"], "add": "thesis, <b>noise</b>"}).status == 200
    assert annotate(app, {"runs": ["run-1"], "remove": "thesis", "note": "good"}).status == 200
    assert call(app, "/api/notes", run="run-1").values == {"tags": ["<b>noise</b>"], "note": "good"}
    assert Run(own / "run-2").tags == ("thesis", "<b>noise</b>")


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"runs": ["run-1", "run-2"], "note": "x"}, "note: is that of a single run"),
        ({"runs": ["run-1"], "note": 3}, "note: must be text"),
        ({"runs": ["run-1"], "add": ["x"]}, "add: must be text"),
        ({"runs": ["run-1"], "add": "x" * 51}, "tags: "),
        ({"runs": ["../run-1"], "add": "x"}, "no such run"),
        ({"runs": [], "add": "x"}, "runs: choose 1 to 500"),
    ],
)
def test_mistakes_change_nothing(own: Path, values: dict[str, Any], message: str) -> None:
    answer = annotate(create_app(own, token=None), values)
    assert answer.status == 422
    assert message in answer.values["error"]
    assert Run(own / "run-1").tags == ()


def test_a_damaged_file_leaves_the_run_in_the_list(own: Path) -> None:
    (own / "run-1" / "notes.json").write_text("{")
    app = create_app(own, token=None)
    assert call(app, "/api/run", run="run-1").status == 200
    assert "notes.json: must be JSON" in call(app, "/api/notes", run="run-1").values["error"]
