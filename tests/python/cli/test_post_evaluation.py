"""What is said of a run's best on seeds that the run did not use."""

import json
from pathlib import Path
from typing import Any

import pytest

from swarmwright import Experiment, optimize

NOISY = """\
simulation: minisim
parameters: {numAgents: 3, numDefenders: 3, placement: random, speedDefenders: 0.5}
method: {kind: random_search, population: 20, generations: 15}
ranking: {episodes: 2, seeds: new}
servers: local
"""


@pytest.fixture
def noisy(tmp_path: Path) -> Path:
    path = tmp_path / "noisy.yaml"
    path.write_text(NOISY)
    return path


def test_noisy_runs_end_with_it(program: Any, noisy: Path) -> None:
    noisy.with_name("sweep.yaml").write_text(
        "experiment: noisy.yaml\ngrid: {method.generations: [15]}\nseeds: [1]\n"
    )
    result = program("optimize", noisy, "--out", "run", "--json")
    last = json.loads(result.stdout.splitlines()[-1])
    unseen = last["unseen"]
    assert (unseen["episodes"], unseen["seed"]) == (30, 1_000_000_000)
    assert unseen["low"] < unseen["fitness"] < unseen["high"] < last["best"]["fitness"]
    fitness = f"{unseen['fitness']:.4g} +- {unseen['standard_error']:.2g}"
    chosen = f"best {last['best']['fitness']:.6g} on the seeds it was chosen on"
    assert (
        f"{chosen}; {fitness} on 30 episodes with held-out seeds\n" in program("runs", "show", "run").stdout
    )
    assert f" ({fitness} on held-out seeds), 300 evaluations" in program("sweep", "sweep.yaml").stdout


def test_any_run_can_be_asked(program: Any, noisy: Path) -> None:
    optimize(Experiment.load(noisy, ["method.generations=2"]), out=noisy.parent / "run")
    result = program("evaluate", "run", "--episodes", "50", "--seed", "7", "--json")
    assert result.returncode == 0, result.stderr
    values = json.loads(result.stdout)
    assert (values["episodes"], values["seed"], values["seeds"][-1], len(values["values"])) == (50, 7, 56, 50)
    assert values["fitness"]["mean"] == values["mean"]
    again = program("evaluate", "run", "--episodes", "50", "--seed", "7", "--servers", "1")
    assert f"  mean {values['mean']:.6g}, standard error {values['standard_error']:.2g}, 95 %" in again.stdout
    assert f"recorded fitness {values['recorded']:.6g}." in again.stdout
    wrong = program("evaluate", "run", "--set", "parameters.maxSteps=3")
    assert wrong.returncode == 2
    assert wrong.stderr == (
        "swarmwright: --set parameters.maxSteps=3: parameters: the record was not made with it; "
        "give --episodes\n"
    )
