"""The folders of sweeps: their records, and their runs as those that are meant."""

import json
import logging
import re
import shutil
import sqlite3
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

import swarmwright
from swarmwright import InputError, Run, SweepResult
from swarmwright.analysis.comparison import compare_opened
from swarmwright.analysis.sweep import Outcome, Sweep, list_tasks
from swarmwright.analysis.sweep_folders import runs_of
from swarmwright.runs.store import FILE as STORE
from swarmwright.runs.store.folder import SWEEP as FILE


def test_the_folders_that_a_record_names_are_beside_it(tmp_path: Path) -> None:
    assert runs_of(tmp_path) is None
    (tmp_path / FILE).write_text(json.dumps({"variants": [{"runs": ["a-1", "a-2"]}, {"runs": ["..b-1"]}]}))
    assert runs_of(tmp_path) == [tmp_path / name for name in ("a-1", "a-2", "..b-1")]


@pytest.mark.parametrize(
    "runs",
    ["ab", None, [1], ["/etc"], ["../../x"], ["a/b"], ["a\\b"], [".."], ["."], [""], ["a\0"], {"a": 1}],
)
def test_names_that_are_no_folders_beside_it_are_refused(tmp_path: Path, runs: Any) -> None:
    (tmp_path / FILE).write_text(json.dumps({"variants": [{"runs": runs}]}))
    with pytest.raises(InputError, match=r"sweep\.json: is not the record of a sweep; delete it"):
        runs_of(tmp_path)


@pytest.mark.parametrize("text", ["", "[" * 100_000, "[]", "{}", '{"variants": 3}', '{"variants": ["ab"]}'])
def test_files_that_are_no_record_are_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / FILE).write_text(text)
    with pytest.raises(InputError, match=r"sweep\.json: is not the record of a sweep"):
        runs_of(tmp_path)


@pytest.fixture(scope="module")
def swept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of a sweep of two variants with two seeds."""
    folder = tmp_path_factory.mktemp("swept") / "results"
    experiment = {
        "simulation": "minisim",
        "parameters": {"maxSteps": 3},
        "method": {"kind": "nnga", "population": 4, "generations": 1},
        "servers": "local",
    }
    swarmwright.sweep(
        {"experiment": experiment, "grid": {"method.population": [4, 6]}, "seeds": 2}, out=folder, jobs=1
    )
    return folder


@pytest.fixture
def results(swept: Path, tmp_path: Path) -> Path:
    """Return a copy of it, with a file that a sweep writes."""
    (shutil.copytree(swept, tmp_path / "results") / "comparison.csv").write_text("")
    return tmp_path / "results"


def test_the_folder_of_a_sweep_means_its_runs(results: Path, caplog: pytest.LogCaptureFixture) -> None:
    (results / "other-1").mkdir()  # not of this sweep
    for given in (results, str(results), [results]):
        found = swarmwright.compare(given)
        assert [len(one.runs) for one in found.groups] == [2, 2]
    shutil.rmtree(results / "other-1")
    assert [len(one.runs) for one in swarmwright.compare(sorted(results.iterdir())).groups] == [2, 2]
    assert not caplog.records


def test_what_is_left_out_is_named(results: Path, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.WARNING, "swarmwright")
    shutil.rmtree(results / "population_6-2")
    (results / "notes.txt").write_text("")
    assert [len(one.runs) for one in swarmwright.compare(results).groups] == [2, 1]
    assert [len(one.runs) for one in swarmwright.compare(results.iterdir()).groups] == [2, 1]
    assert caplog.messages == [
        f"left out: {results}/population_6-2: missing; the same sweep runs it",
        f"left out: {results}/notes.txt: is a file, not a run folder",
    ]
    for run in results.glob("population_*"):
        shutil.rmtree(run)
    with pytest.raises(InputError, match=r"population_4-1, .* and 1 more: missing; the same sweep runs them"):
        swarmwright.compare(results)
    with pytest.raises(InputError, match=r"is not a folder; specify a run folder"):
        swarmwright.compare([results / "notes.txt"])


def test_a_sweep_and_a_comparison_of_its_folder_leave_out_the_same_runs(results: Path) -> None:
    sweep = Sweep.load(results / FILE)
    todo = list_tasks(sweep)
    failed, gone, damaged, *others = todo
    with closing(sqlite3.connect(failed.folder / STORE)) as store, store:
        store.execute("UPDATE session SET outcome = 'failed'")
    shutil.rmtree(gone.folder)
    outcome = Outcome(
        todo, {task: Run.open(task.folder) for task in (damaged, *others)}, {failed: "it broke"}
    )
    read, unreadable = outcome.open_runs()
    assert [(one.path, one.label, one.seed) for one in unreadable] == [
        (gone.folder, gone.variant.label, gone.seed)
    ]
    of_sweep = compare_opened(read, unreadable)
    of_folder = swarmwright.compare(results)
    assert str(of_sweep) == str(of_folder)
    assert {(one.path, one.kind, one.label) for one in of_folder.left_out} == {
        (failed.folder, "unfinished", "population 4"), (gone.folder, "missing", "population 6"),
    }  # fmt: skip
    assert [(len(one.runs), len(one.left_out)) for one in of_folder.groups] == [(1, 1), (1, 1)]
    found = SweepResult(
        results, tuple(outcome.finished), ("population 4", "population 6"), (), interrupted=False,
        unfinished=(read[0],), unreadable=tuple(unreadable),
    )  # fmt: skip
    assert str(of_folder) in str(found)
    assert "2 left out" in repr(found)
    assert [(row["variant"], row["left_out"]) for row in found.table()][2:] == [
        ("population 4", "failed, 4 evaluations"),
        ("population 6", "missing; the same sweep runs it"),
    ]
    # A group of which no run counts is a row all the same.
    (damaged.folder / STORE).write_bytes(b"nothing" * 1000)
    text = str(swarmwright.compare(results))
    assert re.search(r"^population 4 +0 +2$", text, re.MULTILINE)
    assert "is damaged" in text


def test_it_is_no_run(swept: Path) -> None:
    with pytest.raises(
        InputError, match="is the folder of a sweep, not of a run; specify one of the run folders"
    ):
        swarmwright.Run.open(swept)


@pytest.mark.slow
def test_commands_take_the_folder_of_a_sweep(program: Any, results: Path, tmp_path: Path) -> None:
    whole = program("runs", "compare", "results", "--json")
    assert (whole.returncode, whole.stderr) == (0, "")
    each = program("runs", "compare", *map(str, sorted(results.iterdir())), "--json")
    assert (each.returncode, each.stderr) == (0, "")  # the files of a sweep are no mistake
    sizes = [[len(one["runs"]) for one in json.loads(text.stdout)["groups"]] for text in (whole, each)]
    assert sizes == [[2, 2], [2, 2]]
    shutil.rmtree(results / "population_4-1")
    drawn = program("plot", "results", "--out", "figure.png")
    assert drawn.returncode == 1
    assert drawn.stderr == (
        "swarmwright: left out: results/population_4-1: missing; the same sweep runs it\n"
    )
    assert (tmp_path / "figure.png").stat().st_size > 10_000
