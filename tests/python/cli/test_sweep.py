"""A sweep as a program: run, interrupted, gone on with, on shared servers."""

import contextlib
import json
import shutil
import signal
import time
from pathlib import Path
from typing import Any

import pytest

from swarmwright import InputError, Run

pytestmark = pytest.mark.slow

BASE = """\
simulation: minisim
parameters: {maxSteps: 5}
method: {kind: nnga, population: 6, generations: 3}
servers: SERVERS
"""
SWEEP = "experiment: base.yaml\ngrid: {method.kind: [nnga, random_search]}\nseeds: 2\nout: results\n"


def write(folder: Path, servers: str = "local", sweep: str = SWEEP) -> None:
    (folder / "base.yaml").write_text(BASE.replace("SERVERS", servers))
    (folder / "sweep.yaml").write_text(sweep)


def records(folder: Path) -> dict[str, str]:
    return {run.name: Run.open(run).digest for run in sorted(folder.iterdir()) if run.is_dir()}


def test_variants_are_run_and_compared_once(program: Any, tmp_path: Path) -> None:
    write(tmp_path)
    result = program("sweep", "sweep.yaml")
    assert result.returncode == 0, result.stderr
    assert result.stderr == ""
    assert result.stdout.startswith(
        "2 variants with 2 seeds each: 4 runs in results\n[1/4] nnga, seed 1: best"
    )
    assert "against second" in result.stdout
    assert result.stdout.endswith("The figure is in results/comparison.png\n")
    assert (tmp_path / "results" / "comparison.png").stat().st_size > 10_000
    assert (tmp_path / "results" / "comparison.csv").read_text().count("\n") == 5
    assert (tmp_path / "results" / "comparison.tex").read_text().count(r"\toprule") == 2
    before = records(tmp_path / "results")
    assert sorted(before) == ["nnga-1", "nnga-2", "random_search-1", "random_search-2"]
    again = program("sweep", "sweep.yaml", "--json")
    *runs, last = [json.loads(line) for line in again.stdout.splitlines()]
    assert [(run["variant"], run["seed"]) for run in runs] == [
        ("nnga", 1), ("random_search", 1), ("nnga", 2), ("random_search", 2),
    ]  # fmt: skip
    assert {group["label"] for group in last["comparison"]["groups"]} == {"nnga", "random_search"}
    assert program("sweep", "sweep.yaml").stdout.count("was finished before") == 4
    assert records(tmp_path / "results") == before


def test_hypervolume_that_takes_long_is_left_out_and_named(program: Any, tmp_path: Path) -> None:
    goals = "{steps: minimize, distance: minimize, caught: minimize, arrived: maximize}"
    (tmp_path / "base.yaml").write_text(
        f"simulation: minisim\nparameters: {{maxSteps: 5}}\nservers: local\n"
        f"method: {{kind: nsga2, population: 6, generations: 1, objectives: {goals}}}\n"
    )
    (tmp_path / "sweep.yaml").write_text(
        "experiment: base.yaml\ngrid: {method.severity: [0.1, 0.9]}\nout: results\n"
    )
    result = program("sweep", "sweep.yaml")
    assert result.returncode == 0, result.stderr
    assert "`swarmwright runs compare results --by hypervolume` computes it" in result.stdout


def begun(store: Path) -> bool:
    """Whether the run has some generations."""
    with contextlib.suppress(InputError):  # it is just being created
        return store.exists() and Run.open(store.parent).generations > 2
    return False


@pytest.mark.slow
@pytest.mark.parametrize("servers", ["1", "local"])
def test_interrupted_it_goes_on(program: Any, start: Any, tmp_path: Path, servers: str) -> None:
    long = SWEEP.replace("grid: {", "grid: {method.generations: [400], ")
    write(tmp_path, servers, long)
    process = start("sweep", "sweep.yaml")
    store = tmp_path / "results" / "generations_400_nnga-1" / "run.sqlite"
    deadline = time.monotonic() + 30
    while not begun(store):
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < deadline
        time.sleep(0.02)
    process.send_signal(signal.SIGINT)
    said, complaint = process.communicate(timeout=30)
    assert process.returncode == 130, complaint
    assert "run the same command to continue" in said
    result = program("sweep", "sweep.yaml")
    assert result.returncode == 0, result.stderr
    alone = program("sweep", "sweep.yaml", "--out", "alone", "--servers", "local")
    assert alone.returncode == 0, alone.stderr
    assert records(tmp_path / "results") == records(tmp_path / "alone")


