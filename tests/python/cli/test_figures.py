"""`plot` and `draw` as programs."""

import json
from pathlib import Path
from typing import Any

import pytest
from PIL import Image

import swarmwright

pytestmark = pytest.mark.slow

BASE: dict[str, Any] = {
    "simulation": "minisim", "servers": "local", "parameters": {"maxSteps": 4},
    "method": {"kind": "nnga", "population": 6, "generations": 3},
}  # fmt: skip


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folders nnga-1, nnga-2, random_search-1, random_search-2."""
    folder = tmp_path_factory.mktemp("runs")
    for kind in ("nnga", "random_search"):
        method = {"kind": kind, "population": 6, "generations": 3}
        experiment = swarmwright.Experiment.from_mapping({**BASE, "method": method})
        for seed in (1, 2):
            swarmwright.optimize(experiment, seed=seed, out=folder / f"{kind}-{seed}")
    return folder


@pytest.mark.journey
def test_one_run_is_drawn_into_its_folder(program: Any, runs: Path) -> None:
    result = program("plot", runs / "nnga-1", "--json")
    assert result.returncode == 0, result.stderr
    said = json.loads(result.stdout)
    assert said["generations"] == len(said["diversity"]) == 3
    assert said["diversity"][0] == 1.0
    assert said["picture"] == str(runs / "nnga-1" / "plot.png")
    with Image.open(said["picture"]) as picture:
        assert picture.width > 900


def test_several_runs_are_compared(program: Any, runs: Path, tmp_path: Path) -> None:
    folders = sorted(runs.iterdir())
    result = program("plot", *folders, "--out", "both.svg")
    assert result.returncode == 0, result.stderr
    assert result.stderr == ""
    lines = result.stdout.splitlines()
    assert lines[0].split() == ["group", "runs", "evaluations", "median", "quartiles", "worst", "best"]
    assert lines[1].startswith("random_search ")  # the best median first
    few = "with fewer than 5 runs in a group (random_search: 2; nnga: 2) a test has little power"
    assert few in result.stdout
    assert lines[-1] == "The figure is in both.svg"
    assert (tmp_path / "both.svg").read_text().startswith("<?xml")
    styled = ("--style", "ieee", "--width", "page", "--title", "Methods", "--order", "name")
    (line,) = program(
        "plot", *folders, "--json", "--at", "6", "--label", "nnga=GA", *styled
    ).stdout.splitlines()
    said = json.loads(line)
    assert [group["label"] for group in said["groups"]] == ["GA", "random_search"]
    assert said["at"] == 6
    with Image.open(tmp_path / "comparison.png") as picture:
        assert picture.width == round(300 * 7.16)
    for options, words in (
        (["--width", "column"], "width: the style screen has no columns"),
        (["--width", "89 feet"], "width: must be column, page, a number of inches, or a length such as"),
        (["--width", "0"], "width: must be from 1 to 40 inches, not 0"),
        (["--width", "nan"], "width: must be from 1 to 40 inches, not nan"),
        (["--label", "nnga"], "'nnga' is not GROUP=NAME"),
        (["--label", "unknown=x"], "labels: there is no 'unknown' to be called otherwise"),
        (["--order", "size"], "order: there is no group 'size'; there are"),
    ):
        result = program("plot", *folders, *options)
        assert result.returncode == 2
        assert words in result.stderr


def test_runs_are_compared_without_a_figure(program: Any, runs: Path, tmp_path: Path) -> None:
    folders = sorted(runs.iterdir())
    result = program("runs", "compare", *folders, "--at", "6")
    assert result.returncode == 0, result.stderr
    assert result.stdout.splitlines()[1].split()[0] in {"nnga", "random_search"}
    (line,) = program("runs", "compare", *folders, "--json").stdout.splitlines()
    assert {group["label"] for group in json.loads(line)["groups"]} == {"nnga", "random_search"}
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("command", [("plot",), ("runs", "compare")])
def test_files_among_the_runs_are_left_out(
    program: Any, runs: Path, tmp_path: Path, command: tuple[str, ...]
) -> None:
    (tmp_path / "comparison.png").write_bytes(b"")
    named = [*sorted(runs.iterdir()), tmp_path / "comparison.png"]
    result = program(*command, *named, "--json")
    assert result.returncode == 0, result.stderr
    assert len(json.loads(result.stdout)["groups"]) == 2
    assert result.stderr == (
        f"swarmwright: left out: {tmp_path / 'comparison.png'} is a file, not a run folder\n"
    )
    result = program(*command, "comparison.png")
    assert result.returncode == 2
    assert "comparison.png is not a run folder" in result.stderr
    assert "does not exist" in program(*command, runs / "nnga-1", "nothing").stderr


def test_what_cannot_be_plotted(program: Any, runs: Path, tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    run = runs / "nnga-1"
    for arguments, said in (
        ((), "RUN"),
        (("empty",), "empty"),
        ((run, "--out", "x.gif"), ".png, .svg or .pdf"),
        ((run, "--out", "nowhere/x.png"), "there is no folder 'nowhere'"),
        ((run, "--at", "0"), "--at"),
    ):
        result = program("plot", *arguments)
        assert result.returncode == 2, result.stdout
        assert said in result.stderr
    result = program("plot", run, run, "empty")
    assert result.returncode == 1, result.stdout
    assert result.stderr == "swarmwright: left out: empty: is not a run folder: run.sqlite is missing\n"


def test_controllers_are_drawn(program: Any, runs: Path, tmp_path: Path) -> None:
    result = program("draw", runs / "nnga-1")
    assert result.returncode == 0, result.stderr
    assert result.stderr == ""
    assert result.stdout.strip() == f"The controller is drawn in {runs / 'nnga-1' / 'controller.png'}"
    early = program(
        "draw", runs / "nnga-1", "--generation", "0", "--candidate", "2", "--out", "early.svg", "--json"
    )
    assert json.loads(early.stdout) == {"picture": "early.svg", "kind": "layered"}
    swarmwright.Run.open(runs / "nnga-1").best.controller.save(tmp_path / "mine.json")
    result = program("draw", "mine.json", "--simulation", "minisim")
    assert result.returncode == 0, result.stderr
    assert (tmp_path / "mine.png").exists()
    for arguments, said in (
        (("mine.json", "--generation", "1"), "are for runs"),
        ((runs / "nnga-1", "--generation", "9"), "has generations 0 to 2, but no generation 9"),
        (("mine.json", "--out", "x.txt"), ".png, .svg or .pdf"),
        (("nothing.json",), "does not exist"),
    ):
        refused = program("draw", *arguments)
        assert refused.returncode == 2
        assert said in refused.stderr


NAMED = """\
from swarmwright import Simulation


