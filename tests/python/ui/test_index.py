"""The list has the runs that there are, whatever happens to them."""

import json
import shutil
import sqlite3
import time
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import swarmwright
from swarmwright import InputError, Run
from swarmwright.runs.store.lock import Lock
from swarmwright.ui import index as index_module
from swarmwright.ui.index import MOST_DELTAS, RunIndex, as_values
from tests.python.records import EXPERIMENT


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("made")
    swarmwright.optimize(EXPERIMENT, servers="in-process", out=folder / "first")
    return folder


@pytest.fixture
def index(made: Path, tmp_path: Path) -> RunIndex:
    shutil.copytree(made / "first", tmp_path / "runs" / "first")
    index = RunIndex(tmp_path / "runs")
    assert index.refresh()
    return index


def delta(index: RunIndex, version: int = 0) -> dict[str, Any]:
    values: dict[str, Any] = json.loads(index.delta(version)[1])
    return values


def test_a_row_says_what_the_run_says(index: RunIndex) -> None:
    run = Run(index.folder / "first")
    [row] = delta(index)["rows"]
    assert row["id"] == "first"
    assert row["state"] == "done"
    assert (row["generations"], row["evaluations"]) == (run.generations, run.evaluations)
    assert row["best"] == run.history[-1].best_so_far
    assert row["spark"] == [summary.best_so_far for summary in run.history]
    assert row["left"] is None


def test_only_what_has_changed_is_told(index: RunIndex) -> None:
    before = delta(index)
    assert not index.refresh()
    assert delta(index, before["version"])["rows"] == []
    shutil.copytree(index.folder / "first", index.folder / "sweep" / "second")
    assert index.refresh()
    after = delta(index, before["version"])
    assert [row["id"] for row in after["rows"]] == ["sweep/second"]
    assert after["gone"] == []
    assert not after["whole"]
    assert len(delta(index)["rows"]) == 2


def test_a_run_that_goes_on_is_read_again(index: RunIndex) -> None:
    before = delta(index)
    swarmwright.resume(index.folder / "first", generations=9, servers="in-process")
    assert index.refresh()
    [row] = delta(index, before["version"])["rows"]
    assert row["generations"] == 9


def test_many_runs_are_shown_before_all_are_read(index: RunIndex) -> None:
    for number in range(5):
        shutil.copytree(index.folder / "first", index.folder / f"more-{number}")
    assert index.refresh(0)
    assert len(delta(index)["rows"]) == 2
    for _ in range(6):
        index.refresh(0)
    assert len(delta(index)["rows"]) == 6


def test_a_run_that_is_deleted_goes(index: RunIndex) -> None:
    before = delta(index)
    shutil.rmtree(index.folder / "first")
    assert index.refresh()
    after = delta(index, before["version"])
    assert (after["rows"], after["gone"]) == ([], ["first"])
    with pytest.raises(InputError, match="first: there is no such run below"):
        index.path("first")


def test_a_tool_with_the_version_of_an_earlier_window_gets_all(index: RunIndex) -> None:
    assert delta(index, 10_000)["whole"]
    assert len(delta(index, 10_000)["rows"]) == 1
    before = delta(index)["version"]
    time.sleep(0.001)
    later = RunIndex(index.folder)
    later.refresh()
    shutil.copytree(index.folder / "first", index.folder / "second")
    later.refresh()
    assert before < later.version
    assert delta(later, before)["whole"]
    assert not delta(later, later.version - 1)["whole"]


@pytest.mark.parametrize("content", [b"", b"no store", b"SQLite format 3\0" + bytes(4000)])
def test_a_broken_store_is_listed_with_the_reason(index: RunIndex, content: bytes) -> None:
    broken = index.folder / "broken"
    broken.mkdir()
    (broken / "run.sqlite").write_bytes(content)
    index.refresh()
    row = index.row("broken")
    assert row.state == "unreadable"
    assert row.problem
    json.loads(index.delta(0)[1])


@pytest.mark.parametrize(
    "change",
    [
        "UPDATE session SET seconds = 9e999",
        "UPDATE session SET seconds = -9e999",
        "UPDATE session SET seconds = 'long'",
        (
            "UPDATE session SET seconds = 1e308; INSERT INTO session (session, started, place, host, machine,"
            " versions, seconds) SELECT 2, started, place, host, machine, versions, seconds FROM session"
        ),
        "UPDATE session SET outcome = x'ff'",
        "UPDATE generation SET best_so_far = 9e999, best = 'good'",
        "UPDATE generation SET evaluations = 9223372036854775807, failed = 9223372036854775807",
        "UPDATE generation SET failed = 'all'",
        "UPDATE fact SET value = x'ff' WHERE name = 'created'",
        "UPDATE fact SET value = printf('%.*c', 1000000, 'x') WHERE name = 'name'",
    ],
)
def test_a_store_with_impossible_values_harms_no_other_run(index: RunIndex, change: str) -> None:
    shutil.copytree(index.folder / "first", index.folder / "wrong")
    with closing(sqlite3.connect(index.folder / "wrong" / "run.sqlite")) as store:
        store.executescript(change)
    shutil.copytree(index.folder / "first", index.folder / "z-last")
    index.refresh()
    rows = {row["id"]: row for row in delta(index)["rows"]}
    assert {*rows} == {"first", "wrong", "z-last"}
    assert len(json.dumps(rows["wrong"])) < 5000
    assert bool(rows["wrong"]["problem"]) == (rows["wrong"]["state"] == "unreadable")


