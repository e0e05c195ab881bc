"""`runs compare --by`, `plot --by` and what `sweep` says of fronts and archives, as programs."""

import json
from pathlib import Path
from typing import Any

import pytest

pytestmark = pytest.mark.slow

BASE = """\
simulation: minisim
parameters: {maxSteps: 6}
method:
  METHOD
  population: 6
  generations: 2
servers: local
"""
METHODS = {
    "fronts": "kind: nsga2\n  objectives: {steps: minimize}",
    "archives": "kind: map_elites\n  measures: {steps: {range: [0, 6], bins: 3}}",
}
SWEEP = "experiment: KIND.yaml\ngrid: {method.population: [4, 6]}\nseeds: 2\nout: KIND\n"


@pytest.fixture
def swept(program: Any, tmp_path: Path) -> Any:
    """Make runs of a kind in a folder of that name; return what the sweep printed."""

    def run(kind: str, *options: str) -> str:
        (tmp_path / f"{kind}.yaml").write_text(BASE.replace("METHOD", METHODS[kind]))
        (tmp_path / "sweep.yaml").write_text(SWEEP.replace("KIND", kind))
        result = program("sweep", "sweep.yaml", *options)
        assert result.returncode == 0, result.stderr
        return str(result.stdout)

    return run


def folders(path: Path) -> list[str]:
    return [str(one) for one in sorted(path.iterdir()) if one.is_dir()]


def test_fronts(program: Any, swept: Any, tmp_path: Path) -> None:
    said = swept("fronts")
    assert "\nHypervolume of each run's front; each objective is scaled from 0 to 1" in said
    assert said.endswith("The figure is in fronts/comparison.png\n")
    runs = folders(tmp_path / "fronts")
    by = ["--by", "hypervolume"]
    point = ["--reference", "fitness=-20", "--reference", "steps=7"]
    result = program("runs", "compare", *runs, *by, *point, "--json")
    assert result.returncode == 0, result.stderr
    found = json.loads(result.stdout)
    assert (found["by"], found["reference"]) == ("hypervolume", {"fitness": -20.0, "steps": 7.0})
    assert found["groups"][0]["runs"][0]["hypervolume"] > 0
    result = program("plot", runs[0], *by, "--out", "one.svg")
    assert result.stdout.startswith("Hypervolume of each run's front; ")
    assert "hypervolume of each run, at the end" in (tmp_path / "one.svg").read_text()


def test_archives(program: Any, swept: Any, tmp_path: Path) -> None:
    *_, last = swept("archives", "--json").splitlines()
    assert [one["by"] for one in json.loads(last)["indicators"]] == ["qd_score", "coverage"]
    runs = folders(tmp_path / "archives")
    result = program("runs", "compare", *runs, "--by", "qd_score", "--offset", "-20", "--at", "5")
    assert result.returncode == 0, result.stderr
    assert "minus an offset of -20.\n" in result.stdout
    # Where runs differ in length, a note has a command that compares in the same way.
    result = program("runs", "compare", *runs, "--by", "qd_score", "--offset", "-20")
    assert "--by qd_score --offset -20 --at 8` compares all" in result.stdout


@pytest.mark.journey
def test_tables_are_written(program: Any, swept: Any, tmp_path: Path) -> None:
    swept("archives")
    files = ["--csv", "table.csv", "--latex", "table.tex"]
    result = program("runs", "compare", *folders(tmp_path / "archives"), *files)
    assert result.returncode == 0, result.stderr
    limited = program("runs", "compare", *folders(tmp_path / "archives"), "--at-episodes", "8", "--json")
    assert json.loads(limited.stdout)["at_episodes"] == 8
    assert result.stdout.endswith("The table is in table.csv\nThe table is in table.tex\n")
    assert len((tmp_path / "table.csv").read_text().splitlines()) == 5
    for wrong, message in (("table.tsv", "ends with .csv"), ("none/table.csv", "there is no folder 'none'")):
        result = program("runs", "compare", *folders(tmp_path / "archives"), "--csv", wrong)
        assert (result.returncode, result.stdout) == (2, "")
        assert message in result.stderr


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--by", "coverage", "--held-out"], "--by and --held-out exclude each other"),
        (["--at-episodes", "9", "--at", "9"], "--at-episodes and --at exclude each other"),
        (["--held-out", "--at", "9"], "--held-out and --at exclude each other"),
        (["--by", "coverage", "--at-episodes", "9"], "--by and --at-episodes exclude each other"),
        (["--reference", "fitness=1"], "--reference needs --by hypervolume;"),
        (["--by", "coverage", "--offset", "1"], "--offset needs --by qd_score;"),
        (["--by", "hypervolume", "--reference", "1"], "'1' is not NAME=VALUE, such as fitness=0."),
        (["--by", "hypervolume", "--reference", "fitness=high"], "'high' is not a valid float"),
        (["--by", "hypervolume", "--reference", "steps=1", "--reference", "steps=2"], "steps is given twice"),
    ],
)
@pytest.mark.parametrize("command", [("plot",), ("runs", "compare")])
def test_options_that_contradict_each_other(
    program: Any, tmp_path: Path, command: tuple[str, ...], options: list[str], message: str
) -> None:
    (tmp_path / "run").mkdir()
    result = program(*command, "run", *options)
    assert result.returncode == 2
    assert message in result.stderr


def test_damaged_runs_are_left_out_and_named(program: Any, swept: Any, tmp_path: Path) -> None:
    swept("archives")
    first, *others = folders(tmp_path / "archives")
    (Path(first) / "run.sqlite").write_bytes(b"nothing" * 1000)
    for command in (["runs", "compare"], ["plot", "--out", "all.svg"]):
        result = program(*command, first, *others)
        assert result.returncode == 1
        assert result.stderr.startswith(f"swarmwright: left out: {first}/run.sqlite: is damaged")
        assert "against second" in result.stdout
    assert (tmp_path / "all.svg").exists()
    alone = program("runs", "compare", first)
    assert alone.returncode == 2
    assert alone.stderr.startswith(f"swarmwright: {first}/run.sqlite: is damaged")
