"""Filters and order of the runs that `runs list` shows."""

import json
from pathlib import Path
from typing import Any

import pytest

from swarmwright import InputError, optimize
from swarmwright.cli._main import run as command
from swarmwright.cli.runs import COLUMNS, Condition, sort_runs

RUNS: list[dict[str, Any]] = [
    {"run": "a", "best": None, "failed": 0, "method": "nnga", "created": "2026-01-01", "skip": True},
    {"run": "b", "best": 10.0, "failed": 3, "method": "cma_es", "created": "2026-01-02", "skip": False},
    {"run": "c", "best": -2.5, "failed": 0, "method": "sep_cma_es", "created": "2026-01-03", "skip": True},
    {"run": "d", "best": float("nan"), "failed": 8, "method": "nnga", "created": "2026-02-01", "skip": True},
]


def names(text: str) -> str:
    condition = Condition.parse(text)
    return "".join(run["run"] for run in RUNS if condition.holds(run))


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("run=b", "b"),
        ("run != b", "acd"),
        ("method=*cma*", "bc"),
        ("method!=*cma*", "ad"),
        ("failed>0", "bd"),
        ("failed<=3", "abc"),
        ("failed=3.0", "b"),
        ("best>=-2.5", "bc"),
        ("best<9", "c"),
        ("best!=10", "acd"),
        ("best=nan", ""),
        ("created>=2026-01-03", "cd"),
        ("created=2026-01*", "abc"),
        ("skip=true", "acd"),
        ("missing=1", ""),
        ("method=", ""),
    ],
)
def test_conditions(text: str, found: str) -> None:
    assert names(text) == found


def test_a_number_is_compared_with_numbers_alone() -> None:
    with pytest.raises(InputError, match="--filter best>high: 'high' is not a number"):
        names("best>high")


@pytest.mark.parametrize(
    ("column", "ascending", "descending"),
    [("best", "adcb", "bcda"), ("method", "badc", "cdab"), ("failed", "acbd", "dbca")],
)
def test_runs_without_a_value_are_at_the_end_of_the_least(
    column: str, ascending: str, descending: str
) -> None:
    assert "".join(run["run"] for run in sort_runs(RUNS, column, reverse=False)) == ascending
    assert "".join(run["run"] for run in sort_runs(RUNS, column, reverse=True)) == descending


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("runs")
    base = {"simulation": "minisim", "servers": "in-process", "validate": False}
    for number, kind in enumerate(("nnga", "random_search", "nnga")):
        method = {"kind": kind, "population": 4 + number, "generations": 1}
        random = {"parameters": {"placement": "random"}, "validate": {"episodes": 10}} if number == 2 else {}
        optimize({**base, **random, "method": method, "seed": number}, out=place / f"run-{number}")
    return place


def listed(capsys: pytest.CaptureFixture[str], folder: Path, *options: str) -> list[dict[str, Any]]:
    assert command(["runs", "list", str(folder), "--json", *options]) == 0
    return [json.loads(line) for line in capsys.readouterr().out.splitlines()]


def test_runs_are_filtered_by_columns_and_by_keys_of_their_experiments(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    every = listed(capsys, folder)
    assert [run["seed"] for run in every] == [0, 1, 2]
    assert set(COLUMNS) <= set(every[0])
    assert [run["seed"] for run in listed(capsys, folder, "--filter", "method=nnga")] == [0, 2]
    assert [run["seed"] for run in listed(capsys, folder, "--filter", "method.population>=5")] == [1, 2]
    both = ("--filter", "method=nnga", "--filter", "parameters.placement=random")
    assert [run["seed"] for run in listed(capsys, folder, *both)] == [2]
    by_size = listed(capsys, folder, "--sort", "evaluations", "--reverse")
    assert [run["evaluations"] for run in by_size] == [6, 5, 4]
    assert [run["held_out"] is None for run in listed(capsys, folder, "--sort", "held_out")] == [
        True,
        True,
        False,
    ]


def test_the_table_has_held_out_fitness_where_a_run_was_validated(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (_, _, validated) = listed(capsys, folder)
    assert command(["runs", "list", str(folder)]) == 0
    heading, *rows = capsys.readouterr().out.splitlines()
    place = heading.index("held-out")
    assert [row[place:].split()[0] for row in rows] == ["-", "-", f"{validated['held_out']:.6g}"]
    assert command(["runs", "list", str(folder), "--filter", "seed<2"]) == 0
    assert "held-out" not in capsys.readouterr().out


@pytest.mark.parametrize(
    ("condition", "words"),
    [
        ("method.populatoin>5", "did you mean 'method.population'?"),
        ("stat=done", "did you mean 'state'?"),
        ("best>much", "'much' is not a number"),
        ("best", "write KEY=VALUE"),
        ("=3", "write KEY=VALUE"),
    ],
)
def test_mistakes_in_conditions(
    condition: str, words: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert command(["runs", "list", str(folder), "--filter", condition]) == 2
    assert words in capsys.readouterr().err


def test_no_run_that_matches_is_said(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert command(["runs", "list", str(folder), "--filter", "state=failed"]) == 0
    assert capsys.readouterr().out == f"None of the 3 runs in {folder} matches.\n"


def test_conditions_are_values() -> None:
    assert Condition.parse("a.b <= 3 ") == Condition("a.b", "<=", "3")