def test_an_unforeseen_error_is_the_problem_of_one_run(
    index: RunIndex, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copytree(index.folder / "first", index.folder / "second")
    summarize = index_module.summarize

    def fail(run: Run, name: str) -> index_module.Row:
        if name == "second":
            raise IndexError(7)
        return summarize(run, name)

    with monkeypatch.context() as patch:
        patch.setattr(index_module, "summarize", fail)
        index.refresh()
        assert index.row("second").problem.startswith("run.sqlite: has an impossible value: IndexError")
        wrong: Any = {"seed": 1j}
        patch.setattr(index_module, "summarize", lambda run, name: replace(summarize(run, name), **wrong))
        (index.folder / "second" / "run.sqlite").touch()
        index.refresh()
        assert index.row("second").state == "unreadable", "it cannot be written as JSON"
    assert index.row("first").state == "done"
    monkeypatch.setattr(index_module, "RETRY_S", 0.0)
    index.refresh()
    assert index.row("second").state == "done", "it was tried again"


def test_a_run_that_goes_on_is_read_only_when_its_files_change(
    index: RunIndex, monkeypatch: pytest.MonkeyPatch
) -> None:
    with closing(sqlite3.connect(index.folder / "first" / "run.sqlite")) as store:
        store.execute("UPDATE session SET outcome = NULL")
        store.commit()
    lock = Lock(index.folder / "first")
    index.refresh()
    assert index.row("first").state == "running"
    reads: list[str] = []
    read = index._read

    def count(name: str) -> index_module.Row:
        reads.append(name)
        return read(name)

    monkeypatch.setattr(index, "_read", count)
    assert not index.refresh()
    assert reads == []
    (index.folder / "first" / "run.sqlite").touch()
    index.refresh()
    assert reads == ["first"]
    lock.close()
    assert index.refresh()
    assert (reads, index.row("first").state) == (["first"] * 2, "killed")


def test_the_speed_is_that_of_the_last_steps_and_falls_when_the_next_one_is_late(
    index: RunIndex, monkeypatch: pytest.MonkeyPatch
) -> None:
    now = 1000.0
    monkeypatch.setattr("swarmwright.ui.index.time.monotonic", lambda: now)
    row = replace(index.row("first"), state="running", seconds=10.0, budget=20)

    def look(seconds: float, generations: int) -> tuple[float | None, float | None]:
        nonlocal now
        now += seconds
        after = index._with_rate(replace(row, generations=generations, evaluations=10 * generations))
        return after.rate, after.left

    assert look(0, 10) == (10.0, 10.0)
    assert look(5, 10) == (10.0, 10.0), "nothing is known yet"
    assert look(5, 11) == (6.4, 14.1)
    assert look(0.5, 12)[0] == 6.4, "too short to be measured"
    assert look(0.5, 12)[0] == 7.84
    assert look(1.5, 12)[0] == 7.84
    assert look(98, 12) == (0.1, 800.0)
    assert look(1, 12) == (0.1, 800.0), "it does not change all the time"
    assert index._with_rate(replace(row, state="done")).rate is None
    assert index._steps == {}


def test_of_many_versions_some_answers_are_kept(index: RunIndex) -> None:
    index.version += 100 * MOST_DELTAS
    for version in range(100 * MOST_DELTAS):
        index.delta(index.version - version)
    assert len(index._deltas) == MOST_DELTAS
    assert index.delta(index.version)[1] is index.delta(index.version)[1]


def test_links_and_hidden_folders_are_left_out(index: RunIndex, made: Path) -> None:
    (index.folder / "link").symlink_to(made / "first")
    shutil.copytree(made / "first", index.folder / ".trash" / "first")
    index.refresh()
    assert [row["id"] for row in delta(index)["rows"]] == ["first"]


@pytest.mark.parametrize("name", ["../first", "/etc", "first/..", "", "first\0", "FIRST"])
def test_only_runs_of_the_list_are_opened(index: RunIndex, name: str) -> None:
    with pytest.raises(InputError, match="there is no such run"):
        index.path(name)


def test_hostile_names_stay_text(index: RunIndex, made: Path) -> None:
    names = ["<img src=x onerror=alert(1)>", "a&b", "new\nline", "\u202egnp", "ü", "%2e%2e", "'; DROP TABLE"]
    for name in names:
        shutil.copytree(made / "first", index.folder / name)
    index.refresh()
    assert {row["id"] for row in delta(index)["rows"]} == {"first", *names}


def test_values_that_json_lacks_become_null_or_text() -> None:
    values = {"nan": float("nan"), "list": [1, float("inf"), (2.5, None)], "path": Path("a"), "flag": True}
    assert as_values(values) == {"nan": None, "list": [1, None, [2.5, None]], "path": "a", "flag": True}
    assert as_values([2**53, 2**63, -(2**63)]) == [2**53, str(2**63), str(-(2**63))]