class Still(Simulation):
    sensors, actuators = 2, 1
    sensor_names, actuator_names = ["distance to wall", "battery"], ["gripper"]

    def reset(self, parameters, seed):
        self.steps = 0
        return [[0.5, 1.0]]

    def step(self, actions):
        self.steps += 1
        return [[0.5, 1.0]]

    def done(self):
        return self.steps == 2

    def fitness(self):
        return 1.0
"""


def test_a_user_defined_simulation_names_its_sensors_in_the_figure(
    program: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "still.py").write_text(NAMED, encoding="utf-8")
    experiment = swarmwright.Experiment.from_mapping(
        {
            "simulation": f"{tmp_path / 'still.py'}:Still",
            "controller": {"kind": "layered", "hidden": []},
            "method": {"kind": "random_search", "population": 2, "generations": 1},
        }
    )
    run = swarmwright.optimize(experiment, out=tmp_path / "run")
    names = ("distance to wall", "battery", "gripper")

    def drawn(*arguments: object) -> str:
        result = program("draw", *arguments, "--out", "drawn.svg")
        assert result.returncode == 0, result.stderr
        return str((tmp_path / "drawn.svg").read_text(encoding="utf-8")) + str(result.stderr)

    text = drawn("run")
    assert [name for name in names if name not in text] == []
    run.best.controller.save(tmp_path / "best.json")
    text = drawn("best.json", "--simulation", "still.py:Still")
    assert [name for name in names if name not in text] == []
    assert "sensor 0" in drawn("best.json")
    # The code of a run that another user made is not executed.
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    text = drawn("run")
    assert "sensor 0" in text
    assert "sensors and actuators are numbered" in text
