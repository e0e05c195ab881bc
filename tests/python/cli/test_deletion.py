"""`runs delete` for runs and sweeps."""

import json
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from swarmwright import Run, SweepResult, sweep
from swarmwright.cli._main import run as command
from swarmwright.runs.store.lock import Lock

EXPERIMENT: dict[str, Any] = {
    "simulation": "minisim", "servers": "in-process", "validate": False,
    "method": {"population": 4, "generations": 1},
}  # fmt: skip


@pytest.fixture
def swept(tmp_path: Path) -> SweepResult:
    return sweep(EXPERIMENT, {"method.population": [4, 5]}, seeds=2, out=tmp_path / "swept", jobs=1)


def test_a_sweep_is_deleted_with_its_runs(swept: SweepResult, capsys: pytest.CaptureFixture[str]) -> None:
    (swept.path / "comparison.csv").write_text("")
    (swept.runs[1].path / "run.sqlite").write_bytes(b"damaged")
    assert command(["runs", "delete", str(swept.path), str(swept.runs[0].path), "--yes", "--json"]) == 0
    assert not swept.path.exists()
    deleted = [json.loads(line)["deleted"] for line in capsys.readouterr().out.splitlines()]
    assert sorted(deleted) == sorted([*(str(run.path) for run in swept.runs), str(swept.path)])


def test_what_does_not_belong_to_the_sweep_stays(
    swept: SweepResult, capsys: pytest.CaptureFixture[str]
) -> None:
    (swept.path / "notes.txt").write_text("mine")
    (swept.runs[0].path / "mine.txt").write_text("mine")
    other = swept.path / "other"
    Run.open(sweep(EXPERIMENT, seeds=[9], out=swept.path.parent / "one").runs[0].path).path.rename(other)
    assert command(["runs", "delete", str(swept.path), "--yes"]) == 0
    assert {one.name for one in swept.path.iterdir()} == {"notes.txt", "other", swept.runs[0].path.name}
    assert Run.open(other).generations == 1
    assert f"Deleted {swept.path}; other files stay there: " in capsys.readouterr().out


def test_a_record_deletes_nothing_but_runs(swept: SweepResult) -> None:
    record = json.loads((swept.path / "sweep.json").read_text())
    record["variants"][0]["runs"][0] = "work"
    (swept.path / "sweep.json").write_text(json.dumps(record))
    (swept.path / "work").mkdir()
    (swept.path / "work" / "experiment.yaml").write_text("mine")
    assert command(["runs", "delete", str(swept.path), "--yes"]) == 0
    assert (swept.path / "work" / "experiment.yaml").read_text() == "mine"
    record["variants"][0]["runs"][0] = "../work"
    (swept.path / "sweep.json").write_text(json.dumps(record))
    assert command(["runs", "delete", str(swept.path), "--yes"]) == 2


def test_a_sweep_with_links_or_a_busy_run_stays_whole(
    swept: SweepResult, capsys: pytest.CaptureFixture[str]
) -> None:
    first, second, *_ = (run.path for run in swept.runs)
    with closing(Lock(second)):
        assert command(["runs", "delete", str(swept.path), "--yes"]) == 2
    assert "a process is writing this run" in capsys.readouterr().err
    moved = swept.path.parent / "moved"
    first.rename(moved)
    first.symlink_to(moved)
    assert command(["runs", "delete", str(swept.path), "--yes"]) == 2
    assert "is a symbolic link" in capsys.readouterr().err
    assert all(Run.open(run.path).generations for run in swept.runs)


def test_without_a_terminal_nothing_is_deleted(
    swept: SweepResult, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("click.confirm", lambda *_, **__: False)
    assert command(["runs", "delete", str(swept.path)]) == 1
    said = capsys.readouterr().err
    assert f"{swept.path}: a sweep of 4 runs, 18 evaluations" in said
    assert "Nothing was deleted." in said
    assert swept.path.exists()