def test_all_runs_share_the_servers(program: Any, tmp_path: Path) -> None:
    write(tmp_path, "2")
    assert program("sweep", "sweep.yaml").returncode == 0
    hosts = {
        attempt.server
        for run in records(tmp_path / "results")
        for attempt in Run.open(tmp_path / "results" / run).attempts()
    }
    assert hosts <= {1, 2}
    local = program("sweep", "sweep.yaml", "--out", "local", "--servers", "local")
    assert local.returncode == 0, local.stderr
    assert records(tmp_path / "results") == records(tmp_path / "local")


def test_results_of_another_experiment_are_left_alone(program: Any, tmp_path: Path) -> None:
    write(tmp_path)
    assert program("sweep", "sweep.yaml").returncode == 0
    before = records(tmp_path / "results")
    (tmp_path / "base.yaml").write_text(
        BASE.replace("SERVERS", "local").replace("maxSteps: 5", "maxSteps: 6")
    )
    result = program("sweep", "sweep.yaml")
    assert result.returncode == 2
    assert (
        "results/nnga-1: holds a run of another experiment: parameters.maxSteps is 6 in the file, 5 in the "
        "run; choose another folder" in result.stderr
    )
    assert records(tmp_path / "results") == before


def test_a_figure_that_cannot_be_written_comes_last_and_fails_nothing(program: Any, tmp_path: Path) -> None:
    write(tmp_path)
    (tmp_path / "results" / "comparison.png").mkdir(parents=True)
    result = program("sweep", "sweep.yaml")
    assert result.returncode == 0
    assert "against second" in result.stdout
    assert result.stderr.startswith(
        "swarmwright: the runs are complete, but a comparison file could not be written: results/"
    )
    last = json.loads(program("sweep", "sweep.yaml", "--json").stdout.splitlines()[-1])
    assert last["picture"] is None
    assert len(last["comparison"]["groups"]) == 2


def test_what_was_asked_for_is_in_the_folder_and_missing_runs_are_named(program: Any, tmp_path: Path) -> None:
    write(tmp_path)
    assert program("sweep", "sweep.yaml", "--set", "method.generations=2").returncode == 0
    asked = json.loads((tmp_path / "results" / "sweep.json").read_text())
    assert (asked["file"], asked["seeds"]) == ("sweep.yaml", [1, 2])
    assert asked["settings"] == ["method.generations=2"]
    assert asked["experiment"]["simulation"] == "minisim"
    assert [one["experiment"]["method"]["kind"] for one in asked["variants"]] == ["nnga", "random_search"]
    assert asked["variants"][0]["runs"] == ["nnga-1", "nnga-2"]
    whole = program("runs", "verify", "results")
    assert whole.returncode == 0, whole.stderr
    assert whole.stdout.count(": ok, ") == 4
    shutil.rmtree(tmp_path / "results" / "nnga-2")
    result = program("runs", "verify", "results")
    assert result.returncode == 1
    assert "results/nnga-2: missing; the same sweep runs it\n" in result.stdout
    assert result.stdout.count(": ok, ") == 3
    lines = [json.loads(line) for line in program("runs", "verify", "results", "--json").stdout.splitlines()]
    assert [line["run"] for line in lines if not line["ok"]] == ["results/nnga-2"]
    (tmp_path / "results" / "sweep.json").write_text("[]")
    result = program("runs", "verify", "results")
    assert result.returncode == 2
    assert "results/sweep.json: is not the record of a sweep; delete it" in result.stderr


def test_fitness_on_held_out_seeds_is_compared_first_where_all_runs_have_it(
    program: Any, tmp_path: Path
) -> None:
    base = BASE.replace("SERVERS", "local").replace("maxSteps: 5", "maxSteps: 15, placement: random")
    (tmp_path / "base.yaml").write_text(f"{base}ranking: {{episodes: 2}}\nvalidate: {{episodes: 20}}\n")
    (tmp_path / "sweep.yaml").write_text(SWEEP)
    said = program("sweep", "sweep.yaml").stdout
    first = said.index("Mean fitness of each run's best candidate on held-out seeds:")
    assert first < said.index("Best recorded fitness of each run, in the episodes")
    *_, last = program("sweep", "sweep.yaml", "--json").stdout.splitlines()
    found = json.loads(last)
    assert found["held_out"]["held_out"]
    assert not found["comparison"]["held_out"]
