"""The records of a sweep as one table."""

import csv
import json
import shutil
from pathlib import Path
from typing import Any

import pytest

import swarmwright
from swarmwright import Run
from swarmwright.analysis.sweep_table import write_records

BASE = {
    "simulation": "minisim",
    "parameters": {"maxSteps": 3, "placement": "random"},
    "method": {"kind": "nnga", "population": 4, "generations": 2},
    "servers": "local",
}
GRID = [
    {"controller.hidden": [[2], [4]]},
    {"method.kind": ["random_search"], "ranking.episodes": [2], "controller.hidden": [[2]]},
]


@pytest.fixture(scope="module")
def swept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of a sweep whose runs have other numbers of genes and episodes."""
    folder = tmp_path_factory.mktemp("swept") / "results"
    swarmwright.sweep({"experiment": BASE, "grid": GRID, "seeds": 2}, out=folder, jobs=1)
    return folder


def runs_of(folder: Path) -> list[Run]:
    return [Run.open(store.parent) for store in sorted(folder.glob("*/run.sqlite"))]


def test_a_csv_file_has_every_evaluation_of_all_runs(swept: Path, tmp_path: Path) -> None:
    runs = runs_of(swept)
    write_records(runs, tmp_path / "all.csv")
    with (tmp_path / "all.csv").open(newline="") as file:
        header, *rows = csv.reader(file)
    first = header.index("generation")
    assert header[:first] == ["run", "seed", "controller.hidden", "method.kind", "ranking.episodes"]
    assert header[first : first + 5] == ["generation", "candidate", "fitness", "episode_0", "episode_1"]
    largest = max(run.record.genomes.shape[1] for run in runs)
    assert header[-largest:] == [f"g{gene}" for gene in range(largest)]
    place = 0
    for run in runs:
        record = run.record
        for row in rows[place : place + run.evaluations]:
            values = dict(zip(header, row, strict=True))
            assert (values["run"], values["seed"]) == (run.path.name, str(run.experiment.seed))
            assert (
                json.loads(values["controller.hidden"]) == run.experiment.to_mapping()["controller"]["hidden"]
            )
            assert (values["episode_1"] == "") == (record.episodes.shape[1] == 1)
            assert values[f"g{record.genomes.shape[1] - 1}"]
        alone = [
            [row[header.index(name)] for name in record] for row in rows[place : place + run.evaluations]
        ]
        run.export(tmp_path / "one.csv")
        with (tmp_path / "one.csv").open(newline="") as file:
            assert alone == list(csv.reader(file))[1:]
        place += run.evaluations
    assert place == len(rows)


def test_a_parquet_file_has_the_same(swept: Path, tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    runs = runs_of(swept)
    write_records(runs, tmp_path / "all.parquet")
    rows = parquet.read_table(tmp_path / "all.parquet").to_pylist()
    assert len(rows) == sum(run.evaluations for run in runs)
    for run in runs:
        mine = [row for row in rows if row["run"] == run.path.name]
        assert [row["genome"] for row in mine] == run.record.genomes.tolist()
        assert [row["episodes"] for row in mine] == run.record.episodes.tolist()
        assert {row["seed"] for row in mine} == {run.experiment.seed}
        assert {row["ranking.episodes"] for row in mine} == {run.experiment.ranking.episodes}


@pytest.mark.slow
def test_the_command_takes_the_folder_of_a_sweep(program: Any, swept: Path, tmp_path: Path) -> None:
    results = shutil.copytree(swept, tmp_path / "results")
    result = program("runs", "export", "results", "all.csv")
    assert (result.returncode, result.stderr) == (0, "")
    assert result.stdout == "The records of 6 runs are in all.csv\n"
    missing = next(results.glob("random_search*-1"))
    shutil.rmtree(missing)
    result = program("runs", "export", "results", "all.csv", "--json")
    assert result.returncode == 1
    assert result.stderr == (
        f"swarmwright: left out: results/{missing.name}: missing; the same sweep runs it\n"
    )
    assert len(json.loads(result.stdout)["runs"]) == 5
    refused = program("runs", "export", "results", "all.csv", "--validation")
    assert refused.returncode == 2
    assert "is the folder of a sweep, not of a run" in refused.stderr
