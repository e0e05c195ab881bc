"""Requests of the page for new experiments: its form and its sweeps."""

import json
import shutil
from pathlib import Path
from typing import Any

import pytest
from starlette.applications import Starlette

import swarmwright
from swarmwright import templates
from swarmwright.common import yaml
from swarmwright.runs.code import is_code_trusted
from swarmwright.simulations.user_code import trust
from swarmwright.ui.app import create_app
from tests.python.ui.client import Answer, call

MINISIM = templates.text("minisim")


@pytest.fixture
def app(tmp_path: Path) -> Starlette:
    return create_app(tmp_path, token=None)


def post(app: Starlette, name: str, values: Any) -> Answer:
    headers = {"content-type": "application/json", "origin": "http://127.0.0.1:8501"}
    return call(app, f"/api/{name}", method="POST", headers=headers, body=json.dumps(values).encode())


def test_the_form_has_fields_and_what_the_text_has(app: Starlette) -> None:
    answer = post(app, "form", {"text": MINISIM}).values
    assert answer["values"]["keys"]["method"]["keys"]["population"] == {"text": "50"}
    population = next(
        field
        for section in answer["sections"]
        for field in section["fields"]
        if field["path"] == ["method", "population"]
    )
    assert population["low"] == 2
    assert population["kind"] == "whole number 2 to 10,000,000"
    assert population["help"]


def test_fields_are_sent_when_the_kinds_change(app: Starlette) -> None:
    known = post(app, "form", {"text": MINISIM}).values["form"]
    assert "sections" not in post(app, "form", {"text": MINISIM.replace("50", "60"), "known": known}).values
    assert "sections" in post(app, "form", {"text": MINISIM.replace("nnga", "pso"), "known": known}).values


def test_a_field_changes_the_text(app: Starlette) -> None:
    answer = post(app, "form_change", {"text": MINISIM, "path": ["method", "population"], "entry": "70"})
    assert answer.values["text"] == MINISIM.replace("population: 50", "population: 70")


@pytest.mark.parametrize(
    ("name", "values", "message"),
    [
        ("form", {}, "text: must be text"),
        ("form", {"text": "a: [1"}, "text:2: is not valid YAML"),
        ("form", {"text": "\ud800"}, "text: is not valid Unicode"),
        ("form_change", {"text": MINISIM, "path": "method", "entry": "1"}, "path: must list 1 to 4 keys"),
        ("form_change", {"text": MINISIM, "path": [], "entry": "1"}, "path: must list 1 to 4 keys"),
        ("form_change", {"text": MINISIM, "path": ["a"] * 5, "entry": "1"}, "path: must list 1 to 4 keys"),
        ("form_change", {"text": MINISIM, "path": [1], "entry": "1"}, "path: must list 1 to 4 keys"),
        ("form_change", {"text": MINISIM, "path": ["a"], "entry": 1}, "entry: must be text"),
        ("form_change", {"text": MINISIM, "path": ["a\ud800"], "entry": "1"}, "cannot be changed"),
        ("form_change", {"text": "a: [1", "path": ["a"], "entry": "1"}, "is not valid YAML"),
        ("broker_simulations", {"broker": "h:1", "prefix": ""}, "broker: "),
        ("broker_simulations", {"broker": "mqtt://h", "prefix": "#"}, "prefix: "),
        ("broker_simulations", {"broker": "mqtt://127.0.0.1:9", "prefix": ""}, "127.0.0.1:9"),
        ("class_parameters", {"simulation": "minisim"}, "must name a class"),
        ("class_parameters", {"simulation": "x.py:A\0"}, "must name a class"),
    ],
)  # fmt: skip
def test_wrong_requests_are_told_why(app: Starlette, name: str, values: Any, message: str) -> None:
    answer = post(app, name, values)
    assert answer.status == 422
    assert message in answer.values["error"]


@pytest.mark.parametrize(
    ("vary", "seeds", "message"),
    [
        ([], 1, "vary: choose 1 to 20 fields"),
        ([3], 1, "vary: must be a list of fields"),
        ([{"path": ["a"]}], 1, "vary: must be a list of fields"),
        ([{"path": ["seed"], "values": "1"}], 1, "set the number of seeds instead"),
        ([{"path": ['a"'], "values": "1"}], 1, "a key with quotes"),
        ([{"path": ["a"], "values": "1"}] * 2, 1, "there twice"),
        ([{"path": ["a"], "values": "1"}], 0, "seeds: must be"),
        ([{"path": ["a"], "values": "1"}], 1e9, "whole number"),
        ([{"path": ["a"], "values": "1, 2"}], 99_999, "makes 199,998 runs"),
    ],
)
def test_wrong_plans_are_told_why(app: Starlette, vary: list[Any], seeds: float, message: str) -> None:
    answer = post(app, "sweep_plan", {"text": MINISIM, "vary": vary, "seeds": seeds})
    assert answer.status == 422
    assert message in answer.values["error"]


