"""Tags and notes in the window."""

import errno
import json
import os
import shutil
from pathlib import Path
from typing import Any

import pytest
from starlette.applications import Starlette

from swarmwright import Run
from swarmwright.runs import annotations
from swarmwright.runs.annotations import MOST_TAGS
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


@pytest.mark.parametrize(
    ("fault", "message"),
    [
        ("damaged", "notes.json: must be JSON"),
        ("folder", "notes.json: cannot be read: Is a directory"),
        ("pipe", "notes.json: is a pipe; expected a file"),
        ("link", "notes.json: cannot be read: Too many levels of symbolic links"),
        ("denied", "notes.json: cannot be read: Permission denied"),
    ],
)
def test_a_file_that_cannot_be_read_leaves_the_run_in_the_list(
    own: Path, monkeypatch: pytest.MonkeyPatch, fault: str, message: str
) -> None:
    file = own / "run-1" / "notes.json"
    if fault == "folder":
        file.mkdir()
    elif fault == "pipe":
        os.mkfifo(file)
    elif fault == "link":
        file.symlink_to(file)
    else:
        file.write_text("{")
    if fault == "denied":

        def deny(*_: object) -> bytes:
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))

        monkeypatch.setattr(annotations, "read_bytes", deny)
    app = create_app(own, token=None)
    assert app.state.window.index.row("run-1").state == "done"
    assert call(app, "/api/run", run="run-1").status == 200
    assert message in call(app, "/api/notes", run="run-1").values["error"]
    assert message in annotate(app, {"runs": ["run-1"], "add": "x"}).values["error"]


@pytest.mark.parametrize("fault", ["damaged", "full", "link"])
def test_of_several_runs_all_are_tagged_or_none(own: Path, fault: str) -> None:
    app = create_app(own, token=None)
    Run(own / "run-1").annotate(tags=["before"], note="kept")
    if fault == "full":
        Run(own / "run-2").annotate(tags=[f"tag-{number}" for number in range(MOST_TAGS)])
    elif fault == "damaged":
        (own / "run-2" / "notes.json").write_text("{")
    else:  # it is refused only when it is written
        (own / "notes.json").write_text('{"tags": [], "note": ""}')
        (own / "run-2" / "notes.json").symlink_to(own / "notes.json")
    answer = annotate(app, {"runs": ["run-1", "run-2"], "add": "thesis", "remove": "before"})
    assert answer.status == 422
    assert str(own / "run-2") in answer.values["error"]
    assert (Run(own / "run-1").tags, Run(own / "run-1").note) == (("before",), "kept")


def test_a_run_that_is_named_twice_is_tagged_once(own: Path) -> None:
    app = create_app(own, token=None)
    assert annotate(app, {"runs": ["run-1"] * 3, "add": "a, a"}).values == {"runs": ["run-1"]}
    assert Run(own / "run-1").tags == ("a",)
