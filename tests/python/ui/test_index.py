"""The list has the runs that there are, whatever happens to them."""

import json
import shutil
from pathlib import Path
from typing import Any

import pytest

import swarmwright
from swarmwright import InputError, Run
from swarmwright.ui.index import RunIndex, as_values
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
