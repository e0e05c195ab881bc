"""`--set KEY=VALUE`, wherever an experiment is read."""

import json
from pathlib import Path
from typing import Any

import pytest

from swarmwright import Run

pytestmark = pytest.mark.slow

FILE = """\
simulation: minisim
method: {kind: nnga, population: 12, generations: 4}
seed: 3
servers: local
"""


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "my.yaml"
    path.write_text(FILE)
    return path


def test_what_is_set_is_run_and_recorded(program: Any, file: Path) -> None:
    settings = (
        "--set",
        "method.generations=2",
        "--set",
        "controller.hidden=[3]",
        "--set",
        "method.population=10",
    )
    result = program("optimize", file, *settings, "--out", "result", "--json")
    assert result.returncode == 0, result.stderr
    run = Run.open(file.parent / "result")
    assert (run.generations, run.experiment.generations, run.record.genomes.shape[1]) == (2, 2, 19)
    shown = program("replay", "result", "--json", "--set", "parameters.maxSteps=1")
    assert json.loads(shown.stdout.splitlines()[-2])["step"] == 1


def test_a_wrong_setting_is_wrong_input(program: Any, file: Path) -> None:
    (file.parent / "sweep.yaml").write_text("experiment: my.yaml\ngrid: {method.population: [10]}\n")
    for command in (("optimize", "my.yaml"), ("simulate", "my.yaml"), ("sweep", "sweep.yaml")):
        result = program(*command, "--set", "method.populaton=5", "--set", "servers=0")
        assert result.returncode == 2
        assert result.stderr.splitlines() == [
            "swarmwright: --set method.populaton=5: unknown key; did you mean 'population'?",
            "  --set servers=0: must be at least 1 and at most 1024, not 0",
        ]


def test_one_episode_has_the_seed_that_is_asked_for(program: Any, file: Path) -> None:
    random = ("simulate", file, "--json", "--set", "parameters.placement=random")
    results = [json.loads(program(*random, *seed).stdout) for seed in ((), ("--seed", "0"), ("--seed", "9"))]
    assert [one["seed"] for one in results] == [0, 0, 9]
    assert results[0]["fitness"] == results[1]["fitness"] != results[2]["fitness"]
