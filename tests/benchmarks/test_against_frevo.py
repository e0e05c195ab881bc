"""The comparison with FREVO: its tables are made of the runs, and its picture is drawn."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from swarmwright import Experiment, evaluate, frevo, optimize
from swarmwright.analysis.sweep import Sweep

BASE = Experiment.from_mapping(
    {
        "simulation": "emergency_exit",
        "parameters": {"width": 6, "height": 6, "numAgents": 2, "numExits": 1, "numBlockades": 0, "steps": 5},
        "controller": {"kind": "fully_meshed"},
        "method": {"kind": "nnga", "population": 10, "generations": 2},
        "servers": "local",
    }
)


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("runs")
    for name, seed in (("random_methods", 0), ("stadium_methods", 7)):
        for method in (
            {"kind": "nnga", "population": 10, "generations": 2},
            {"kind": "cma_es", "population": 5, "generations": 2},
            {"kind": "cma_es", "population": 8, "generations": 2},
        ):
            for run in (1, 2, 3):
                experiment = BASE.replace(method=method, seed=run, parameters={"seed": seed})
                label = f"{method['kind']}{method.get('population', '')}-{run}"
                optimize(experiment, out=folder / name / label)
    return folder


def test_the_table_holds_what_the_runs_came_to(runs: Path) -> None:
    from benchmarks.against_frevo import FREVO, rows, table

    found = rows(runs / "random_methods")
    assert {row.name for row in found} == {"nnga", "cma_es, population 5", "cma_es, population 8"}
    means = [row.values.mean() for row in found]
    assert means == sorted(means, reverse=True)
    lines = [[cell.strip() for cell in line.split("|")[1:-1]] for line in table(FREVO["random"], found)]
    assert lines[2][:4] == ["FREVO's NNGA", "-42.2", "-53.5", "-29.6"]
    for row, line in zip(found, lines[3:], strict=True):
        assert line[0] == row.name
        shown = np.array([float(cell) for cell in line[1:4]])
        assert shown == pytest.approx([row.values.mean(), row.values.min(), row.values.max()], rel=1e-3)
        # Three runs, all better than FREVO's mean: 2 of the 8 ways to sign three ranks are as extreme.
        assert (row.values > -42.2).all()
        assert float(line[5]) == 0.25
        assert (line[8] == "") == (row.name == "nnga")


def test_the_program_prints_both_tables_and_draws(runs: Path, root: Path, tmp_path: Path) -> None:
    picture = tmp_path / "picture.png"
    result = subprocess.run(
        [sys.executable, "-m", "benchmarks.against_frevo", str(runs), str(picture)],
        cwd=root, capture_output=True, text=True, timeout=50, check=False,
    )  # fmt: skip
    assert result.returncode == 0, result.stderr
    assert result.stdout.count("| FREVO's NNGA |") == 2
    assert picture.read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize("name", ["random_methods", "stadium_methods", "random_populations"])
def test_the_sweeps_are_whole(name: str, root: Path) -> None:
    sweep = Sweep.load(root / "experiments" / "frevo" / f"{name}.yaml")
    assert len(sweep.variants) == 10
    assert len(sweep.seeds) == 10
    assert {one.experiment.simulation for one in sweep.variants} == {"emergency_exit"}


@pytest.mark.parametrize("name", ["random", "stadium"])
def test_the_sweeps_start_from_frevos_sessions(name: str, root: Path) -> None:
    session = frevo.load(root / "tests" / "data" / "frevo" / f"emergency_exit_{name}.zse").experiment
    ours = Experiment.load(root / "experiments" / "frevo" / f"{name}.yaml")
    assert (ours.method, ours.controller) == (session.method, session.controller)
    genomes = np.random.default_rng(1).uniform(-2, 2, (20, ours.genome_size)).astype(np.float32)
    there = evaluate(session.replace(servers="local"), genomes)
    assert np.array_equal(evaluate(ours, genomes), there)
