import json
from pathlib import Path
from typing import Any

import pytest
from PIL import Image

EXPERIMENT = """\
simulation: minisim
parameters: {maxSteps: 6, stepSize: 20, helloMessage: Hello there}
method: {kind: random_search, population: 5, generations: 1}
servers: local
"""


@pytest.fixture
def run(program: Any, tmp_path: Path) -> str:
    (tmp_path / "x.yaml").write_text(EXPERIMENT)
    result = program("optimize", "x.yaml", "--out", "result")
    assert result.returncode == 0, result.stderr
    return "result"


def test_replay_shows_every_step_and_ends_with_the_fitness_of_the_run(
    program: Any, run: str, tmp_path: Path
) -> None:
    best = json.loads((tmp_path / run / "best.json").read_text())["fitness"]
    shown = program("replay", run, "--json")
    *scenes, last = [json.loads(line) for line in shown.stdout.splitlines()]
    assert [scene["step"] for scene in scenes] == list(range(len(scenes)))
    assert 2 <= len(scenes) <= 7
    assert scenes[0]["message"] == "Hello there"
    assert last == {"fitness": best}
    text = program("replay", run)
    assert text.stdout.count("Hello there") == len(scenes)
    assert "\x1b" not in text.stdout
    assert text.stdout.splitlines()[-1] == f"Fitness {best + 0.0:.6g}."


@pytest.mark.parametrize("name", ["best.gif", "best.PNG"])
def test_replay_saves_pictures(program: Any, run: str, tmp_path: Path, name: str) -> None:
    result = program("replay", run, "--save", name)
    assert result.returncode == 0, result.stderr
    assert name in result.stdout
    with Image.open(tmp_path / name) as picture:
        assert picture.width > 400
        assert (getattr(picture, "n_frames", 1) > 1) == (name == "best.gif")


def test_another_controller_and_another_episode(program: Any, run: str, tmp_path: Path) -> None:
    same = program("replay", run, "--controller", f"{run}/best.json", "--json")
    assert same.stdout == program("replay", run, "--json").stdout
    (tmp_path / "broken.json").write_text('{"version": 1, "kind": "layered"}')
    broken = program("replay", run, "--controller", "broken.json")
    assert broken.returncode == 2
    assert "broken.json" in broken.stderr
    assert program("replay", run, "--episode", "3", "--json").returncode == 0


def test_a_folder_that_is_no_run(program: Any, tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    result = program("replay", "empty")
    assert result.returncode == 2
    assert "no run folder" in result.stderr


def test_simulate_gives_the_fitness_that_the_run_had(program: Any, run: str, tmp_path: Path) -> None:
    best = json.loads((tmp_path / run / "best.json").read_text())["fitness"]
    result = program("simulate", "x.yaml", "--controller", run, "--json")
    assert result.returncode == 0, result.stderr
    assert json.loads(result.stdout)["fitness"] == best
    plain = program("simulate", "x.yaml")
    assert plain.returncode == 0
    assert plain.stdout.startswith("Fitness ")


def test_the_server_draws_when_asked_to(program: Any, run: str) -> None:
    result = program("simulate", "x.yaml", "--controller", run, "--visual")
    assert result.returncode == 0, result.stderr
    assert "Hello there" in result.stdout


def test_a_new_experiment_file_is_valid(program: Any, tmp_path: Path) -> None:
    (tmp_path / "my.yaml").write_text(program("new", "minisim").stdout)
    result = program("simulate", "my.yaml")
    assert result.returncode == 0, result.stderr


def test_the_schema_accepts_the_template(program: Any) -> None:
    from jsonschema import Draft202012Validator
    from ruamel.yaml import YAML

    schema = json.loads(program("schema").stdout)
    Draft202012Validator.check_schema(schema)
    template = YAML(typ="safe").load(program("new", "minisim").stdout)
    assert list(Draft202012Validator(schema).iter_errors(template)) == []
    assert list(Draft202012Validator(schema).iter_errors({**template, "sede": 1}))