def test_a_plan_counts_its_runs_and_says_what_is_wrong(app: Starlette) -> None:
    vary = [
        {"path": ["method", "population"], "values": "10, 20, 30"},
        {"path": ["method", "kind"], "values": "nnga, x"},
    ]
    answer = post(app, "sweep_plan", {"text": MINISIM, "vary": vary, "seeds": 5}).values
    assert answer["counts"] == [3, 0]
    assert list(answer["errors"]) == ["1"]
    vary[1]["values"] = "nnga, pso"
    answer = post(app, "sweep_plan", {"text": MINISIM, "vary": vary, "seeds": 5}).values
    assert (answer["counts"], answer["runs"], answer["errors"]) == ([3, 2], 30, {})


@pytest.mark.slow
def test_a_sweep_is_checked_and_queued_as_a_command(app: Starlette, tmp_path: Path) -> None:
    vary = [{"path": ["method", "population"], "values": "1, 20"}]
    request = {"text": MINISIM, "name": "sizes", "vary": vary, "seeds": 2}
    problems = post(app, "sweep", request).values["problems"]
    assert problems == [
        {"line": None, "message": "grid: with population 1: method.population: must be at least 2, not 1"}
    ]
    assert list(tmp_path.iterdir()) == []
    vary[0]["values"] = "10, 20"
    (job,) = post(app, "sweep", request).values["jobs"]
    assert job["arguments"] == ["sweep", "sizes-sweep.yaml", "--out", "sizes"]
    assert job["run"] == "sizes"
    assert (tmp_path / "sizes.yaml").read_text() == MINISIM
    assert yaml.read(tmp_path / "sizes-sweep.yaml").values == {
        "experiment": "sizes.yaml",
        "grid": {"method.population": [10, 20]},
        "seeds": 2,
    }
    assert "choose another name" in post(app, "sweep", {**request, "seeds": 3}).values["error"]


@pytest.mark.slow
def test_the_parameters_of_a_class_are_read_in_a_process_of_their_own(app: Starlette, tmp_path: Path) -> None:
    (tmp_path / "own.py").write_text(
        "from swarmwright import Parameter, Simulation\n"
        "class Own(Simulation):\n"
        "    sensors, actuators = 1, 1\n"
        "    parameters = {'gravity': Parameter(9.81, 'Metres per second squared.')}\n"
        "    def reset(self, parameters, seed): ...\n"
        "    def step(self, actuators): ...\n"
        "    def done(self): return True\n"
        "    def fitness(self): return 0.0\n"
    )
    text = "simulation: own.py:Own\n"
    answer = post(app, "form", {"text": text}).values
    assert answer["class"] == "own.py:Own"
    assert post(app, "class_parameters", {"simulation": "own.py:Own"}).values == {"parameters": 1}
    answer = post(app, "form", {"text": text, "known": answer["form"]}).values
    fields = {".".join(field["path"]): field for section in answer["sections"] for field in section["fields"]}
    assert fields["parameters.gravity"]["default"] == "9.81"
    broken = post(app, "class_parameters", {"simulation": "none.py:Own"})
    assert broken.status == 422
    assert "none.py" in broken.values["error"]


def test_a_window_for_reading_edits_forms_but_runs_no_code(tmp_path: Path) -> None:
    app = create_app(tmp_path, token=None, read_only=True)
    assert post(app, "form", {"text": MINISIM}).status == 200
    for name in ("check", "sweep", "class_parameters"):
        assert post(app, name, {"text": MINISIM, "simulation": "x.py:X"}).status == 405


CODE = """
from pathlib import Path
import numpy as np
from swarmwright import Simulation
Path({marker!r}).touch()


class Own(Simulation):
    title, sensors, actuators = "own", 1, 1

    def reset(self, parameters, seed):
        self.left = 2
        return np.zeros((1, 1))

    def step(self, actions):
        self.left -= 1
        return np.zeros((1, 1))

    def done(self):
        return self.left == 0

    def fitness(self):
        return 1.0
"""


@pytest.mark.usefixtures("complete_list")
def test_a_run_says_whether_its_code_is_trusted_and_none_is_executed(
    two_runs: Path,
    tmp_path: Path,
) -> None:
    folder = tmp_path / "runs"
    shutil.copytree(two_runs, folder)
    own = call(create_app(folder, token=None), "/api/experiment", run="run-1").values
    assert own["is_trusted"]
    # A file beside the store is not read: it may name other code, or be a link to any file.
    (folder / "run-1" / "experiment.yaml").unlink()
    (folder / "run-1" / "experiment.yaml").symlink_to("/etc/hostname")
    assert call(create_app(folder, token=None), "/api/experiment", run="run-1").values["text"] == own["text"]


@pytest.mark.slow
@pytest.mark.usefixtures("complete_list")
def test_code_of_somebody_else_is_not_trusted(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    file, folder, marker = tmp_path / "own.py", tmp_path / "runs", tmp_path / "executed"
    file.write_text(CODE.format(marker=str(marker)))
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "author"))
    experiment = {"simulation": f"{file}:Own", "method": {"population": 4, "generations": 1}}
    swarmwright.optimize(experiment, servers="in-process", out=folder / "run")
    marker.unlink()
    assert is_code_trusted(swarmwright.Run(folder / "run").experiment)
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "reader"))
    trust._granted.clear()
    assert not call(create_app(folder, token=None), "/api/experiment", run="run").values["is_trusted"]
    assert not marker.exists()
