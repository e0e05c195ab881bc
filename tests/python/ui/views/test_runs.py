"""What is done with several runs of the list."""

import json
import shutil
from pathlib import Path
from typing import Any

import pytest

from swarmwright import Run
from swarmwright.ui.app import create_app
from tests.python.ui.client import call


@pytest.fixture
def own(two_runs: Path, complete_list: None, tmp_path: Path) -> Path:  # noqa: ARG001 - a fixture
    shutil.copytree(two_runs, tmp_path / "runs")
    return tmp_path / "runs"


@pytest.mark.parametrize(
    ("generations", "message"),
    [
        (0, "generations: 0 is not more than"),
        (-3, "generations: -3 is not more than"),
        ("done", "that run-1 has; enter more, or nothing to complete it as planned"),
        (2.5, "generations: must be a whole number, not '2.5'"),
        ("many", "generations: must be a whole number, not 'many'"),
        (True, "generations: must be a whole number"),
        ([], "generations: must be a whole number"),
    ],
)
def test_generations_that_are_not_more_are_refused_at_once(own: Path, generations: Any, message: str) -> None:
    app = create_app(own, token=None)
    if generations == "done":
        generations = Run(own / "run-1").generations
    body = json.dumps({"runs": ["run-1"], "generations": generations}).encode()
    answer = call(app, "/api/resume", method="POST", headers={"content-type": "application/json"}, body=body)
    assert answer.status == 422
    assert message in answer.values["error"]
    assert call(app, "/api/jobs").values["jobs"] == []


def resume(app: Any, runs: list[str]) -> Any:
    body = json.dumps({"runs": runs, "generations": 100}).encode()
    return call(
        app, "/api/resume", method="POST", headers={"content-type": "application/json"}, body=body
    ).values


def test_runs_are_resumed_once_and_all_or_none(own: Path) -> None:
    app = create_app(own, token=None)
    assert len(resume(app, ["run-1", "run-1"])["jobs"]) == 1
    assert (
        resume(app, ["run-1"])["error"]
        == "run-1: is in the queue or goes on already; wait for it, or stop it"
    )
    assert "run-1: is in the queue" in resume(app, ["run-2", "run-1"])["error"]
    [job] = call(app, "/api/jobs").values["jobs"]
    assert job["arguments"] == ["resume", "--generations", "100", "--", "run-1"]
