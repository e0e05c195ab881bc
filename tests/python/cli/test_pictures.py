"""`swarmwright simulate --save`: an episode of an experiment before any run."""

import json
from pathlib import Path
from typing import Any

import pytest
from PIL import Image

from swarmwright import Run

pytestmark = pytest.mark.slow

EXPERIMENT = """\
simulation: minisim
parameters: {maxSteps: 6, stepSize: 20, helloMessage: Hello there}
method: {kind: random_search, population: 5, generations: 1}
servers: local
"""


@pytest.fixture
def experiment(tmp_path: Path) -> str:
    (tmp_path / "x.yaml").write_text(EXPERIMENT)
    return "x.yaml"


def test_an_episode_is_saved_before_any_run(program: Any, experiment: str, tmp_path: Path) -> None:
    plain = program("simulate", experiment, "--seed", "3", "--json")
    for name, what in (
        ("x.html", "The page"),
        ("x.gif", "The animation"),
        ("x.mp4", "The video"),
        ("x.PNG", "The picture"),
    ):
        saved = program("simulate", experiment, "--seed", "3", "--save", name)
        assert saved.returncode == 0, saved.stderr
        fitness = json.loads(plain.stdout)["fitness"]
        assert saved.stdout == f"Fitness {fitness:.6g} with a random controller. {what} is in {name}\n"
    page = (tmp_path / "x.html").read_text(encoding="utf-8")
    for said in ("a random controller, simulation seed 3", "layered, 4-8-1, tanh", "Hello there"):
        assert said in page
    with Image.open(tmp_path / "x.gif") as film:
        assert getattr(film, "n_frames", 1) > 1


def test_a_controller_of_a_run_is_saved_with_the_fitness_that_it_had(
    program: Any, experiment: str, tmp_path: Path
) -> None:
    assert program("optimize", experiment, "--out", "result").returncode == 0
    saved = program("simulate", experiment, "--controller", "result", "--save", "x.png", "--json")
    assert saved.returncode == 0, saved.stderr
    said = json.loads(saved.stdout)
    assert said["fitness"] == Run.open(tmp_path / "result").best.fitness
    assert (said["picture"], said["controller"], said["seed"]) == ("x.png", "result", 0)
    other = program(
        "simulate", experiment, "--set", "simulation=emergency_exit", "--set", "parameters={}",
        "--controller", "result", "--save", "y.png",
    )  # fmt: skip
    assert other.returncode == 2
    assert "controller: has 4 sensors and 1 actuators; emergency_exit has" in other.stderr
    assert not (tmp_path / "y.png").exists()


def test_values_of_a_parameter_set_are_said(program: Any, tmp_path: Path) -> None:
    (tmp_path / "rule.yaml").write_text(
        "simulation: minisim\nparameters: {steering: rule}\nfitness: fitness * 2\n"
        "controller: {kind: parameter_set, parameters: {maxSteps: {type: integer, range: [3, 9]}}}\n"
        "method: {kind: random_search, population: 4, generations: 1}\n"
    )
    saved = program("simulate", "rule.yaml", "--save", "x.png").stdout.splitlines()
    plain = program("simulate", "rule.yaml").stdout.splitlines()
    assert saved[0] == f"{plain[0]} The picture is in x.png", "with the experiment's expression of fitness"
    assert saved[1] == plain[1]
    assert saved[1].startswith("maxSteps ")


def test_what_cannot_be_saved_is_refused(program: Any, experiment: str, tmp_path: Path) -> None:
    (tmp_path / "dark.py").write_text(
        "from swarmwright import Simulation\n\n"
        "class Dark(Simulation):\n"
        "    sensors = actuators = 1\n    max_steps = 5\n"
        "    def reset(self, parameters, seed): return [[0.0]]\n"
        "    def step(self, actuators): raise ValueError('no step')\n"
        "    def done(self): return False\n"
        "    def fitness(self): return 0.0\n\n"
        "class Failing(Dark):\n"
        "    def scene(self):\n"
        "        from swarmwright.display import Scene\n"
        "        return Scene(10, 10, 0, '', ())\n"
    )
    (tmp_path / "full.png").symlink_to("/dev/full")
    for options, status, said in (
        ("--save x.avi", 2, "--save x.avi: files end with .html, .gif, .mp4 or .png"),
        ("--save nowhere/x.gif", 2, "there is no folder 'nowhere'"),
        ("--save full.png", 2, "full.png: cannot be written: No space left"),
        ("--save x.png --visual", 2, "leave one out"),
        ("--save x.png --show tracks", 2, "--show: 'tracks' is not a part"),
        ("--speed 2", 2, "--speed needs --save; add it"),
        ("--save x.png --set simulation=dark.py:Dark --set parameters={}", 2, "add a method scene()"),
        ("--save x.png --set simulation=dark.py:Failing --set parameters={}", 1, "no step (dark.py:7)"),
        (
            "--save x.png --set simulation=elsewhere --set parameters={} --set servers=auto",
            2,
            "the simulation 'elsewhere' is not built in; give a broker",
        ),
    ):
        refused = program("simulate", experiment, *options.split())
        assert (refused.returncode, "Traceback" in refused.stderr) == (status, False), refused.stderr
        assert said in refused.stderr
        assert not (tmp_path / "x.png").exists()


def test_replay_names_the_command_for_an_experiment(program: Any, experiment: str, tmp_path: Path) -> None:
    refused = program("replay", experiment)
    assert refused.returncode == 2
    assert "before any run, use 'swarmwright simulate x.yaml --save x.html'" in refused.stderr
    (tmp_path / "x.png").touch()
    assert "simulate" not in program("replay", "x.png").stderr


def test_metrics_of_the_fitness_are_said(program: Any, experiment: str) -> None:
    setting = ("--set", "fitness=-distance", "--json")
    plain, saved = (
        json.loads(program("simulate", experiment, *setting, *more).stdout)
        for more in ((), ("--save", "x.png"))
    )
    assert saved == {**plain, "steps": 6, "picture": "x.png"}
    assert plain["metrics"]
